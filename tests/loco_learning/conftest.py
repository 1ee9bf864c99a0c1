# SPDX-License-Identifier: Apache-2.0
"""A trot without physics: states and targets with the rhythm of the real ones."""

import numpy as np
import pytest

from loco_control.types import GaitTarget, RobotState
from loco_learning.experiment import load
from loco_learning.rollout import rollout

DT = 0.004


def state_at(tick: int, force: float = 415.7) -> RobotState:
    """Diagonal pairs that carry the weight in turns, at 1.7 Hz from 0.1 s on."""
    t = tick * DT
    angle = 2.0 * np.pi * 1.7 * max(t - 0.1, 0.0)
    load = np.clip(0.5 + 2.0 * np.sin(angle + np.array([0.0, np.pi, np.pi, 0.0])), 0.0, 1.0)
    grf = np.zeros((4, 3))
    grf[:, 2] = force * load
    zero = np.zeros(12)
    orientation = np.array([0.0, 0.0, 0.0, 1.0])
    return RobotState(
        tick, t, zero, zero, zero, grf, orientation, np.zeros(3), np.zeros(3), load > 0.1
    )


def target_at(tick: int) -> GaitTarget:
    """Joint sines of the same rhythm with a second harmonic."""
    t = tick * DT
    angle = 2.0 * np.pi * 1.7 * max(t - 0.1, 0.0) + np.arange(12)
    q = 0.3 * np.sin(angle) + 0.1 * np.cos(2.0 * angle)
    dq = 2.0 * np.pi * 1.7 * (0.3 * np.cos(angle) - 0.2 * np.sin(2.0 * angle))
    feet = np.zeros((4, 3))
    phase = (1.7 * t + np.array([0.0, 0.5, 0.5, 0.0])) % 1.0
    return GaitTarget(tick, t, q, dq, feet, feet, phase, 0.25, 1.7, phase < 0.5)


@pytest.fixture
def drive():
    """Function that runs a network over ticks [start, stop) of the fake trot."""

    def run(network, start, stop, force=415.7):
        return [network.step(state_at(k, force), target_at(k)) for k in range(start, stop)]

    return run


@pytest.fixture(scope="session")
def short_log():
    """Log of the experiment hyq_short; do not change it."""
    return rollout(load("hyq_short"))
