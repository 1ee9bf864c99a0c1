# SPDX-License-Identifier: Apache-2.0
"""A machine with something hidden in it, and what its sensors say when it is moved."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import NamedTuple
from zlib import crc32

import numpy as np

from . import bodies, hidden, machines, readings
from .hidden import Hidden
from .machines import GRAVITY, Machine

SETTLE = 1.5  # for which the first command is held before a record begins [s]
FINE = 1000.0  # rows per second of what sensors may look back on [Hz], at least


@dataclass(frozen=True)
class Reading:
    """What a robot would record.

    Attributes:
        t: Times of the ticks [s], (T,).
        q: Joint sensors [rad], (T, n).
        command: Positions, velocities wanted of the driven joints, (T, m) each.
        tau: Torque sensors [N·m], (T, n), or None.
        driven: Names of the driven joints.
        joints: Names of all joints.
    """

    t: np.ndarray
    q: np.ndarray
    command: np.ndarray
    rate: np.ndarray
    tau: np.ndarray | None
    driven: tuple[str, ...]
    joints: tuple[str, ...]


def truth(
    machine: Machine, effects: Sequence[Hidden], command: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fine times [s], encoder positions and velocities there, mean torque at each tick.

    Args:
        machine: As it should be.
        effects: What is hidden in it.
        command: Positions and velocities of the driven joints at each tick, (T, m) each.
    """
    from . import motion

    body = copy.deepcopy(machine.body)
    for effect in effects:
        _change(body, effect)
    n, ticks = len(machine.joints), len(command[0])
    full = np.zeros((ticks, 3, n))
    full[:, 0, machine.driven], full[:, 1, machine.driven] = command
    dt = 1.0 / (machine.rate * machine.steps)
    every = max(1, int(machine.steps * machine.rate / FINE))
    while machine.steps % every:
        every -= 1
    seen, speed, tau = motion.simulate(
        packed(machine, body), full, hidden.constants(machine, tuple(effects)),
        _outside(machine, effects), machine.start, round(SETTLE * machine.rate), machine.steps,
        dt, every,
    )  # fmt: skip
    return np.arange(len(seen)) * dt * every, seen, speed, tau


def record(
    machine: Machine,
    effects: Sequence[Hidden],
    command: tuple[np.ndarray, np.ndarray],
    seed: int,
    name: str = "",
) -> Reading:
    """What the robot records when it is moved; `seed` and `name` key the noise."""
    t, seen, speed, tau = truth(machine, effects, command)
    rng = np.random.default_rng([seed, crc32(name.encode())])
    ticks = np.arange(len(command[0])) / machine.rate
    q = readings.joints(machine, effects, t, seen, speed, ticks, rng)
    torque = readings.torques(machine, effects, tau, rng) if machine.torque_noise else None
    driven = tuple(machine.joints[j] for j in machine.driven)
    return Reading(ticks, q, command[0], command[1], torque, driven, machine.joints)


def _change(body, effect: Hidden) -> None:
    """Effects that are built into the body."""
    if effect.effect == "payload":
        body.add_point(effect.params["link"], effect.params["mass"], effect.params["position"])
    elif effect.effect == "com_offset":
        body.move_com(effect.params["link"], effect.params["offset"])
    elif effect.effect == "armature":
        for j, name in enumerate(body.joints):
            if fnmatchcase(name, effect.place):
                body.armature[j] += effect.params["inertia"]


def _outside(machine: Machine, effects: Sequence[Hidden]) -> np.ndarray:
    """Row of a push or cable for the kernel; body -1 when there is none."""
    row = np.full(10, -1.0)
    for effect in effects:
        p = effect.params
        if effect.effect not in ("push", "cable_force"):
            continue
        row[0] = machine.body.links.index(p["link"])
        row[2:5] = p["point"]
        if effect.effect == "push":
            row[1], row[5:8], row[8:] = 0.0, p["force"], (p["start"], p["stop"])
        else:
            row[1], row[5:8], row[8:] = 1.0, p["anchor"], (p["stiffness"], p["length"])
    return row


class Packed(NamedTuple):
    """A machine for the kernel, n joints."""

    body: bodies.Body
    drives: np.ndarray  # (n, slots.DRIVE)
    springs: np.ndarray  # (n, slots.SPRING)
    rest: np.ndarray  # positions from which hidden springs and stops count [rad], (n,)
    gravity: float  # downwards [m/s²]


def packed(machine: Machine, body) -> Packed:
    """A machine with a body, for the kernel."""
    return Packed(bodies.of(body), machine.drives, machine.springs, machine.rest, GRAVITY)


def joint_inertia(machine: Machine) -> np.ndarray:
    """Inertia of all that hangs on each joint, in the standing pose [kg·m²], (n,)."""
    if machines.MACHINES.get(machine.name):
        return _inertia(machine.name)
    return _diagonal(machine)


@lru_cache
def _inertia(name: str) -> np.ndarray:
    return _diagonal(machines.get(name))


def _diagonal(machine: Machine) -> np.ndarray:
    body = bodies.of(machine.body)
    bodies.poses(machine.start, body)
    bodies.mass_matrix(body)
    return np.diag(body.mass).copy()


def loose(machine: Machine) -> Machine:
    """The machine without drives, springs and damping."""
    body = copy.deepcopy(machine.body)
    body.damping[:] = 0.0
    body.lower[:], body.upper[:] = -np.inf, np.inf
    drives, springs = np.zeros_like(machine.drives), np.zeros_like(machine.springs)
    return replace(machine, body=body, drives=drives, springs=springs)


def coarser(machine: Machine) -> Machine:
    """The same machine with two thirds of the steps: for what integration alone changes."""
    return replace(machine, steps=max(2, 2 * machine.steps // 3))
