# SPDX-License-Identifier: Apache-2.0
"""Sparse regression of the torque residual on a library of terms (baseline after SINDy).

Inverse dynamics at smoothed measured positions, velocities and accelerations gives the required
torque; the laws of the drives give the applied torque. The difference is regressed, joint by
joint, on terms that correspond to effects of the registry.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from loco_learning.gap.recordings.record import Record, bridged

from .physics import machines, slots
from .physics.engine import Engine
from .physics.machines import Machine

WINDOWS = (0.08, 0.16)  # smoothing windows [s]
THRESHOLDS, ROUNDS = (0.05, 0.15, 0.4), 10  # smallest share of the residual's rms of a term
TERMS = (  # effect, parameter, whether it may be negative
    ("coulomb_friction", "torque", False),
    ("viscous_friction", "damping", False),
    ("added_stiffness", "stiffness", True),
    ("cubic_stiffness", "cubic", True),
)


def discover(
    robot: str, records: Sequence[Record], window: float, threshold: float
) -> list[dict[str, Any]]:
    """Effects found by the regression, in the format of experiments.

    Args:
        robot: Robot of the battery.
        records: Records to fit.
        window: Smoothing window [s].
        threshold: Share of the residual's rms below which a term is removed.
    """
    machine = machines.get(robot)
    blocks = [_signals(machine, record, window) for record in records]
    result = []
    for j, joint in enumerate(machine.joints):
        if j not in machine.driven:
            continue
        library = np.concatenate([_library(b, j, machine.rest[j]) for b in blocks])
        missing = np.concatenate([b["missing"][:, j] for b in blocks])
        values = thresholded(library, missing, threshold)
        for (effect, name, signed), value in zip(TERMS, values, strict=True):
            if value > 0.0 or (signed and value < 0.0):
                result.append({"name": effect, "joint": joint, name: _legal(effect, float(value))})
    return result


def _legal(effect: str, value: float) -> float:
    limits = {"added_stiffness": (-900.0, 9e4), "cubic_stiffness": (-9e3, 9e5)}
    low, high = limits.get(effect, (0.0, 90.0))
    return min(max(value, low), high)


def thresholded(library: np.ndarray, missing: np.ndarray, threshold: float) -> np.ndarray:
    """Coefficients of sequentially thresholded least squares (STLSQ), (P,).

    Args:
        library: Terms, (N, P); the torque of a term is minus its coefficient times its column.
        missing: Torque residual [N·m], (N,).
        threshold: Share of the residual's rms below which a term is removed.
    """
    size = np.sqrt(np.mean(np.square(library), axis=0)) + 1e-12
    level = threshold * float(np.sqrt(np.mean(np.square(missing))))
    keep, out = size > 1e-9, np.zeros(library.shape[1])
    for _ in range(ROUNDS):
        out[:] = 0.0
        if not keep.any():
            break
        scaled = library[:, keep] / size[keep]
        out[keep] = np.linalg.lstsq(scaled, missing, rcond=1e-6)[0] / size[keep]
        new = keep & (np.abs(out) * size >= level)
        if np.array_equal(new, keep):
            break
        keep = new
    return out


def _library(block: dict[str, np.ndarray], j: int, rest: float) -> np.ndarray:
    """Columns of `TERMS`, with the signs of their effects."""
    q, v = block["q"][:, j], block["v"][:, j]
    side = np.tanh(v / (0.05 * np.max(np.abs(v)) + 1e-9))
    return -np.stack((side, v, q - rest, (q - rest) ** 3), axis=1)


def _signals(machine: Machine, record: Record, smooth: float) -> dict[str, np.ndarray]:
    """Smoothed motion, torque of the drives, and torque residual, (T, n) each."""
    columns = [record.joints.index(name) for name in machine.joints]
    q = bridged(record.signals["q"][:, columns])
    window = max(5, int(smooth / record.dt) | 1)
    q, v, a = (
        savgol_filter(q, window, 3, deriv, record.dt, axis=0, mode="interp") for deriv in range(3)
    )
    drive = _drive(machine, record, q, v)
    body = Engine(machine.body, record.dt, machines.GRAVITY)
    rotor = np.where(machine.drives[:, 0] == slots.SERVO, machine.drives[:, 5], 0.0)
    needed = np.array([body.needed(*row) for row in zip(q, v, a, strict=True)])
    needed += machine.body.damping * v + rotor * a
    inner = slice(window, len(q) - window)
    return {"q": q[inner], "v": v[inner], "missing": (needed - drive)[inner]}


def _drive(machine: Machine, record: Record, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Torque of the drives computed from the measured motion [N·m], (T, n)."""
    tau, rows = np.zeros_like(q), machine.drives
    command, speed = np.zeros_like(q), np.zeros_like(q)
    for c, j in enumerate(machine.joints.index(name) for name in record.driven):
        command[:, j] = record.command["position"][:, c]
        if "velocity" in record.command:
            speed[:, j] = record.command["velocity"][:, c]
    for j in machine.driven:
        row = rows[j]
        if row[0] == slots.SERVO:
            push = np.clip(row[3] * (command[:, j] - q[:, j]), -1.0, 1.0)
            tau[:, j] = row[1] * push - row[2] * v[:, j]
        else:
            tau[:, j] = row[1] * (command[:, j] - q[:, j]) + row[2] * (speed[:, j] - v[:, j])
    return np.clip(tau, -rows[:, 8], rows[:, 8])
