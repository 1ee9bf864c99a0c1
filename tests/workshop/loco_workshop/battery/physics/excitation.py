# SPDX-License-Identifier: Apache-2.0
"""Excitations of the battery's machines: chirps, steps, slow ramps, and a held-out mix."""

from __future__ import annotations

import numpy as np

from .machines import Machine

DURATION, STILL = 4.0, 0.15  # duration of a record, and of the rest at its start [s]
FIT = ("chirp", "steps", "ramp")
HELD_OUT = "mix"
RECORDS = (*FIT, HELD_OUT)


def command(machine: Machine, kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions [rad] and velocities [rad/s] of the driven joints, (T, m) each.

    They start at rest at the centre of the joint's range, stay inside it, and do not exceed the
    machine's largest command speed.

    Args:
        machine: The machine.
        kind: Kind of record, from `RECORDS`.
        seed: Seed of amplitudes, frequencies and holds.
    """
    rng = np.random.default_rng([seed, RECORDS.index(kind)])
    t = np.arange(round(DURATION * machine.rate)) / machine.rate
    makers = {"chirp": _chirp, "steps": _steps, "ramp": _ramp, "mix": _mix}
    q = np.empty((len(t), len(machine.driven)))
    for column, (centre, span) in enumerate(zip(machine.centre, machine.span, strict=True)):
        shape = makers[kind](t, machine, span, rng)
        shape *= np.clip((t - STILL) / 0.2, 0.0, 1.0)
        q[:, column] = centre + np.clip(shape, -span, span)
    v = np.gradient(q, t, axis=0)
    v[np.abs(v) > machine.fast] = 0.0  # zero target velocity at jumps
    v[0] = 0.0
    return q, v


def _chirp(t: np.ndarray, m: Machine, span: float, rng: np.random.Generator) -> np.ndarray:
    """Sine of rising frequency whose speed stays below the machine's limit."""
    low, high = m.band[0] * rng.uniform(1.0, 1.5), m.band[1] * rng.uniform(0.8, 1.0)
    frequency = low * (high / low) ** (t / t[-1])
    phase = 2.0 * np.pi * np.cumsum(frequency) / m.rate
    amplitude = np.minimum(rng.uniform(0.5, 0.7) * span, m.fast / (2.0 * np.pi * frequency))
    return amplitude * np.sin(phase + rng.uniform(0.0, 2.0 * np.pi))


def _steps(t: np.ndarray, m: Machine, span: float, rng: np.random.Generator) -> np.ndarray:
    """Jumps to random positions, each held for a random time."""
    out, start, place = np.zeros(len(t)), STILL + 0.2, 0.0
    while start < t[-1]:
        new = rng.uniform(-0.9, 0.9) * span
        place = new if abs(new - place) > 0.3 * span else -np.sign(place or 1.0) * 0.7 * span
        out[t >= start] = place
        start += rng.uniform(0.3, 0.8)
    return out


def _ramp(t: np.ndarray, m: Machine, span: float, rng: np.random.Generator) -> np.ndarray:
    """Slow back-and-forth motion with reversals of several sizes, and pauses."""
    turns = [0.0, 0.9, 0.4, 0.8, -0.2, 0.1, -0.9, -0.5, -0.7, 0.0]
    side = 1.0 if rng.random() < 0.5 else -1.0
    at = np.cumsum([0.0, *(abs(b - a) + 0.1 for a, b in zip(turns, turns[1:], strict=False))])
    shape = np.interp(t, at / at[-1] * t[-1], turns) * span * side
    pause = (t > 0.45 * t[-1]) & (t < 0.5 * t[-1])
    shape[pause] = shape[np.argmax(pause)]
    return shape * rng.uniform(0.85, 1.0)


def _mix(t: np.ndarray, m: Machine, span: float, rng: np.random.Generator) -> np.ndarray:
    """Several sines with other amplitudes, then a step, then a ramp."""
    sines = np.zeros(len(t))
    for _ in range(3):
        f = m.band[0] * (0.7 * m.band[1] / m.band[0]) ** rng.random()
        amplitude = min(0.3 * span, 0.4 * m.fast / (2.0 * np.pi * f))
        sines += amplitude * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi))
    out, middle, late = sines, 0.5 * t[-1], 0.7 * t[-1]
    hold = (t >= middle) & (t < late)
    place = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 0.8) * span
    out[hold] = place
    after = t >= late
    out[after] = np.interp(t[after], [late, t[-1]], [place, -0.5 * place])
    return out
