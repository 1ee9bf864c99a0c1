# SPDX-License-Identifier: Apache-2.0
"""Imperfections of recordings and models: noise, late stamps, lost samples, model errors."""

from __future__ import annotations

import copy
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from . import slots
from .machines import Machine

if TYPE_CHECKING:
    from .plant import Reading

WAYS = ("", "late", "dropped", "half", "cut")  # recording faults; the first is none
OFF = 1.0 / 3.0  # share of the cases whose model has small errors
LATE = 0.01  # largest delay of a stamp [s]
PERIODS = 2.5  # the same in periods of the readings
DROPPED = 0.05  # share of lost samples
CUT = 1.0  # removed start of a record [s]


@dataclass(frozen=True)
class Condition:
    """Difference between a robot and its model, and fault of its recording.

    Attributes:
        noise: Factor on the sensor noise of the machine.
        way: Recording fault, one of `WAYS`.
        off: Whether all masses, inertias and motors of the model have small errors.
    """

    noise: float = 1.0
    way: str = ""
    off: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Values for a truth file."""
        return asdict(self)


def draw(seed: int) -> Condition:
    """Random condition of a case: one model in three has errors, two logs in six are clean."""
    rng = np.random.default_rng([seed, 8])
    noise = float(rng.choice([0.5, 1.0, 2.0]))
    fault = str(rng.choice(["", *WAYS]))
    return Condition(noise, fault, bool(rng.random() < OFF))


def machine_of(machine: Machine, condition: Condition, seed: int) -> Machine:
    """The actual machine: with its noise, and with deviations from the model if `off` is set."""
    sensors = tuple(replace(s, noise=condition.noise * s.noise) for s in machine.sensors)
    varied = replace(machine, sensors=sensors, torque_noise=condition.noise * machine.torque_noise)
    return _off(varied, seed) if condition.off else varied


def _off(machine: Machine, seed: int) -> Machine:
    rng = np.random.default_rng([seed, 9])
    n = len(machine.joints)
    return altered(machine, *(1.0 + rng.uniform(-most, most, n) for most in machine.off))


def altered(
    machine: Machine,
    heavier: np.ndarray,
    rounder: np.ndarray,
    stronger: np.ndarray,
    faster: np.ndarray | float = 1.0,
) -> Machine:
    """The machine with scaled masses, inertias and motors.

    Args:
        machine: A machine of n joints.
        heavier: Factor on each mass, (n,).
        rounder: Factor on each inertia in addition to the factor of its mass, (n,).
        stronger: Factor on the torque of each drive, (n,).
        faster: Factor on the no-load speed of each servo, in addition to `stronger`, (n,).
    """
    body, drives = copy.deepcopy(machine.body), machine.drives.copy()
    body.mass *= heavier
    body.inertia *= (heavier * rounder)[:, None, None]
    servo = drives[:, 0] == slots.SERVO
    drives[servo, 1] *= stronger[servo]
    drives[servo, 2] *= (stronger**2 / faster)[servo]
    return replace(machine, body=body, drives=drives, motor=np.where(servo, 1.0, stronger))


def recorded(reading: Reading, condition: Condition, seed: int) -> Reading:
    """A reading with the recording fault of the condition."""
    rng = np.random.default_rng([seed, 10])
    rows, stamp = np.ones(len(reading.stamp), dtype=bool), reading.stamp
    if condition.way == "late":
        max_delay = rng.uniform(0.0, min(LATE, PERIODS * np.median(np.diff(stamp))))
        stamp = np.maximum.accumulate(stamp + rng.uniform(0.0, max_delay, len(stamp)))
    elif condition.way == "dropped":
        rows = rng.random(len(rows)) >= DROPPED
    elif condition.way == "half":
        rows = np.arange(len(rows)) % 2 == 0
    keep = np.ones(len(reading.t), dtype=bool)
    if condition.way == "cut":
        rows, keep = stamp >= CUT, reading.t >= CUT
    measured = {"q": reading.q, "tau": reading.tau, "dq": reading.dq}
    told = {"t": reading.t, "command": reading.command, "rate": reading.rate,
            "effort": reading.effort}  # fmt: skip
    return replace(
        reading, stamp=stamp[rows],
        **{name: values[rows] for name, values in measured.items() if values is not None},
        **{name: values[keep] for name, values in told.items() if values is not None},
    )  # fmt: skip
