# SPDX-License-Identifier: Apache-2.0
"""Phase of a joint's motion at each sample, from the measurement alone.

With a measured foot force: swing, touchdown, stance or lift-off of the leg. Without: moving,
reversal or rest of the joint itself.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..recordings.record import Record, bridged

STRIDE_PHASES = ("swing", "touchdown", "stance", "lift-off")
MOTION = ("moving", "reversal", "rest")
ALL_ROWS = ("all",)
AROUND = 0.05  # [s] after a touchdown, and before and after a lift-off or a reversal
LOADED = 0.05  # share of a foot's typical largest force above which it stands
REST_SHARE = 0.05  # share of a joint's typical largest speed below which it rests
SPEED_TIME = 0.01  # [s] width of the smoother before a position is differentiated


def phases(record: Record, joint: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the phases, and the index of the current one at each sample, (T,).

    Args:
        record: Measured record.
        joint: Joint of the record; any other name has the phase "all" alone.
    """
    if joint not in record.joints:
        return ALL_ROWS, np.zeros(len(record.t), dtype=int)
    foot = foot_of(joint, record.feet)
    if foot is not None and record.has("grf"):
        return STRIDE_PHASES, _steps(record.signals["grf"][:, foot], record.dt)
    return MOTION, _motion(speed(record, joint), record.dt)


def foot_of(joint: str, feet: Sequence[str]) -> int | None:
    """Index of the foot of a joint's leg, by the longest common prefix of their names."""
    if len(feet) == 1:
        return 0
    common_lengths = [len(os.path.commonprefix([joint, foot])) for foot in feet]
    best = max(common_lengths, default=0)
    return common_lengths.index(best) if best and common_lengths.count(best) == 1 else None


def position(record: Record, joint: str) -> np.ndarray:
    """Measured position with gaps interpolated, (T,); 0 if it was never measured."""
    values = record.signals.get("q")
    if values is None:
        return np.zeros(len(record.t))
    return bridged(values[:, record.joints.index(joint)])


def speed(record: Record, joint: str) -> np.ndarray:
    """Measured velocity, or the derivative of the smoothed position, (T,)."""
    if record.has("dq"):
        values = record.signals["dq"][:, record.joints.index(joint)]
        if np.isfinite(values).any():
            return bridged(values)
    q = gaussian_filter1d(position(record, joint), max(SPEED_TIME / record.dt, 1.0), mode="nearest")
    return np.gradient(q, record.dt)


def _steps(force: np.ndarray, dt: float) -> np.ndarray:
    force = bridged(force)
    down = force > LOADED * np.quantile(force, 0.95)
    margin = max(1, round(AROUND / dt))
    index = np.where(down, 2, 0)
    change = np.diff(down.astype(int))
    for start in np.flatnonzero(change == 1) + 1:
        index[start : start + margin] = 1
    for end in np.flatnonzero(change == -1) + 1:
        index[max(end - margin, 0) : end + margin] = 3
    return index


def _motion(dq: np.ndarray, dt: float) -> np.ndarray:
    is_slow = np.abs(dq) <= REST_SHARE * np.quantile(np.abs(dq), 0.95)
    index = np.where(is_slow, 2, 0)
    sign = np.sign(np.where(is_slow, 0.0, dq))
    going = np.flatnonzero(sign)
    turns = np.flatnonzero(np.diff(sign[going]))
    margin = max(1, round(AROUND / dt))
    for last, first in zip(going[turns], going[turns + 1], strict=True):
        if first - last <= 4 * margin:  # a longer pause is no reversal
            index[max(last - margin, 0) : first + margin] = 1
    return index
