# SPDX-License-Identifier: Apache-2.0
"""Plants that are closed after a test, and the commands they are given."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from loco_control.impedance import ImpedanceParams
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import robot
from loco_sim.params import SimParams
from loco_sim.simulation import Simulation
from loco_sim.world import World


@pytest.fixture(scope="session")
def hyq():
    """The robot HyQ."""
    return robot.load("hyq")


@pytest.fixture
def plant():
    """Function that makes a `Simulation` with changed parameters."""
    made = []

    def make(effects=(), seed=0, impedance=None, dt=0.004, standing=None, **params):
        gains = impedance or ImpedanceParams()
        made.append(Simulation(SimParams(**params), gains, effects, seed, dt, standing=standing))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def world(hyq):
    """HyQ's world, built in the standing pose on the ground."""
    made = World(hyq, SimParams(), 0.001)
    made.rebuild(hyq.standing)
    yield made
    made.close()


@pytest.fixture(scope="session")
def commands(hyq):
    """Function that makes command k of a stepping motion in place, bold but upright."""

    def make(k, amplitude=0.1, stance=True):
        wave = np.sin(2.0 * np.pi * 2.0 * k * 0.004) * np.tile([0.1, 1.0, -2.0], 4)
        q = hyq.standing + amplitude * wave * np.repeat([1, -1, 1, -1], 3)
        tau = np.tile([0.0, -10.0, 20.0], 4) * np.repeat([1, 1, -1, -1], 3)
        flags = np.full(4, stance)
        return (
            MotionCommand(k, k * 0.004, q, np.zeros(12)),
            TrunkTorque(k, k * 0.004, tau, np.zeros(6), flags),
        )

    return make


@pytest.fixture(scope="session")
def run(commands):
    """Function that resets a plant, runs some ticks and gives all states."""

    def make(plant, ticks=40):
        states = [plant.reset()]
        for k in range(ticks):
            states.append(plant.step(*commands(k)))
        return states

    return make


@pytest.fixture(scope="session")
def as_bytes():
    """Function that turns states into bytes, for exact comparisons."""

    def make(states):
        return b"".join(
            np.asarray(getattr(state, f.name)).tobytes() for state in states for f in fields(state)
        )

    return make
