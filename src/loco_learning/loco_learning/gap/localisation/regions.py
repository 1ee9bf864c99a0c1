# SPDX-License-Identifier: Apache-2.0
"""Regions of a joint's states with a large gap, in words: a shallow regression tree per joint.

Example: "knee, speed < 0.3 rad/s, stance: 62% of its gap in 12% of the time".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..prediction.channels import slides
from ..prediction.phases import STRIDE_PHASES, phases, position, speed
from ..recordings.record import Record
from .localise import JOINT_SIGNALS

DEPTH, CUTS = 3, 16
LEAST_LEAF = 0.04  # smallest share of the samples in a leaf
MIN_SHARE = 0.05  # smallest share of the variance that a split must explain
NO_CONDITION = ("everywhere",)
DENSE = 1.5  # smallest energy of a reported region, over the average energy


@dataclass(frozen=True)
class Region:
    """States of a joint with much of its gap.

    Attributes:
        joint: Name of the joint.
        words: Conditions that hold there, e.g. ("speed < 0.3 rad/s", "stance").
        energy: Share of the joint's gap.
        time: Share of the measured samples.
    """

    joint: str
    words: tuple[str, ...]
    energy: float
    time: float

    def __str__(self) -> str:
        where = ", ".join([self.joint, *self.words])
        if self.words == NO_CONDITION:
            return f"{where}: no position, speed, time or phase stands out"
        return f"{where}: {self.energy:.0%} of its gap in {self.time:.0%} of the time"


def regions(
    records: Sequence[Record],
    channels: Sequence,
    residuals: Sequence[np.ndarray],
    joints: int = 3,
    min_share: float = 0.15,
) -> list[Region]:
    """Regions of the joints that hold most of the gap, the largest first.

    Args:
        records: Measured records.
        channels: Channels of the columns of the residuals.
        residuals: Whitened, (T, C) per record; NaN = not measured.
        joints: Largest number of joints.
        min_share: Share of the whole gap that a joint must hold.
    """
    energies = {}
    for column, channel in enumerate(channels):
        if channel.signal in JOINT_SIGNALS:
            parts = np.concatenate([np.square(r[:, column]) - 1.0 for r in residuals])
            old = energies.get(channel.name, np.full(len(parts), np.nan))
            both = np.nan_to_num(old) + np.nan_to_num(parts)
            energies[channel.name] = np.where(np.isnan(old) & np.isnan(parts), np.nan, both)
    sums = {name: float(np.nansum(e)) for name, e in energies.items()}
    total = sum(max(e, 0.0) for e in sums.values())
    ranked = sorted(energies, key=lambda name: (-sums[name], name))
    sliding = slides(channels)
    result = []
    for joint in ranked[:joints]:
        unit = "m" if joint in sliding else "rad"
        held = [r for r in records if joint in r.joints]
        if len(held) == len(records) and sums[joint] > max(min_share * total, 0.0):
            valid = np.isfinite(energies[joint])
            named, values = features(records, joint, unit)
            result += of_joint(joint, energies[joint][valid], named, values[valid])
    return result


def features(
    records: Sequence[Record], joint: str, unit: str
) -> tuple[list[tuple[str, str]], np.ndarray]:
    """States of a joint: names with units, and values (N, F) of all records in sequence."""
    named = [("position", unit), ("velocity", f"{unit}/s"), ("speed", f"{unit}/s"), ("time", "s")]
    rows = []
    errors = all("position" in r.command and joint in r.driven for r in records)
    for r in records:
        q, dq = position(r, joint), speed(r, joint)
        columns = [q, dq, np.abs(dq), r.t]
        if errors:
            columns.append(np.abs(r.command["position"][:, r.driven.index(joint)] - q))
        names, phase = phases(r, joint)
        columns += [
            (phase == STRIDE_PHASES.index(p)) * float(names == STRIDE_PHASES) for p in STRIDE_PHASES
        ]
        rows.append(np.stack(columns, axis=1))
    named += [("tracking error", unit)] if errors else []
    return [*named, *((p, "") for p in STRIDE_PHASES)], np.concatenate(rows)


def of_joint(
    joint: str, energy: np.ndarray, named: Sequence[tuple[str, str]], values: np.ndarray
) -> list[Region]:
    """Leaves of a tree on `values` (N, F) with a high density of `energy` (N,)."""
    total = max(float(energy.sum()), 1e-300)
    target = np.minimum(energy, np.quantile(energy, 0.99))
    result = []
    scale = float(((target - target.mean()) ** 2).sum())
    for rows, limits in _split(target, values, np.arange(len(energy)), {}, scale, DEPTH):
        share, time = float(energy[rows].sum()) / total, len(rows) / len(energy)
        if limits and share >= 0.1 and share >= DENSE * time:
            result.append(Region(joint, _conditions(limits, named), min(share, 1.0), time))
    result.sort(key=lambda r: (-r.energy, r.words))
    return result or [Region(joint, NO_CONDITION, 1.0, 1.0)]


def _split(
    target: np.ndarray,
    values: np.ndarray,
    rows: np.ndarray,
    limits: dict[int, tuple[float, float]],
    scale: float,
    depth: int,
) -> list[tuple[np.ndarray, dict[int, tuple[float, float]]]]:
    """Rows of each leaf, with the interval of each feature on the path to it."""
    best = _best(target[rows], values[rows], round(LEAST_LEAF * len(target))) if depth else None
    if best is None or best[0] < MIN_SHARE * scale:
        return [(rows, limits)]
    _, feature, cut = best
    low, high = limits.get(feature, (-np.inf, np.inf))
    under = values[rows, feature] < cut
    left = _split(target, values, rows[under], {**limits, feature: (low, cut)}, scale, depth - 1)
    right = _split(target, values, rows[~under], {**limits, feature: (cut, high)}, scale, depth - 1)
    return left + right


def _best(y: np.ndarray, x: np.ndarray, min_size: int) -> tuple[float, int, float] | None:
    """Split that explains most of the variance: explained amount, feature, threshold."""
    best = None
    n, total = len(y), y.sum()
    for feature in range(x.shape[1]):
        order = np.argsort(x[:, feature], kind="stable")
        ordered, sums = x[order, feature], np.cumsum(y[order])
        for cut in np.unique(np.quantile(ordered, np.arange(1, CUTS) / CUTS)):
            count = int(np.searchsorted(ordered, cut))
            if min(count, n - count) < max(min_size, 1):
                continue
            left = sums[count - 1]
            gain = left**2 / count + (total - left) ** 2 / (n - count) - total**2 / n
            if best is None or gain > best[0]:
                best = (float(gain), feature, float(cut))
    return best


def _conditions(
    limits: dict[int, tuple[float, float]], named: Sequence[tuple[str, str]]
) -> tuple[str, ...]:
    labels = []
    for feature in sorted(limits):
        name, unit = named[feature]
        low, high = limits[feature]
        if not unit:
            labels.append(name if low > 0.0 else f"not {name}")
        elif np.isinf(low):
            labels.append(f"{name} < {high:.2g} {unit}")
        elif np.isinf(high):
            labels.append(f"{name} > {low:.2g} {unit}")
        else:
            labels.append(f"{low:.2g} < {name} < {high:.2g} {unit}")
    return tuple(labels)
