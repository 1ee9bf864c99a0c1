# SPDX-License-Identifier: Apache-2.0
"""Division of the gap into cells: joint x signal x phase x frequency band x third of the range.

The value of a cell is the energy of the whitened residual beyond that of noise, with a block
bootstrap interval; the main cells are the fewest that hold most of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..prediction.phases import ALL_ROWS, phases, position
from ..recordings.record import Record, spacing

BANDS = (1.0, 5.0, 20.0)  # edges of the frequency bands [Hz]
JOINT_SIGNALS = ("q", "dq", "tau")
MAIN_SHARE = 0.8  # share of the gap that the main cells hold together
BLOCKS, DRAWS = 32, 200


@dataclass(frozen=True)
class Cell:
    """Part of the data.

    Attributes:
        joint: Joint; foot or axis for a signal that belongs to no joint.
        signal: Signal of the joint.
        phase: Phase of the joint's motion, "all" if there is no joint.
        band: Frequency band.
        region: Third of the joint's range, "all" if there is no joint.
        share: Share of the gap.
        low: Lower end of the share's 95 % interval.
        high: Upper end of the share's 95 % interval.
    """

    joint: str
    signal: str
    phase: str
    band: str
    region: str
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class GapMap:
    """Cells with more energy than noise, the largest share first.

    Attributes:
        cells: All of them; their shares add up to 1.
        main: Number of leading cells that together hold the requested share.
    """

    cells: tuple[Cell, ...]
    main: int

    def by(self, *keys: str) -> dict[tuple[str, ...], float]:
        """Share of each combination of attributes, the largest first."""
        sums: dict[tuple[str, ...], float] = {}
        for cell in self.cells:
            key = tuple(getattr(cell, k) for k in keys)
            sums[key] = sums.get(key, 0.0) + cell.share
        return dict(sorted(sums.items(), key=lambda item: (-item[1], item[0])))


@dataclass
class _Sums:
    """Excess energy of every cell in every block."""

    blocks: int
    rows: dict[tuple[str, ...], np.ndarray] = field(default_factory=dict)

    def add(self, key: tuple[str, ...], block: np.ndarray, energy: np.ndarray) -> None:
        row = self.rows.setdefault(key, np.zeros(self.blocks))
        row += np.bincount(block, energy, self.blocks)


def localise(
    records: Sequence[Record],
    channels: Sequence,
    residuals: Sequence[np.ndarray],
    rng: np.random.Generator,
) -> GapMap:
    """Divide the gap among cells.

    Args:
        records: Measured records.
        channels: Column names of the residuals, with `signal` and `name`.
        residuals: Whitened, (T, C) per record; NaN = not measured.
        rng: Source of the resampling.
    """
    sums = _Sums(max(BLOCKS, len(records)))
    lengths = np.array([len(r.t) for r in records])
    parts = np.maximum(1, sums.blocks * lengths // lengths.sum())
    first = 0
    ranges = {c.name: _thirds(records, c.name) for c in channels if c.signal in JOINT_SIGNALS}
    for record, residual, count in zip(records, residuals, parts, strict=True):
        block = first + np.arange(len(record.t)) * count // len(record.t)
        first += count
        for column, channel in enumerate(channels):
            _add(sums, record, channel, residual[:, column], block, ranges)
    keys = list(sums.rows)
    if not keys:
        return GapMap((), 0)
    return _ranked(keys, np.stack([sums.rows[k] for k in keys], axis=1)[:first], rng)


def band_names(rate: float) -> list[str]:
    """Names of the frequency bands below the Nyquist frequency of a sampling rate [Hz]."""
    edges = [e for e in BANDS if e < 0.5 * rate]
    if not edges:
        return ["all frequencies"]
    middle = [f"{a:g} to {b:g} Hz" for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return [f"below {edges[0]:g} Hz", *middle, f"above {edges[-1]:g} Hz"]


def split(residual: np.ndarray, dt: float) -> list[tuple[str, np.ndarray, float]]:
    """Parts of a residual by frequency band: name, part (T,), share of white noise's energy.

    The parts add up to the residual where it is known and are NaN elsewhere. Rows that are known
    only at every n-th time have frequencies up to half that rate; gaps are interpolated.

    Args:
        residual: Residual, (T,), NaN where not measured; at least one value is known.
        dt: Time between rows [s].
    """
    samples = np.flatnonzero(np.isfinite(residual))
    every = spacing(samples)
    grid = np.arange(samples[0], samples[-1] + 1, every)
    values = np.interp(grid, samples, residual[samples])
    rate = 1.0 / (every * dt)
    spectrum, hertz = np.fft.rfft(values), np.fft.rfftfreq(len(grid), 1.0 / rate)
    index = np.searchsorted([e for e in BANDS if e < 0.5 * rate], hertz, side="right")
    bands = []
    for b, name in enumerate(band_names(rate)):
        part = np.full(len(residual), np.nan)
        low = np.fft.irfft(np.where(index == b, spectrum, 0.0), len(grid))
        part[samples] = np.interp(samples, grid, low)
        bands.append((name, part, float(np.mean(index == b))))
    return bands


def _add(
    sums: _Sums,
    record: Record,
    channel,
    residual: np.ndarray,
    block: np.ndarray,
    ranges: dict[str, tuple[float, float] | None],
) -> None:
    """Add the excess energy of one channel of one record to the cells."""
    valid = np.isfinite(residual)
    if not valid.any():
        return
    joint = channel.name if channel.signal in JOINT_SIGNALS else ""
    names, phase = phases(record, joint)
    regions, region = ALL_ROWS, np.zeros(len(record.t), dtype=int)
    if joint in record.joints and ranges[joint] is not None:
        low, high = ranges[joint]
        regions = (f"q < {low:.2g}", f"{low:.2g} < q < {high:.2g}", f"q > {high:.2g}")
        region = np.searchsorted([low, high], position(record, joint))
    parts = split(residual, record.dt)
    total = np.maximum(sum(part**2 for _, part, _ in parts), 1e-300)
    for band, part, noise in parts:  # the energy of a sample is divided among bands, not over time
        excess = residual**2 * part**2 / total - noise
        for p, r in sorted(set(zip(phase[valid].tolist(), region[valid].tolist(), strict=True))):
            rows = valid & (phase == p) & (region == r)
            key = (channel.name, channel.signal, names[p], band, regions[r])
            sums.add(key, block[rows], excess[rows])


def _thirds(records: Sequence[Record], joint: str) -> tuple[float, float] | None:
    """Positions that divide a joint's measured range in three; None if it hardly moved."""
    q = [position(r, joint) for r in records if joint in r.joints]
    if not q:
        return None
    low, high = np.quantile(np.concatenate(q), [0.005, 0.995])
    if not high - low > 1e-3:
        return None
    return float(low + (high - low) / 3.0), float(high - (high - low) / 3.0)


def _ranked(keys: list[tuple[str, ...]], blocks: np.ndarray, rng: np.random.Generator) -> GapMap:
    """Cells with shares; `blocks` (B, K) holds the excess energies."""
    n = len(blocks)
    shares = _shares(blocks.sum(0, keepdims=True))[0]
    draws = _shares(rng.multinomial(n, np.full(n, 1.0 / n), DRAWS) @ blocks)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    order = [i for i in np.argsort(-shares, kind="stable") if shares[i] > 0.0]
    cells = tuple(
        Cell(
            *keys[i],
            float(shares[i]),
            float(min(low[i], shares[i])),
            float(max(high[i], shares[i])),
        )
        for i in order
    )
    reached = np.cumsum([c.share for c in cells])
    return GapMap(cells, min(int(np.searchsorted(reached, MAIN_SHARE)) + 1, len(cells)))


def _shares(energy: np.ndarray) -> np.ndarray:
    positive = np.maximum(energy, 0.0)
    return positive / np.maximum(positive.sum(1, keepdims=True), 1e-300)
