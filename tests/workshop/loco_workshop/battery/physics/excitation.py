# SPDX-License-Identifier: Apache-2.0
"""Excitations of the battery's machines: chirps, steps, ramps, sines, walks between postures."""

from __future__ import annotations

import numpy as np

from . import slots
from .engine import Engine
from .machines import GRAVITY, Machine

DURATION, STILL = 4.0, 0.15  # duration of a record, and of the rest at its start [s]
Command = tuple[np.ndarray, ...]  # positions [rad], velocities [rad/s], efforts, (T, m) each


def command(machine: Machine, name: str, seed: int) -> Command:
    """Positions [rad], velocities [rad/s] and efforts of the driven joints, (T, m) each.

    They start at rest at the centre of the joint's range, stay inside it, and do not exceed the
    machine's largest command speed. Efforts are torques [N·m] that are fed forward, or what the
    drive calls a torque.

    Args:
        machine: The machine as its user knows it.
        name: Name of one of its records.
        seed: Seed of amplitudes, frequencies and holds.
    """
    number = [record.name for record in machine.records].index(name)
    record = machine.records[number]
    rng = np.random.default_rng([seed, number])
    t = np.arange(round((record.seconds or DURATION) * machine.rate)) / machine.rate
    q = np.empty((len(t), len(machine.driven)))
    for column, (centre, span) in enumerate(zip(machine.centre, machine.span, strict=True)):
        fast = machine.speed(column)
        shape = MAKERS[record.kind](t, machine, fast, span, rng)
        shape *= np.clip((t - STILL) / 0.2, 0.0, 1.0)
        shape = np.clip(shape, -span, span)
        if machine.commands == ("velocity",):
            shape = _slewed(shape, fast / machine.rate)
        q[:, column] = centre + shape
    v = np.gradient(q, t, axis=0)
    v[np.abs(v) > machine.fast] = 0.0  # zero target velocity at jumps
    v[0] = 0.0
    return q, v, _efforts(machine, q)


def fitted(machine: Machine) -> list[str]:
    """Names of the records that are not held out."""
    return [record.name for record in machine.records if not record.judge]


def _efforts(machine: Machine, q: np.ndarray) -> np.ndarray:
    """Efforts of a command, (T, m): the weight at its positions, or what a torque drive needs."""
    rows, driven = machine.drives[machine.driven], machine.driven
    out = np.zeros(q.shape)
    if machine.weight:
        engine, at = Engine(machine.body, 1e-3, GRAVITY), machine.start.copy()
        still = np.zeros(len(at))
        for k, here in enumerate(q):
            at[driven] = here
            out[k] = engine.needed(at, still, still)[driven]
    if rows[0, 0] == slots.TORQUE:
        at, still = machine.start, np.zeros(len(machine.start))
        springs = machine.springs[driven]
        weight = Engine(machine.body, 1e-3, GRAVITY).needed(at, still, still)[driven]
        torque = weight + springs[:, 1] * (q - springs[:, 3])
        out = (torque - rows[:, 2]) / rows[:, 1]
    return out


def _slewed(shape: np.ndarray, most: float) -> np.ndarray:
    """The positions at a limited speed: steps become ramps."""
    out = shape.copy()
    for k in range(1, len(out)):
        out[k] = out[k - 1] + min(max(shape[k] - out[k - 1], -most), most)
    return out


def _chirp(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Sine of rising frequency whose speed stays below the machine's limit."""
    low, high = m.band[0] * rng.uniform(1.0, 1.5), m.band[1] * rng.uniform(0.8, 1.0)
    frequency = low * (high / low) ** (t / t[-1])
    phase = 2.0 * np.pi * np.cumsum(frequency) / m.rate
    amplitude = np.minimum(rng.uniform(0.5, 0.7) * span, fast / (2.0 * np.pi * frequency))
    return amplitude * np.sin(phase + rng.uniform(0.0, 2.0 * np.pi))


def _steps(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Jumps to random positions, each held for a random time."""
    out, start, place = np.zeros(len(t)), STILL + 0.2, 0.0
    while start < t[-1]:
        new = rng.uniform(-0.9, 0.9) * span
        place = new if abs(new - place) > 0.3 * span else -np.sign(place or 1.0) * 0.7 * span
        out[t >= start] = place
        start += rng.uniform(0.3, 0.8)
    return out


def _ramp(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Slow back-and-forth motion with reversals of several sizes, and pauses."""
    turns = [0.0, 0.9, 0.4, 0.8, -0.2, 0.1, -0.9, -0.5, -0.7, 0.0]
    side = 1.0 if rng.random() < 0.5 else -1.0
    at = np.cumsum([0.0, *(abs(b - a) + 0.1 for a, b in zip(turns, turns[1:], strict=False))])
    shape = np.interp(t, at / at[-1] * t[-1], turns) * span * side
    pause = (t > 0.45 * t[-1]) & (t < 0.5 * t[-1])
    shape[pause] = shape[np.argmax(pause)]
    return shape * rng.uniform(0.85, 1.0)


def _mix(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Several sines with other amplitudes, then a step, then a ramp."""
    sines = np.zeros(len(t))
    for _ in range(3):
        f = m.band[0] * (0.7 * m.band[1] / m.band[0]) ** rng.random()
        amplitude = min(0.3 * span, 0.4 * fast / (2.0 * np.pi * f))
        sines += amplitude * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi))
    out, middle, late = sines, 0.5 * t[-1], 0.7 * t[-1]
    hold = (t >= middle) & (t < late)
    place = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 0.8) * span
    out[hold] = place
    after = t >= late
    out[after] = np.interp(t[after], [late, t[-1]], [place, -0.5 * place])
    return out


def _multisine(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Eight sines, evenly spread over the band on a logarithmic scale, with random phases."""
    frequency = np.geomspace(m.band[0], m.band[1], 8) * rng.uniform(0.9, 1.1, 8)
    amplitude = np.minimum(0.35 * span, 0.3 * fast / (2.0 * np.pi * frequency))
    phase = rng.uniform(0.0, 2.0 * np.pi, 8)
    return np.sin(2.0 * np.pi * frequency * t[:, None] + phase) @ amplitude


def _walk(
    t: np.ndarray, m: Machine, fast: float, span: float, rng: np.random.Generator
) -> np.ndarray:
    """Smooth motion (polynomials of degree five) between random positions, with pauses."""
    out, start, place = np.zeros(len(t)), STILL + 0.2, 0.0
    while start < t[-1]:
        new = rng.uniform(-0.95, 0.95) * span
        time = max(abs(new - place) * 1.875 / (fast * rng.uniform(0.2, 0.9)), 0.1)
        x = np.clip((t - start) / time, 0.0, 1.0)
        moved = place + (new - place) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        out, place = np.where(t >= start, moved, out), new
        start += time + rng.uniform(0.0, 0.5)
    return out


MAKERS = {
    "chirp": _chirp, "steps": _steps, "ramp": _ramp, "mix": _mix, "multisine": _multisine,
    "walk": _walk,
}  # fmt: skip
