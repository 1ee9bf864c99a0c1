# SPDX-License-Identifier: Apache-2.0
"""Noise of the sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loco_control.params import parameter
from loco_control.types import RobotState

from ..geometry import multiply
from .base import Effect


def turned(orientation: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Orientation after a small turn about the base axes.

    Args:
        orientation: x y z w, (4,).
        angle: Rotation vector in the base frame [rad], (3,), small.
    """
    norm = float(np.sqrt(4.0 + angle @ angle))
    return np.array(multiply(orientation, (*(angle / norm), 2.0 / norm)))


@dataclass
class SensorNoise(Effect, name="sensor_noise"):
    """White Gaussian noise on each channel, drawn once per control period.

    Every channel is drawn whether it is used or not, so switching one on does not
    change the noise of another.
    """

    q: float = parameter(0.0, "joint position, standard deviation", "rad", low=0.0)
    dq: float = parameter(0.0, "joint velocity, standard deviation", "rad/s", low=0.0)
    tau: float = parameter(0.0, "joint torque, standard deviation", "N·m", low=0.0)
    grf: float = parameter(0.0, "ground reaction force, standard deviation", "N", low=0.0)
    orientation: float = parameter(0.0, "IMU orientation, std. deviation per axis", "rad", low=0.0)
    gyro: float = parameter(0.0, "IMU angular velocity, standard deviation", "rad/s", low=0.0)
    accelerometer: float = parameter(0.0, "IMU specific force, standard deviation", "m/s²", low=0.0)

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def on_measurement(self, state: RobotState) -> RobotState:
        def drawn(like: np.ndarray, std: float) -> np.ndarray:
            return std * self._rng.standard_normal(like.shape)

        q, dq, tau = drawn(state.q, self.q), drawn(state.dq, self.dq), drawn(state.tau, self.tau)
        grf, angle = drawn(state.grf, self.grf), drawn(state.angular_velocity, self.orientation)
        gyro = drawn(state.angular_velocity, self.gyro)
        force = drawn(state.linear_acceleration, self.accelerometer)
        return replace(
            state,
            q=state.q + q,
            dq=state.dq + dq,
            tau=state.tau + tau,
            grf=state.grf + grf,
            orientation=turned(state.orientation, angle) if self.orientation else state.orientation,
            angular_velocity=state.angular_velocity + gyro,
            linear_acceleration=state.linear_acceleration + force,
        )
