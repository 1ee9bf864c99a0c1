# SPDX-License-Identifier: Apache-2.0
"""Gives a model the commands that a robot was given, and listens to the same sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loco_sim.joint_commands import JointCommands
from loco_sim.model import Model
from loco_sim.simulation import Simulation

from ..joint_sensors import passive_joints


@dataclass(frozen=True)
class Replay:
    """What the model did.

    Attributes:
        t: Times on the recording's clock [s], (T,).
        q: Measured angles of the passive joints [rad], (T, J).
        fall: Why the model counts as fallen, empty when it does not.
        distance: Way of the base along x [m].
    """

    t: np.ndarray
    q: np.ndarray
    fall: str
    distance: float


def replay(model: Model, t: np.ndarray, command: np.ndarray, seed: int = 0) -> Replay:
    """Run a model from standing with recorded commands.

    A fall does not end it: the sensors of a fallen model tell that it is wrong.

    Args:
        model: Robot, overrides and effects.
        t: Times of the commands [s], even, (T,).
        command: Commands of the driven joints [rad], (T, m).
        seed: Of the effects.

    Raises:
        ParameterError: The body cannot be built, or the rate does not fit the physics.
        DivergedError: The state is no longer finite.
    """
    robot = model.make_robot()
    dt = 1.0 / round(1.0 / float(t[1] - t[0]), 3)  # stamps are rounded, rates are not
    listened, commands = passive_joints(robot), JointCommands(robot)
    q, still = np.empty((len(t), len(listened))), np.zeros(command.shape[1])
    with Simulation(None, None, model.make_effects(), seed, dt, robot) as sim:
        state = sim.reset()
        for row, wanted in enumerate(command):
            q[row] = state.q[listened]
            state = sim.step(*commands(row, row * dt, wanted, still))
        return Replay(t, q, sim.fallen or "", float(sim.ground_truth().position[0]))
