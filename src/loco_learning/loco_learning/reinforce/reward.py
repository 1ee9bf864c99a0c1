# SPDX-License-Identifier: Apache-2.0
"""Reward of a tick: one formula for the environment, the gradient and the tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from loco_sim.params import SimParams
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ..runs.log import Log
from .params import RewardParams


class Reward:
    """Reward of the ticks of a robot by the formula in `RewardParams`.

    Args:
        params: Prices.
        robot: Robot, for its mass and driven joints.
        sim: Parameters of the plant, for gravity.
    """

    def __init__(self, params: RewardParams, robot: Robot, sim: SimParams):
        self.params, self._driven = params, robot.driven
        self.weight = float(Description(robot.urdf).mass()) * sim.gravity  # [N]

    def tick(self, velocity: Any, dq: Any, tau: Any) -> Any:
        """Reward of a tick, or of each of many.

        Args:
            velocity: Velocity of the base in its own frame [m/s], (..., 3).
            dq: Velocities of all joints [rad/s], (..., n).
            tau: Torques of all joints [N·m], (..., n).

        Returns:
            Reward [-], of shape (...).
        """
        p = self.params
        return (velocity[..., 0] - p.cost * self.power(dq, tau) / self.weight) / p.speed

    def power(self, dq: Any, tau: Any) -> Any:
        """Positive power of the drives [W], of shape (...), from arrays (..., n)."""
        work = dq[..., self._driven] * tau[..., self._driven]
        return np.maximum(work, 0.0).sum(axis=-1)

    def of_log(self, log: Log, ticks: int, discount: float = 1.0) -> float:
        """Return of an episode, eq. (3.18), over the number of its ticks.

        Args:
            log: Ticks in which the readout drove; fewer than `ticks` if the robot fell.
            ticks: Length of a whole episode.
            discount: gamma per tick.

        Returns:
            Sum of gamma^i r_i over the sum of gamma^i, minus the price of a fall.
        """
        weights = discount ** np.arange(ticks)
        earned = self.tick(log.velocity, log.dq, log.tau) if len(log) else np.zeros(0)
        value = float(earned @ weights[: len(log)]) / float(weights.sum())
        return value - (self.params.fall if log.fall else 0.0)
