# SPDX-License-Identifier: Apache-2.0
"""Simulated sensor readings: delayed, distorted, rounded, with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from .hidden import Hidden
from .machines import Machine, Sensor

SLOPE = 1e-4  # half of the time over which a velocity sensor averages [s]


def joints(
    machine: Machine,
    effects: Sequence[Hidden],
    t: np.ndarray,
    seen: np.ndarray,
    speed: np.ndarray,
    ticks: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Readings of the joint sensors [rad], (T, n); all NaN for a diverged simulation.

    Args:
        machine: Machine with the sensors.
        effects: Hidden effects.
        t: Fine time grid [s], (R,).
        seen: Positions on this grid [rad], (R, n).
        speed: Velocities on this grid [rad/s], (R, n).
        ticks: Times of the readings [s], (T,).
        rng: Generator of the noise.
    """
    late = sum(e.params["delay"] for e in effects if e.effect == "sensor_latency")
    when = np.clip(ticks - late, t[0], t[-1])
    if not (np.isfinite(seen).all() and np.isfinite(speed).all()):
        return np.full((len(ticks), len(machine.joints)), np.nan)
    out = np.empty((len(ticks), len(machine.joints)))
    for j, name in enumerate(machine.joints):
        curve = CubicHermiteSpline(t, seen[:, j], speed[:, j])
        q, v = curve(when), np.interp(when, t, speed[:, j])
        local = [e for e in effects if fnmatchcase(name, e.place or "*")]
        q = _bent(q, v, local, machine.rest[j])
        out[:, j] = _read(q, machine.sensors[j], rng)
        for e in local:
            if e.effect == "quantisation":
                out[:, j] = e.params["step"] * np.round(out[:, j] / e.params["step"])
    return out


def speeds(
    machine: Machine,
    effects: Sequence[Hidden],
    t: np.ndarray,
    seen: np.ndarray,
    speed: np.ndarray,
    ticks: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """Readings of the velocity sensors [rad/s], (T, n): slopes of the positions that sensors see.

    Arguments as for `joints`; None without such sensors.
    """
    if machine.speed_noise is None:
        return None
    exact = replace(machine, sensors=(Sensor(),) * len(machine.joints))
    ends = [joints(exact, effects, t, seen, speed, ticks + by, rng) for by in (-SLOPE, SLOPE)]
    slopes = (ends[1] - ends[0]) / (2.0 * SLOPE)
    return slopes + machine.speed_noise * rng.standard_normal(slopes.shape)


def torques(
    machine: Machine, effects: Sequence[Hidden], tau: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Readings of the torque sensors [N·m], (T, n)."""
    out = tau + machine.torque_noise * rng.standard_normal(tau.shape)
    for e in effects:
        at = [fnmatchcase(name, e.place or "*") for name in machine.joints]
        if e.effect == "sensor_bias":
            out[:, at] += e.params.get("tau", 0.0)
        elif e.effect == "sensor_gain":
            out[:, at] *= 1.0 + e.params.get("tau", 0.0)
    return out


def _bent(q: np.ndarray, v: np.ndarray, here: list[Hidden], rest: float) -> np.ndarray:
    """Positions with the sensor's systematic errors [rad]."""
    for e in here:
        p, x = e.params, q - rest
        if e.effect == "sensor_bias":
            q = q + p.get("q", 0.0)
        elif e.effect == "sensor_gain":
            q = q + p.get("q", 0.0) * q
        elif e.effect == "sensor_nonlinearity":
            q = q + p.get("quadratic", 0.0) * x**2 + p.get("cubic", 0.0) * x**3
        elif e.effect == "joint_offset":
            q = q - p["offset"]
        elif e.effect == "speed_skew":
            q = q + p["skew"] * v * np.abs(v)
        elif e.effect == "sensor_play":
            q = _dragged(q, 0.5 * p["width"])
    return q


def _dragged(q: np.ndarray, half: float) -> np.ndarray:
    """Positions of a sensor that is coupled to its joint with backlash [rad]."""
    out = q.copy()
    for k in range(1, len(q)):
        out[k] = min(max(out[k - 1], q[k] - half), q[k] + half)
    return out


def _read(q: np.ndarray, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """Rounded readings with noise."""
    noise = sensor.noise * rng.standard_normal(len(q))
    if len(sensor.table[0]):
        angles, counts = (np.asarray(column) for column in sensor.table)
        fine = np.linspace(angles[0], angles[-1], 20001)
        curve = PchipInterpolator(angles, counts)(fine)
        exact = np.interp(q, fine, curve) + noise
        return np.interp(np.clip(np.rint(exact), 0, 4095), curve, fine)
    q = q + noise
    return sensor.step * np.round(q / sensor.step) if sensor.step > 0.0 else q
