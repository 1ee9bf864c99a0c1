# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings of a machine with hidden effects."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from zlib import crc32

import numpy as np

from . import hidden, motion, readings, slots
from .engine import Engine
from .hidden import Hidden
from .machines import GRAVITY, Machine

SETTLE = 1.5  # time for which the first command is held before a record begins [s]
QUANTITIES = ("position", "velocity", "effort")  # of a command, in the order of its parts
FINE = 1000.0  # smallest sampling rate of the signals that sensors read [Hz]


@dataclass(frozen=True)
class Reading:
    """The recording of a robot.

    Attributes:
        t: Times of the commands [s], (T,).
        stamp: Stamps of the readings [s], (S,).
        q: Joint sensor readings [rad], (S, n).
        command: Target positions and velocities of the driven joints, (T, m) each.
        tau: Torque sensor readings [N·m], (S, n), or None.
        driven: Names of the driven joints.
        joints: Names of all joints.
        effort: Commanded efforts of the driven joints, (T, m), or None.
        dq: Velocity sensor readings [rad/s], (S, n), or None.
    """

    t: np.ndarray
    stamp: np.ndarray
    q: np.ndarray
    command: np.ndarray
    rate: np.ndarray
    tau: np.ndarray | None
    driven: tuple[str, ...]
    joints: tuple[str, ...]
    effort: np.ndarray | None = None
    dq: np.ndarray | None = None


def truth(
    machine: Machine, effects: Sequence[Hidden], command: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fine time grid [s], encoder positions and velocities on it, mean torque at each tick.

    Args:
        machine: Machine without hidden effects.
        effects: Hidden effects.
        command: Positions, velocities and efforts (0 if left out) of the driven joints at each
            tick, (T, m) each.
    """
    body = copy.deepcopy(machine.body)
    for effect in effects:
        _change(body, effect)
    n, ticks = len(machine.joints), len(command[0])
    full = np.zeros((ticks, 3, n))
    for kind, values in zip(QUANTITIES, command, strict=False):
        if kind in machine.commands:
            full[:, QUANTITIES.index(kind), machine.driven] = values
    dt = 1.0 / (machine.rate * machine.steps)
    every = max(1, int(machine.steps * machine.rate / FINE))
    while machine.steps % every:
        every -= 1
    readings, speed, tau = motion.simulate(
        Engine(body, dt, GRAVITY), packed(machine, body), full,
        _constants(machine, effects), _outside(machine, effects), machine.start,
        (round(max(SETTLE, machine.settle) * machine.rate), machine.steps, dt, every),
    )  # fmt: skip
    return np.arange(len(readings)) * dt * every, readings, speed, tau


def record(
    machine: Machine,
    effects: Sequence[Hidden],
    command: tuple[np.ndarray, ...],
    seed: int,
    name: str = "",
) -> Reading:
    """Recording of a robot that follows a command; `seed` and `name` seed the noise."""
    t, encoders, speed, tau = truth(machine, effects, command)
    rng = np.random.default_rng([seed, crc32(name.encode())])
    ticks = np.arange(len(command[0])) / machine.rate
    when = ticks
    if machine.readings:
        when = np.arange(int(len(ticks) * machine.readings / machine.rate)) / machine.readings
    if machine.jitter:
        when = np.sort(np.clip(when + machine.jitter * rng.standard_normal(len(when)), 0.0, t[-1]))
    q = readings.joints(machine, effects, t, encoders, speed, when, rng)
    dq = readings.speeds(machine, effects, t, encoders, speed, when, rng)
    torque = readings.torques(machine, effects, tau, rng) if machine.torque_noise else None
    driven = tuple(machine.joints[j] for j in machine.driven)
    effort = command[2] if "effort" in machine.commands else None
    return Reading(
        ticks, when, q, command[0], command[1], torque, driven, machine.joints, effort, dq
    )


def _constants(machine: Machine, effects: Sequence[Hidden]) -> np.ndarray:
    """Constants of the hidden laws per joint, including motors that differ from their model."""
    rows = hidden.constants(machine, tuple(effects))
    if machine.motor is not None:
        rows[slots.GAIN, :, 0] = (1.0 + rows[slots.GAIN, :, 0]) * machine.motor - 1.0
    return rows


def _change(body, effect: Hidden) -> None:
    """Apply an effect that changes the rigid bodies."""
    if effect.effect == "payload":
        body.add_point(effect.params["link"], effect.params["mass"], effect.params["position"])
    elif effect.effect == "com_offset":
        body.move_com(effect.params["link"], effect.params["offset"])
    elif effect.effect == "armature":
        for j, name in enumerate(body.joints):
            if fnmatchcase(name, effect.place):
                body.armature[j] += effect.params["inertia"]


def _outside(machine: Machine, effects: Sequence[Hidden]) -> np.ndarray:
    """Row of a push or cable for the compiled simulation; body -1 if there is none."""
    row = np.full(10, -1.0)
    for effect in effects:
        p = effect.params
        if effect.effect not in ("push", "cable_force", "constant_force"):
            continue
        row[0] = machine.body.links.index(p["link"])
        row[2:5] = p["point"]
        if effect.effect != "cable_force":
            during = p.get("start", -np.inf), p.get("stop", np.inf)
            row[1], row[5:8], row[8:] = 0.0, p["force"], during
        else:
            row[1], row[5:8], row[8:] = 1.0, p["anchor"], (p["stiffness"], p["length"])
    return row


def packed(machine: Machine, body) -> motion.Packed:
    """Constants of a machine with a body, for the compiled simulation."""
    return motion.Packed(machine.drives, machine.springs, machine.rest, body.damping)


def joint_inertia(machine: Machine) -> np.ndarray:
    """Inertia of all bodies moved by each joint, in the standing pose [kg·m²], (n,)."""
    return np.diag(Engine(machine.body, 1e-3, GRAVITY).mass(machine.start)).copy()


def loose(machine: Machine) -> Machine:
    """The machine without drives, springs and damping."""
    body = copy.deepcopy(machine.body)
    body.damping[:] = 0.0
    body.lower[:], body.upper[:] = -np.inf, np.inf
    drives, springs = np.zeros_like(machine.drives), np.zeros_like(machine.springs)
    return replace(machine, body=body, drives=drives, springs=springs)


def coarser(machine: Machine) -> Machine:
    """The machine with two thirds of the steps, to measure the integration error."""
    return replace(machine, steps=max(2, 2 * machine.steps // 3))
