# SPDX-License-Identifier: Apache-2.0
"""Pieces of a record that each begin in the measured state: multiple shooting.

A robot that falls over, or that steps on ground, forgets nothing: a run from the first
sample says little after the first contact that comes too late. Short runs from smoothed
measurements do.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from loco_sim.geometry import multiply
from loco_sim.robot import Robot
from loco_sim.world import Base

from .channels import at_home, heading
from .record import Record
from .running import Start

HALVES = (2, 3, 5, 8, 13)  # samples on each side that a local parabola may be fitted to


def pieces(record: Record, robot: Robot, length: float) -> list[Start]:
    """Starts one after the other, where the state of the robot was measured.

    Args:
        record: What was measured.
        robot: Joints that were not measured have the position of standing.
        length: Of each piece [s].
    """
    rows = max(2, round(length / record.dt))
    q, dq = joint_states(record, robot)
    bases = base_states(record) if not robot.fixed_base else None
    found = []
    for row in range(0, len(record.t) - 1, rows):
        base = bases[row] if bases else None
        known = np.all(np.isfinite(q[row])) and np.all(np.isfinite(dq[row]))
        if known and (robot.fixed_base or base is not None):
            found.append(Start(row, min(row + rows, len(record.t)), q[row], dq[row], base))
    return found


def joint_states(record: Record, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed positions [rad or m] and velocities of the joints, (T, n) each."""
    measured, step = record.joints_of(robot, "q"), record.step("q")
    never = np.all(np.isnan(measured), axis=0)
    q, dq = np.where(never, robot.standing, measured), np.zeros(measured.shape)
    for joint in np.flatnonzero(~never):
        q[:, joint], dq[:, joint] = smoothed(measured[:, joint], record.dt, step)
    return q, dq


def base_states(record: Record) -> list[Base | None]:
    """State of the base at each sample, in its home; None where it was not measured."""
    position, turned = (record.signals.get(k) for k in ("base_position", "base_orientation"))
    if position is None or turned is None:
        return [None] * len(record.t)
    place = at_home(position, record)
    half = -0.5 * heading(turned)
    home = (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))
    turn = np.array([multiply(home, row) for row in turned.tolist()])
    flips = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
    turn[1:] *= np.cumprod(np.where(flips == 0.0, 1.0, np.where(flips < 0.0, -1.0, 1.0)))[:, None]
    x, v = (np.stack(c, axis=1) for c in zip(*(smoothed(c, record.dt) for c in place.T),
                                             strict=True))  # fmt: skip
    r, w = (np.stack(c, axis=1) for c in zip(*(smoothed(c, record.dt) for c in turn.T),
                                             strict=True))  # fmt: skip
    r /= np.linalg.norm(r, axis=1, keepdims=True)
    found: list[Base | None] = []
    for row in range(len(record.t)):
        back = (-r[row, 0], -r[row, 1], -r[row, 2], r[row, 3])
        spin = tuple(2.0 * s for s in multiply(w[row].tolist(), back)[:3])  # 2 dr/dt r^-1
        state = Base(tuple(x[row].tolist()), tuple(r[row].tolist()), tuple(v[row].tolist()), spin)
        found.append(state if np.all(np.isfinite(np.concatenate(state))) else None)
    return found


def smoothed(values: np.ndarray, dt: float, step: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Values and their rate, each (T,), by local parabolas; NaN where nothing was measured.

    The parabolas are as long as they can be without leaving more than noise.

    Args:
        values: Samples, (T,); single gaps are bridged.
        dt: Time between samples [s].
        step: Quantisation step of the values.
    """
    known = np.isfinite(values)
    if known.sum() < 2 * HALVES[0] + 1:
        return np.full(len(values), np.nan), np.full(len(values), np.nan)
    rows = np.arange(len(values))
    filled = np.interp(rows, rows[known], values[known])
    noise = max(noise_of(filled), step / np.sqrt(12.0))
    best = HALVES[0]
    for half in HALVES:
        if 2 * half + 1 > len(values):
            break
        left = filled - savgol_filter(filled, 2 * half + 1, 2, mode="interp")
        if np.sqrt(np.mean(left**2)) > 1.1 * noise:
            break
        best = half
    width = 2 * best + 1
    rate = savgol_filter(filled, width, 2, deriv=1, delta=dt, mode="interp")
    level = savgol_filter(filled, width, 2, mode="interp")
    return np.where(known, level, np.nan), np.where(known, rate, np.nan)


def noise_of(values: np.ndarray) -> float:
    """Standard deviation of white noise on something smooth, from its third differences."""
    third = np.diff(values, 3)
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0)) if len(third) else 0.0
