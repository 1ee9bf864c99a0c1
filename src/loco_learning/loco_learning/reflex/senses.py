# SPDX-License-Identifier: Apache-2.0
"""Sensors of a reflex network: the forces on four feet, or passive joints and an IMU.

Both convert raw sensor values to a sample of the delay line, and define the range of the hidden
weights, the initial readout and its units, since these depend on the scaling.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

import numpy as np
from numba import njit

from loco_control.exceptions import ParameterError

from ..params import INPUTS, OUTPUT_JOINTS, JointLearnerParams, LearnerParams
from .reservoir import GrfFilter
from .scaling import SCALING, Unscaled


class FootForces:
    """Vertical forces on four feet [N], averaged, then scaled by `LearnerParams.scaling`.

    Source: thesis section 7.2.2, eq. (7.1) and (7.2).
    """

    KIND = "weights"  # key in `archive.FORMATS`
    PARAMS = LearnerParams
    # Parameters that must agree to reuse weights:
    SHAPING = ("memory", "neurons", "activation", "scaling", "window", "bias_input")
    TRAINED = ("hidden", "readout", "scaling")  # parts that training changes; the rest is state

    def __init__(self, params: LearnerParams):
        self.scaling = SCALING[params.scaling](params)
        self.grf_filter = GrfFilter(params.window, params.grf_threshold)
        self.size, self.width = self.scaling.inputs, self.scaling.weight_width
        self.outputs = OUTPUT_JOINTS
        self.first_weights, self.hidden = self.scaling.first_weights, self.scaling.hidden
        self.fit_target, self.output = self.scaling.fit_target, self.scaling.output

    def reset(self) -> None:
        """Reset the state."""
        self.grf_filter.reset()
        self.scaling.reset()

    def sample(self, felt: np.ndarray, learning: bool) -> np.ndarray:
        """Sample of the delay line, (size,), from forces (4,) [N]."""
        return self.scaling.sample(self.grf_filter.step(felt), learning)

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()` to save, by name."""
        return {"scaling": self.scaling, "grf_filter": self.grf_filter}

    def about(self) -> dict[str, Any]:
        """Properties of the sensors for a weight file."""
        return {}

    @classmethod
    def remade(cls, params: LearnerParams, about: dict[str, Any]) -> FootForces:
        """Sensors with the properties `about` of a weight file."""
        return cls(params)


class BodySensors(Unscaled):
    """Passive joints, gyro and tilt, each centred, scaled and clipped, then averaged.

    Args:
        params: Choice of the sensors, and their scales.
        sensors: Kind of each sensor, from `joint_sensors.sensor_kinds`, (s,).
        count: Number of driven joints, all of which the network moves.

    Raises:
        ParameterError: The robot has none of the sensors in `params.inputs`.
    """

    KIND = "joint_weights"
    PARAMS = JointLearnerParams
    SHAPING = ("inputs", "memory", "window", "neurons", "activation",
               "joint_centre", "joint_scale", "gyro_scale", "tilt_scale", "limit")  # fmt: skip
    TRAINED = ("hidden", "readout")

    def __init__(self, params: JointLearnerParams, sensors: Sequence[str], count: int):
        self.sensors, self.outputs, self._limit = tuple(sensors), np.arange(count), params.limit
        if not params.enabled:
            return
        self._indices, self._centre, self._factor = select(params, self.sensors)
        self.size = len(self._indices) + 1  # with a constant
        self.width = 0.5 * params.gain * sqrt(12.0 / (self.size * params.memory))
        self.average = GrfFilter(params.window, 0.0, self.size)
        self._sample = np.ones(self.size)  # the last element is the constant

    def first_weights(self, params: JointLearnerParams, rng: np.random.Generator) -> None:
        """Readout before training: zero."""

    def reset(self) -> None:
        """Reset the state."""
        self.average.reset()

    def sample(self, felt: np.ndarray, learning: bool) -> np.ndarray:
        """Sample of the delay line from the sensors, as in `joint_sensors.sensor_vector`."""
        scaled(felt, self._indices, self._centre, self._factor, self._limit, self._sample)
        return self.average.step(self._sample)

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()` to save, by name."""
        return {"average": self.average}

    def about(self) -> dict[str, Any]:
        """Properties of the sensors for a weight file."""
        return {"sensors": list(self.sensors), "outputs": len(self.outputs)}

    @classmethod
    def remade(cls, params: JointLearnerParams, about: dict[str, Any]) -> BodySensors:
        """Sensors with the properties `about` of a weight file."""
        return cls(params, about["sensors"], about["outputs"])


Senses = FootForces | BodySensors


def select(
    params: JointLearnerParams, sensors: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the selected sensors, their centres, and inverse scales, (s,) each."""
    indices = [i for i, kind in enumerate(sensors) if kind in INPUTS[params.inputs]]
    if not indices:
        raise ParameterError(
            f"learner.inputs is {params.inputs!r}, but of the sensors of this robot "
            f"({', '.join(sensors) or 'none'}) none is of that kind"
        )
    centre, scale = np.array([params.centre_and_scale(sensors[i]) for i in indices]).T
    return np.array(indices), centre, 1.0 / scale


@njit(cache=True)
def scaled(values, indices, centre, factor, limit, sample):
    """Write the selected values, centred, scaled and clipped, to the first elements of `sample`."""
    for i, j in enumerate(indices):
        sample[i] = min(max((values[j] - centre[i]) * factor[i], -limit), limit)
