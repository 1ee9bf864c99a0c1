# SPDX-License-Identifier: Apache-2.0
"""Recordings as robots give them: other noise, late stamps, lost samples; and no model is exact."""

from __future__ import annotations

import copy
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from . import slots
from .machines import Machine

if TYPE_CHECKING:
    from .plant import Reading

WAYS = ("", "late", "dropped", "half", "cut")  # one of them per case; the first is a clean log
OFF = 1.0 / 3.0  # share of the cases whose model is a little off
LATE = 0.01  # largest lateness of a stamp [s]
DROPPED = 0.05  # share of lost samples
CUT = 1.0  # of the beginning [s]
MASS, INERTIA, MOTOR = 0.03, 0.05, 0.03  # largest errors of a model that is a little off


@dataclass(frozen=True)
class Condition:
    """Difference between a robot and its model, and the way it was recorded.

    Attributes:
        noise: Noise of the sensors over that of the machine.
        way: One of `WAYS`.
        off: Whether the model is a little off everywhere.
    """

    noise: float = 1.0
    way: str = ""
    off: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a truth file."""
        return asdict(self)


def draw(seed: int) -> Condition:
    """Condition of a case: one model in three is off, two logs in six are clean."""
    rng = np.random.default_rng([seed, 8])
    noise = float(rng.choice([0.5, 1.0, 2.0]))
    way = str(rng.choice(["", *WAYS]))
    return Condition(noise, way, bool(rng.random() < OFF))


def machine_of(machine: Machine, condition: Condition, seed: int) -> Machine:
    """The machine as it really is: with its noise, and with errors where the model is off."""
    sensors = tuple(replace(s, noise=condition.noise * s.noise) for s in machine.sensors)
    noisy = replace(machine, sensors=sensors, torque_noise=condition.noise * machine.torque_noise)
    return _off(noisy, seed) if condition.off else noisy


def _off(machine: Machine, seed: int) -> Machine:
    rng = np.random.default_rng([seed, 9])
    n = len(machine.joints)
    heavier = 1.0 + rng.uniform(-MASS, MASS, n)
    rounder = 1.0 + rng.uniform(-INERTIA, INERTIA, n)
    return altered(machine, heavier, rounder, 1.0 + rng.uniform(-MOTOR, MOTOR, n))


def altered(
    machine: Machine,
    heavier: np.ndarray,
    rounder: np.ndarray,
    stronger: np.ndarray,
    faster: np.ndarray | float = 1.0,
) -> Machine:
    """The machine with other bodies and motors.

    Args:
        machine: A machine of n joints.
        heavier: Factor on each mass, (n,).
        rounder: Factor on each inertia beside that of its mass, (n,).
        stronger: Factor on the torque of each drive, (n,).
        faster: Factor on the speed without load of each servo beside that, (n,).
    """
    body, drives = copy.deepcopy(machine.body), machine.drives.copy()
    body.mass *= heavier
    body.inertia *= (heavier * rounder)[:, None, None]
    servo = drives[:, 0] == slots.SERVO
    drives[servo, 1] *= stronger[servo]
    drives[servo, 2] *= (stronger**2 / faster)[servo]
    return replace(machine, body=body, drives=drives, motor=np.where(servo, 1.0, stronger))


def recorded(reading: Reading, condition: Condition, seed: int) -> Reading:
    """A reading as it arrives in the log."""
    rng = np.random.default_rng([seed, 10])
    rows, stamp = np.ones(len(reading.stamp), dtype=bool), reading.stamp
    if condition.way == "late":
        most = rng.uniform(0.0, LATE)
        stamp = np.maximum.accumulate(stamp + rng.uniform(0.0, most, len(stamp)))
    elif condition.way == "dropped":
        rows = rng.random(len(rows)) >= DROPPED
    elif condition.way == "half":
        rows = np.arange(len(rows)) % 2 == 0
    told = np.ones(len(reading.t), dtype=bool)
    if condition.way == "cut":
        rows, told = stamp >= CUT, reading.t >= CUT
    return replace(
        reading, t=reading.t[told], command=reading.command[told], rate=reading.rate[told],
        stamp=stamp[rows], q=reading.q[rows],
        tau=None if reading.tau is None else reading.tau[rows],
    )  # fmt: skip
