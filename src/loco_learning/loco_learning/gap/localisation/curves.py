# SPDX-License-Identifier: Apache-2.0
"""Measured and predicted signals before and after a search, in a file beside gap.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from loco_control.exceptions import BagError, LocoError
from loco_control.files import write_whole
from loco_control.reading import parse_json, read_npz

from ..statistics import evidence

if TYPE_CHECKING:
    from ..fitting.fit import Fitted
    from ..prediction.case import Case

FIT, HELD_OUT = "fit", "held-out"
LASTING = 0.99  # share of the time that counts for the largest gaps; the rest is momentary
_KEYS = ("measured", "before", "after", "floor")


@dataclass(frozen=True)
class Curve:
    """One record, with the predictions of the models before and after.

    Attributes:
        name: Name of the record.
        role: `FIT` or `HELD_OUT`.
        t: Times [s], (T,).
        measured: One column per channel, (T, C); NaN where nothing was compared.
        before: Prediction of the user's model with refitted values and initial states, (T, C); NaN
            where nothing was compared, or where the model diverged.
        after: Prediction of the selected model, (T, C); NaN likewise.
        floor: Noise floor of each value, measurement and numerics together, (T, C).
        judged: Rows that enter the numbers of the gap, (T,) flags.
        start: Change of the initial joint positions, then velocities, that was refitted for
            `after` [rad, rad/s], (2n,); empty if they were not refitted.
    """

    name: str
    role: str
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    floor: np.ndarray
    judged: np.ndarray
    start: np.ndarray

    def residual(self, which: str) -> np.ndarray:
        """Measured minus ``before`` or ``after``, (T, C)."""
        return self.measured - getattr(self, which)

    def whitened(self, which: str) -> np.ndarray:
        """Error of ``before`` or ``after`` at the judged rows [noise floors], (T, C).

        NaN where nothing was compared; `evidence.LIMIT` where the model diverged.
        """
        rows = np.where(self.judged[:, None], self.measured, np.nan)
        (residual,) = evidence.whiten([rows], [getattr(self, which)], self.floor)
        return residual


@dataclass(frozen=True)
class Curves:
    """All records of a search.

    Attributes:
        channels: Signal, name (of the joint, axis or foot) and unit of each column.
        records: The curves.
    """

    channels: tuple[tuple[str, str, str], ...]
    records: tuple[Curve, ...]

    @property
    def judging(self) -> list[Curve]:
        """Records with judged rows."""
        return [r for r in self.records if r.judged.any()]

    def floors(self, which: str) -> np.ndarray:
        """Rms error of ``before`` or ``after`` per channel [noise floors], (C,); NaN if unknown."""
        return np.array(evidence.by_channel([r.whitened(which) for r in self.judging]))

    def rms(self, which: str) -> float:
        """Rms error of ``before`` or ``after`` over all channels [noise floors]."""
        return evidence.rms([r.whitened(which) for r in self.judging])

    @property
    def closed(self) -> float:
        """Share of the gap that ``after`` closes, see `evidence.closed_by`."""
        both = ([r.whitened(which) for r in self.judging] for which in ("before", "after"))
        return evidence.closed_by(*both)

    def worst(self, count: int) -> list[int]:
        """Columns with the largest gap before, in noise floors, in column order.

        Momentary errors, such as those of a slightly wrong initial state, do not count.
        """
        miss = np.abs(np.concatenate([r.whitened("before") for r in self.judging]))
        miss = np.where(np.isfinite(miss).any(axis=0), np.nan_to_num(miss), -1.0)
        lasting = np.minimum(miss, np.quantile(miss, LASTING, axis=0))
        ratio = np.mean(lasting * np.abs(lasting), axis=0)
        return sorted(np.argsort(-ratio, kind="stable")[:count].tolist())

    def label(self, column: int) -> str:
        """Name of a column for figures and tables."""
        signal, name, _ = self.channels[column]
        return f"{signal} {name.removesuffix('_joint')}".replace("_", " ").strip()

    def unit(self, column: int) -> str:
        """Unit of a column."""
        return self.channels[column][2]

    def save(self, path: str | Path) -> None:
        """Write an .npz file, completely or not at all."""
        heads = [{"name": r.name, "role": r.role} for r in self.records]
        arrays = {"head": json.dumps([list(map(list, self.channels)), heads])}
        for i, r in enumerate(self.records):
            arrays |= {f"{key}_{i}": getattr(r, key) for key in ("t", *_KEYS, "judged", "start")}
        write_whole(path, lambda file: np.savez_compressed(file, **arrays))


def load(path: str | Path) -> Curves:
    """Read a file of `Curves.save`.

    Raises:
        BagError: The file holds no curves.
    """
    try:
        file = read_npz(path)
        channels, heads = parse_json(str(file["head"]), path)
        records = tuple(
            Curve(
                h["name"], h["role"], file[f"t_{i}"], *(file[f"{key}_{i}"] for key in _KEYS),
                file[f"judged_{i}"].astype(bool), file[f"start_{i}"],
            )
            for i, h in enumerate(heads)
        )  # fmt: skip
        return Curves(tuple(map(tuple, channels)), records)
    except (LocoError, KeyError, ValueError, TypeError) as error:
        raise BagError(f"{path} does not hold the curves of a gap ({error})") from None


def curves(case: Case, before: Fitted, after: Fitted) -> Curves:
    """Measured signals, and the predictions of two models.

    Args:
        case: Model and data.
        before: The user's own model.
        after: The selected model.
    """
    result = []
    for i, record in enumerate(case.records):
        measured, floor = case.forward.measured[i], case.floors[i]
        rows = _compared(measured)
        both = (_predicted(measured, model.whole[i], floor) for model in (before, after))
        arrays = (record.t[: len(measured)], measured, *both, floor, case.held_rows[i])
        role = FIT if case.fit_rows[i].any() else HELD_OUT
        start = after.starts[i] if after.starts else np.zeros(0)
        result.append(Curve(record.name, role, *(a[rows] for a in arrays), start))
    channels = tuple((c.signal, c.name, c.unit) for c in case.forward.channels)
    return Curves(channels, tuple(result))


def _compared(measured: np.ndarray) -> slice:
    """Rows that were compared, as an evenly spaced slice."""
    samples = np.flatnonzero(np.isfinite(measured).any(axis=1)).tolist()
    every = gcd(*np.diff(samples).tolist()) if len(samples) > 1 else 1
    return slice(samples[0] % every, None, every) if samples else slice(None)


def _predicted(measured: np.ndarray, residual: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Prediction from a whitened residual, NaN where it diverged: inverse of `whiten`."""
    return np.where(np.abs(residual) < evidence.LIMIT, measured + residual * floor, np.nan)


def merge(air: Curves, ground: Curves) -> Curves:
    """Curves of a robot in the air and on the ground; only rows on the ground are judged."""
    channels = tuple(dict.fromkeys([*ground.channels, *air.channels]))
    first = [replace(r, judged=np.zeros_like(r.judged)) for r in _over(channels, air)]
    return Curves(channels, (*first, *_over(channels, ground)))


def _over(channels: Sequence[tuple[str, str, str]], one: Curves) -> list[Curve]:
    """Records with columns for more channels; NaN and a floor of 1 where a record has none."""
    selected = []
    for r in one.records:
        blank = {key: np.full((len(r.t), len(channels)), np.nan) for key in _KEYS[:3]}
        arrays = {**blank, "floor": np.ones((len(r.t), len(channels)))}
        for key, wide in arrays.items():
            wide[:, [channels.index(c) for c in one.channels]] = getattr(r, key)
        selected.append(replace(r, **arrays))
    return selected
