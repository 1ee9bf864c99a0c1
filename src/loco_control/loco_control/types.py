# SPDX-License-Identifier: Apache-2.0
"""Messages of one tick as plain dataclasses of arrays.

Each class has a message of the same name and the same fields in ``loco_msgs``
(a test compares them). ``tick`` counts control periods from 0 and ``t`` is
simulated time [s]; in the messages ``t`` travels as ``stamp``.
Arrays over joints have shape (12,) and follow `loco_control.names.JOINTS`;
arrays over legs have shape (4,) or (4, 3) and follow `LEGS`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class RobotState:
    """Measurements of the robot at the start of tick `tick`."""

    tick: int
    t: float  # [s]
    q: np.ndarray  # joint position [rad], (12,)
    dq: np.ndarray  # joint velocity [rad/s], (12,)
    tau: np.ndarray  # joint torque, mean over the last control period [N·m], (12,)
    grf: np.ndarray  # ground reaction force on each foot, world frame [N], (4, 3)
    orientation: np.ndarray  # IMU, base to world, x y z w [-], (4,)
    angular_velocity: np.ndarray  # IMU, base frame [rad/s], (3,)
    linear_acceleration: np.ndarray  # IMU specific force, base frame, +g at rest [m/s²], (3,)
    contact: np.ndarray  # foot touches the ground, (4,) bool


@dataclass
class GroundTruth:
    """True state of the robot, known only to the simulator; controllers do not use it."""

    tick: int
    t: float  # [s]
    position: np.ndarray  # base origin in world [m], (3,)
    orientation: np.ndarray  # base to world, x y z w [-], (4,)
    linear_velocity: np.ndarray  # base origin, base frame [m/s], (3,)
    angular_velocity: np.ndarray  # base frame [rad/s], (3,)


@dataclass
class GaitTarget:
    """References of the target generator at tick `tick`."""

    tick: int
    t: float  # [s]
    q: np.ndarray  # joint position [rad], (12,)
    dq: np.ndarray  # joint velocity [rad/s], (12,)
    foot_position: np.ndarray  # base frame, horizontal with kinematic adjustment [m], (4, 3)
    foot_velocity: np.ndarray  # in the same frame [m/s], (4, 3)
    phase: np.ndarray  # stride phase, 0 at touchdown [-], in [0, 1), (4,)
    speed: float  # requested forward speed, smoothed [m/s]
    frequency: float  # requested stride frequency, smoothed [Hz]
    stance: np.ndarray  # stance according to the gait clock, (4,) bool


@dataclass
class MotionCommand:
    """Joint references for the impedance loop of the plant."""

    tick: int
    t: float  # [s]
    q: np.ndarray  # joint position [rad], (12,)
    dq: np.ndarray  # joint velocity [rad/s], (12,)


@dataclass
class Stance:
    """Estimated stance of each leg, and the estimator used."""

    tick: int
    t: float  # [s]
    foot_height: np.ndarray  # mean height of the commanded foot above its stance height [m], (4,)
    stance: np.ndarray  # leg is in stance, (4,) bool
    estimator: int  # index in `loco_control.stance.controller.ESTIMATORS`


@dataclass
class TrunkTorque:
    """Feed-forward torque of the trunk controller, and the stance legs."""

    tick: int
    t: float  # [s]
    tau: np.ndarray  # joint torque [N·m], (12,); zero for swing legs
    wrench: np.ndarray  # desired at the trunk, horizontal frame, force then moment [N, N·m], (6,)
    stance: np.ndarray  # (4,) bool; selects stance or swing gains in the plant


@dataclass
class LearningState:
    """State of the reflex network at tick `tick`."""

    tick: int
    t: float  # [s]
    prediction: np.ndarray  # HFE, KFE positions [rad] then velocities [rad/s], leg-major, (16,)
    error: float  # RMS of prediction minus target over the 8 positions [rad]
    weight_norm: float  # Frobenius norm of the readout [-]
    phase: int  # index in `loco_learning.reflex.network.PHASES`
    driving: bool  # whether `motion_command` carries the prediction instead of the target
    learning: bool  # whether the readout was updated at this tick
