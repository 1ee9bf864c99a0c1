# SPDX-License-Identifier: Apache-2.0
"""Sensor noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from loco_control.params import parameter

from ... import lazy
from ...geometry import multiply
from ..base import Effect
from ..identity import SENSOR_SIGNALS, Identity, LookAlike, Prior
from ..readings import Layout, Measuring

reading_laws = lazy.module("loco_sim.effects.reading_laws")


def rotate(orientation: Sequence[float], angle: np.ndarray) -> np.ndarray:
    """Orientation after a small rotation about the base axes.

    Args:
        orientation: x y z w, (4,).
        angle: Rotation vector in the base frame [rad], (3,), small.
    """
    norm = sqrt(4.0 + angle @ angle)
    x, y, z = angle.tolist()
    return np.array(multiply(orientation, (x / norm, y / norm, z / norm, 2.0 / norm)))


@dataclass
class SensorNoise(Measuring, Effect, name="sensor_noise"):
    """White Gaussian noise on each channel, drawn once per control period.

    All channels are drawn, used or not, so that switching one on does not
    change the noise of another.
    """

    q: float = parameter(0.0, "joint position, standard deviation", "rad", 0.0, 1.0)
    dq: float = parameter(0.0, "joint velocity, standard deviation", "rad/s", 0.0, 100.0)
    tau: float = parameter(0.0, "joint torque, standard deviation", "N·m", 0.0, 200.0)
    grf: float = parameter(0.0, "ground reaction force, standard deviation", "N", 0.0, 1000.0)
    orientation: float = parameter(0.0, "IMU orientation, std. deviation per axis", "rad", 0.0, 1.0)
    gyro: float = parameter(0.0, "IMU angular velocity, standard deviation", "rad/s", 0.0, 10.0)
    accelerometer: float = parameter(
        0.0, "IMU specific force, standard deviation", "m/s²", 0.0, 100.0
    )

    draws = True
    identity = Identity(
        site="sensor",
        equation="y <- y + std w, w white and normal; orientation <- orientation R(std w)",
        priors={
            "q": Prior(1e-4, 1e-3, 0.02),
            "dq": Prior(1e-3, 0.02, 0.5),
            "tau": Prior(1e-3, 0.05, 2.0),
            "grf": Prior(0.01, 1.0, 20.0),
            "orientation": Prior(1e-4, 3e-3, 0.03),
            "gyro": Prior(1e-3, 0.01, 0.1),
            "accelerometer": Prior(0.01, 0.1, 1.0),
        },
        strengths=("q", "dq", "tau", "grf", "orientation", "gyro", "accelerometer"),
        source="Woodman 2007, An introduction to inertial navigation, UCAM-CL-TR-696",
        look_alikes=(
            LookAlike("quantisation", "hold still: noise varies, a quantised reading does not"),
            LookAlike("push", "two sensors of one motion: a push shows in both"),
        ),
        touches=SENSOR_SIGNALS,
        noise=True,
        untried="noise is in the floor of each channel, and no prediction can follow it",
    )

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._std: np.ndarray | None = None

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if self._std is None:
            stds = self.q, self.dq, self.tau, self.grf, 0.0, self.gyro, self.accelerometer
            self._std = np.concatenate(
                [
                    np.full(at[name].stop - at[name].start, std)
                    for name, std in zip(SENSOR_SIGNALS, stds, strict=True)
                ]
            )
        # The order must never change: it determines the noise of every run.
        drawn, first = self._rng.standard_normal(at.size - 1), at["orientation"].start
        reading_laws.add_noise(values, self._std, drawn, first)
        if self.orientation:
            angle = self.orientation * drawn[first : first + 3]
            values[first : first + 4] = rotate(values[first : first + 4].tolist(), angle)
