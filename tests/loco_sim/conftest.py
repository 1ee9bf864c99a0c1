# SPDX-License-Identifier: Apache-2.0
"""Plants that are closed after a test, and the commands they are given."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.engines import ENGINES
from loco_sim.params import SimParams
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.world.world import make_world


@pytest.fixture(scope="session")
def hyq():
    """The robot HyQ."""
    return robot.load("hyq")


@pytest.fixture
def plant():
    """Function that makes a `Simulation` with changed parameters."""
    made = []

    def make(effects=(), seed=0, overrides=None, dt=0.004, standing=None, **params):
        hyq = robot.load("hyq", overrides)
        made.append(Simulation(SimParams(**params), effects, seed, dt, hyq, standing))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture(params=ENGINES)
def engine(request):
    """Name of a physics engine: what is asked of the world is asked of each."""
    return request.param


@pytest.fixture
def world(hyq, engine):
    """HyQ's world, built in the standing pose on the ground."""
    made = make_world(hyq, SimParams(engine=engine), 0.001)
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
