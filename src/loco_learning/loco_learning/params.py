# SPDX-License-Identifier: Apache-2.0
"""Parameters of the reflex network and of the failure criterion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter

PHASES = ("stand", "train", "closing", "test")
OPEN = "open loop"  # name of the phase "train" if nothing is trained
# HFE and KFE of each leg, leg-major; HAA always follows the target.
OUTPUT_JOINTS = np.array([1, 2, 4, 5, 7, 8, 10, 11])
ACTIVATIONS = ("tanh", "relu")
SCALINGS = ("plateau", "author")
# Sensors of a joint reflex by the value of `inputs`: kinds of `joint_sensors.KINDS`.
INPUTS = {"all": ("joint", "gyro", "tilt"), "joints": ("joint",), "imu": ("gyro", "tilt")}


class PhasedParams(Params):
    """The parameters common to all networks: lengths of the phases, as fields named like them."""

    enabled: bool
    weights: str
    closing_block: int
    memory: int
    neurons: int
    activation: str
    regularisation: float
    hidden_bias: float
    phases_when_off: ClassVar[bool]  # whether time has phases without a network too

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.duration <= 0.0:
            raise ParameterError("stand + train + closing + test must last longer than 0 s")

    @property
    def durations(self) -> dict[str, float]:
        """Length of each phase [s], in the order of `PHASES`."""
        return {phase: getattr(self, phase) for phase in PHASES}

    @property
    def duration(self) -> float:
        """Length of all phases together [s]."""
        return sum(self.durations.values())


@dataclass(frozen=True)
class LearnerParams(PhasedParams):
    """Shape, scaling and schedule of the reflex network.

    Two scalings exist. ``plateau`` divides each force by `grf_scale`, so that a
    leg that carries half the robot reads 1, and draws the hidden weights for
    the fan-in; it works over a wide range of settings. ``author`` is the
    running min-max scaling of inputs, hidden inputs and targets found in the
    thesis author's code; it is fragile (see ``hyq_author_scaling``).

    With `weights` the readout is loaded and not changed: during ``train`` the
    target drives while the delay line fills, and ``test`` runs with the loaded weights.
    """

    phases_when_off: ClassVar[bool] = True

    enabled: bool = parameter(True, "false: the target always drives (open loop)")
    memory: int = parameter(80, "delay-line length M", "tick", 1, 1000)
    neurons: int = parameter(80, "hidden neurons N", "-", 1, 5000)
    activation: str = parameter("tanh", "hidden activation", choices=ACTIVATIONS)
    scaling: str = parameter("plateau", "input, hidden and target scaling", choices=SCALINGS)
    regularisation: float = parameter(1e-3, "alpha of RLS, P starts at I/alpha", "-", 1e-12, 1e6)
    gain: float = parameter(1.0, "factor on the hidden weights", "-", 0.0, 100.0)
    hidden_bias: float = parameter(0.0, "hidden bias is uniform in [-b, b]", "-", 0.0, 100.0)
    bias_input: bool = parameter(True, "a constant input beside the four forces (eq. 7.2)")
    window: int = parameter(15, "moving average of the vertical forces", "tick", 1, 1000)
    grf_scale: float = parameter(415.7, "force that is scaled to 1: half the weight", "N", 1.0, 1e5)
    grf_threshold: float = parameter(0.0, "smaller averaged forces count as 0", "N", 0.0, 1e4)
    stand: float = parameter(1.0, "phase: standing, delay line fills", "s", 0.0, 1e5)
    train: float = parameter(15.0, "phase: target drives, readout learns", "s", 0.0, 1e5)
    closing: float = parameter(15.0, "phase: prediction drives, learning fades", "s", 0.0, 1e5)
    test: float = parameter(15.0, "phase: prediction drives, readout frozen", "s", 0.0, 1e5)
    closing_block: int = parameter(10, "block length while learning fades out", "tick", 1, 10000)
    weights: str = parameter("", "file with trained weights; empty: learn them", "path")


@dataclass(frozen=True)
class JointLearnerParams(PhasedParams):
    """Shape, scaling and schedule of a joint reflex.

    Each sensor reads (value - centre) / scale, clipped to [-limit, limit]: fixed numbers
    per kind of sensor, so that nothing depends on the first readings.
    With `weights` the readout is loaded and not changed.
    """

    phases_when_off: ClassVar[bool] = False

    enabled: bool = parameter(False, "false: the target always drives (open loop)")
    inputs: str = parameter("all", "sensors that are inputs", choices=tuple(INPUTS))
    memory: int = parameter(50, "delay-line length M", "tick", 1, 1000)
    window: int = parameter(1, "moving average of the sensors", "tick", 1, 1000)
    neurons: int = parameter(200, "hidden neurons N", "-", 1, 5000)
    activation: str = parameter("tanh", "hidden activation", choices=ACTIVATIONS)
    regularisation: float = parameter(5.0, "alpha of RLS, P starts at I/alpha", "-", 1e-12, 1e6)
    gain: float = parameter(1.0, "factor on the hidden weights", "-", 0.0, 100.0)
    hidden_bias: float = parameter(1.0, "hidden bias is uniform in [-b, b]", "-", 0.0, 100.0)
    joint_centre: float = parameter(1.0, "passive joint angle scaled to 0", "rad", -10.0, 10.0)
    joint_scale: float = parameter(0.3, "angle from the centre scaled to 1", "rad", 1e-6, 1e3)
    gyro_scale: float = parameter(3.0, "turning rate scaled to 1", "rad/s", 1e-6, 1e3)
    tilt_scale: float = parameter(0.3, "roll or pitch scaled to 1", "rad", 1e-6, 1e3)
    limit: float = parameter(2.0, "scaled sensors are clipped to ± this", "-", 0.1, 100.0)
    stand: float = parameter(1.0, "phase: no learning, delay line fills", "s", 0.0, 1e5)
    train: float = parameter(20.0, "phase: target drives, readout learns", "s", 0.0, 1e5)
    closing: float = parameter(20.0, "phase: prediction drives, learning fades", "s", 0.0, 1e5)
    test: float = parameter(30.0, "phase: prediction drives, readout frozen", "s", 0.0, 1e5)
    closing_block: int = parameter(10, "block length while learning fades out", "tick", 1, 10000)
    weights: str = parameter("", "file with trained weights; empty: learn them", "path")

    def centre_and_scale(self, kind: str) -> tuple[float, float]:
        """Value at which a sensor of a kind reads 0, and distance from it at which it reads 1."""
        return {
            "joint": (self.joint_centre, self.joint_scale),
            "gyro": (0.0, self.gyro_scale),
            "tilt": (0.0, self.tilt_scale),
        }[kind]


@dataclass(frozen=True)
class CriterionParams(Params):
    """When a trial counts as failed; each bound is reported on its own.

    All but the fall are checked while the prediction drives, in closing and test.
    A sine that lags its target by an angle a has an NRMSE of sin(a/2)/sqrt(2): the
    default bound of 0.3 is a lag of 50 degrees, or a seventh of a stride.
    """

    fall: bool = parameter(True, "a fall in any phase is a failure")
    phase_slip: float = parameter(1.0, "largest lag behind the target", "stride", 0.0, 1e3)
    freeze: float = parameter(0.2, "smallest stride amplitude over the target's", "-", 0.0, 1.0)
    nrmse: float = parameter(0.3, "largest NRMSE smoothed over one stride", "-", 0.0, 1e3)
