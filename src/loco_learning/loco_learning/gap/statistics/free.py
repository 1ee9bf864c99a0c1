# SPDX-License-Identifier: Apache-2.0
"""Velocity feedback and memory of a joint, from measured motion and commanded torque alone.

They follow from a regression of the torque on acceleration, velocity and position of the joint, all
with the same smoothing, which is short compared to motion and torque. No model of the robot is
used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

PART = 0.3  # width of the smoothing over the time scale of motion or torque (taste)
TRIM = 5.0  # smoothing widths from either end that are not used (theory)
STEEP = 3.0  # slope of the tanh of dry friction, over the rms velocity (taste)


@dataclass(frozen=True)
class Free:
    """Properties of a joint with torque commands.

    Attributes:
        fed_back: Share of the torque that its velocity explains, 1 for velocity feedback.
        decay: Decay rate of initial errors [1/s]; 0 or below if they do not decay.
        time: Time scale of the motion: standard deviation over rms velocity [s].
        shift: Displacement by the mean torque, over the standard deviation of the position.
    """

    fed_back: float
    decay: float
    time: float
    shift: float = 0.0


def free(motions: Sequence[tuple[np.ndarray, np.ndarray, float]]) -> Free:
    """Velocity feedback and memory of a joint.

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
    shift = abs(np.mean(tau)) / max(abs(stiffness) * np.std(x[:, 2]), 1e-300)
    return Free(float(fed_back), float(decay), time, float(shift))


def _time(signals: Sequence[tuple[np.ndarray, float]]) -> float:
    """Time scale of signals: standard deviation over rms derivative [s]."""
    variance = np.mean([np.var(x) for x, _ in signals])
    rate = np.mean([np.mean(np.square(np.gradient(x) / dt)) for x, dt in signals])
    return float(np.sqrt(variance / max(rate, 1e-300)))


def _smoothed(
    q: np.ndarray, torque: np.ndarray, dt: float, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration, velocity, position and 1, (T, 4), and torque, (T,), smoothed, without ends."""
    wide = max(1.0, width / dt)
    sides = [gaussian_filter1d(q, wide, order=n, mode="nearest") / dt**n for n in (2, 1, 0)]
    margin = min(round(TRIM * wide), (len(q) - 1) // 3)
    inside = slice(margin, len(q) - margin)
    left = np.column_stack([*sides, np.ones(len(q))])[inside]
    return left, gaussian_filter1d(torque, wide, mode="nearest")[inside]


def _left(columns: np.ndarray, values: np.ndarray) -> float:
    """Mean square residual of values after a regression on columns."""
    return float(np.mean(np.square(values - columns @ np.linalg.lstsq(columns, values)[0])))
