# SPDX-License-Identifier: Apache-2.0
"""Feedback and memory of a joint, as measured motion and commanded torque alone tell them.

All from a regression of the torque on acceleration, speed and position of the joint, each after
the same smoothing, which is short beside motion and torque. No model of the robot takes part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

PART = 0.3  # of the time in which motion or torque change by their deviation: smoothing (taste)
EDGE = 5.0  # deviations of the smoothing from either end that do not count (theory)
STEEP = 3.0  # usual speeds over which dry friction turns round: slope of its tanh (taste)


@dataclass(frozen=True)
class Free:
    """A joint that is told torques.

    Attributes:
        fed_back: Share of the torque that its speed alone tells, 1 where a controller makes it so.
        decay: Rate at which it forgets where it was [1/s]; 0 or below where it never does.
        time: Time in which its motion changes by its own deviation [s].
    """

    fed_back: float
    decay: float
    time: float


def free(motions: Sequence[tuple[np.ndarray, np.ndarray, float]]) -> Free:
    """Feedback and memory of a joint.

    Args:
        motions: Position [rad or m] and torque, (T,) each without gaps, and the time between
            samples [s], for each record.
    """
    time = _time([(q, dt) for q, _, dt in motions])
    width = PART * min(time, _time([(torque, dt) for _, torque, dt in motions]))
    rows = [_smoothed(*motion, width) for motion in motions]
    x = np.concatenate([left for left, _ in rows])
    tau = np.concatenate([right for _, right in rows])
    if len(tau) <= 2 * x.shape[1] or not np.ptp(tau) > 0.0:
        return Free(0.0, 0.0, time)
    usual = float(np.sqrt(np.mean(np.square(x[:, 1])))) or 1.0
    dry = np.tanh(STEEP * x[:, 1] / usual)
    fed_back = 1.0 - _left(np.column_stack([x[:, [1, 3]], dry]), tau) / np.var(tau)
    mass, damping, stiffness = np.linalg.lstsq(np.column_stack([x, dry]), tau, rcond=None)[0][:3]
    decay = -np.max(np.roots([mass, damping, stiffness]).real) if mass > 0.0 else 0.0
    return Free(float(fed_back), float(decay), time)


def _time(signals: Sequence[tuple[np.ndarray, float]]) -> float:
    """Time in which signals change by their own deviation [s]."""
    spread = np.mean([np.var(x) for x, _ in signals])
    rate = np.mean([np.mean(np.square(np.gradient(x) / dt)) for x, dt in signals])
    return float(np.sqrt(spread / max(rate, 1e-300)))


def _smoothed(
    q: np.ndarray, torque: np.ndarray, dt: float, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration, speed, position and 1, (T, 4), and the torque, (T,), without the ends."""
    wide = max(1.0, width / dt)
    sides = [gaussian_filter1d(q, wide, order=n, mode="nearest") / dt**n for n in (2, 1, 0)]
    edge = min(round(EDGE * wide), (len(q) - 1) // 3)
    inside = slice(edge, len(q) - edge)
    left = np.column_stack([*sides, np.ones(len(q))])[inside]
    return left, gaussian_filter1d(torque, wide, mode="nearest")[inside]


def _left(columns: np.ndarray, values: np.ndarray) -> float:
    """Mean square of what columns leave of values."""
    return float(np.mean(np.square(values - columns @ np.linalg.lstsq(columns, values)[0])))
