# SPDX-License-Identifier: Apache-2.0
"""Stance controller: stance estimate, by gait clock or foot height, and trunk torques.

PSE (predictive) takes the stance of the gait clock; RSE (reactive) takes a leg
to stand while the height of the *commanded* foot, averaged over a window, is
low. Source: thesis 8.2.2, eq. (8.1)-(8.3); threshold, window and hysteresis
are not published and were chosen for loco.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..legs.geometry import HYQ
from ..params import Params, parameter
from ..types import GaitTarget, MotionCommand, RobotState, Stance, TrunkTorque
from .trunk import TrunkController, TrunkParams

ESTIMATORS = ("pse", "rse")
PSE, RSE = range(2)


@dataclass(frozen=True)
class StanceParams(Params):
    """The choice of stance estimator, its start, and the settings of RSE."""

    estimator: str = parameter("pse", "pse: gait clock; rse: commanded foot", choices=ESTIMATORS)
    estimator_start: float = parameter(0.0, "before this time pse is used", "s", low=0.0)
    height_threshold: float = parameter(0.02, "rse: a higher foot swings", "m", low=0.001, high=0.1)
    hysteresis: float = parameter(
        0.25,
        "rse: share of the threshold by which a landing foot must be below it",
        low=0.0,
        high=0.9,
    )
    window: int = parameter(15, "rse: samples of the average height", low=1, high=250)


class HeightEstimator:
    """RSE: moving average of the commanded foot height, with hysteresis.

    Args:
        params: Window, threshold and hysteresis.
    """

    def __init__(self, params: StanceParams):
        from .kernels import average_heights  # loads numba

        self.params, self._average = params, average_heights
        self.reset()

    def reset(self) -> None:
        """Reset the history to zero heights, with all feet on the ground."""
        self._history = np.zeros((self.params.window, 4))
        self._next = 0
        self.stance = np.ones(4, dtype=bool)

    def update(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Average height [m] and stance, each (4,), updated by a new `height` [m], (4,)."""
        p = self.params
        mean, self.stance = self._average(
            self._history, self._next, height, self.stance, p.height_threshold, p.hysteresis
        )
        self._next = (self._next + 1) % p.window
        return mean, self.stance


class StanceController:
    """Stance estimate and trunk torques of one tick.

    Args:
        stance_params: Choice of the stance estimator.
        trunk_params: Gains of the trunk controller.
        dt: Control period [s].
        legs: Geometry, columns named by `legs.geometry.COLUMNS`, (4, 16); default HyQ's.
    """

    def __init__(
        self,
        stance_params: StanceParams,
        trunk_params: TrunkParams,
        dt: float,
        legs: np.ndarray | None = None,
    ):
        from . import kernels as stance_kernels  # loads numba

        self.params, self.dt = stance_params, float(dt)
        self.trunk = TrunkController(trunk_params, legs)
        self._height = HeightEstimator(stance_params)
        self._legs = HYQ if legs is None else legs
        self._foot_heights = stance_kernels.foot_heights
        self.reset()

    def reset(self) -> None:
        """Reset to the estimator of the parameters, without history."""
        self._estimator, self._start = self.params.estimator, self.params.estimator_start
        self._ground: float | None = None
        self._height.reset()
        self.trunk.reset()

    def set_estimator(self, name: str) -> None:
        """Use the estimator `name` from the next step on, regardless of its start time.

        Raises:
            NameUnknownError: There is no such estimator.
        """
        self._estimator, self._start = self.params.replace(estimator=name).estimator, 0.0

    def step(
        self, state: RobotState, target: GaitTarget, command: MotionCommand
    ) -> tuple[Stance, TrunkTorque]:
        """Stance and trunk torque for the tick of `state`; call it once per tick."""
        if self._ground is None:
            # Ground height of the standing posture; set once, as the clock must not affect RSE.
            self._ground = float(target.foot_position[:, 2].min())
        heights = self._foot_heights(command.q, self._ground, self._legs)
        height, low = self._height.update(heights)
        reactive = self._estimator == "rse" and state.t >= self._start - 0.5 * self.dt
        legs = (low if reactive else target.stance).copy()
        stance = Stance(state.tick, state.t, height, legs, RSE if reactive else PSE)
        return stance, self.trunk.step(state, target, legs)
