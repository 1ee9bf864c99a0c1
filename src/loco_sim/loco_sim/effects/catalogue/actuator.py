# SPDX-License-Identifier: Apache-2.0
"""Effects of the drives: lag, limits, supply, torque constant, backlash, elasticity, offset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from ... import lazy
from .. import rows
from ..chain import DriveEffect, JointEffect, MotorEffect
from ..identity import Identity, LookAlike, Prior
from ..readings import Layout, Measuring

reading_laws = lazy.module("loco_sim.effects.reading_laws")

_DC_MOTOR = (
    "Tan, Zhang, Coumans, Iscen, Bai, Hafner, Bohez, Vanhoucke 2018, Sim-to-real: learning "
    "agile locomotion for quadruped robots, RSS (motor model)"
)


@dataclass
class ActuatorLag(DriveEffect, name="actuator_lag"):
    """The torque follows the command of the drive with a first-order lag, solved exactly."""

    time: float = parameter(0.0, "time constant", "s", low=0.0, high=1.0)
    law, among = rows.LAG, "driven"

    identity = Identity(
        site="actuator",
        kind="delay",
        equation="time dtau/dt = tau_drive - tau",
        priors={"time": Prior(0.002, 0.01, 0.1)},
        source="Hwangbo, Lee, Dosovitskiy, Bellicoso, Tsounis, Koltun, Hutter 2019, Learning "
        "agile and dynamic motor skills for legged robots, Science Robotics 4(26)",
        look_alikes=(
            LookAlike("actuation_delay", "chirp: a delay does not change "
                                         "the amplitude at any frequency"),
            LookAlike("series_elasticity", "load a resting joint: a lag does not deflect"),
            LookAlike("armature", "torque off: inertia still acts, a lag does not"),
        ),
        touches=("drive",),
    )  # fmt: skip

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        if self.time <= 0.0:
            return 0.0, 0.0
        steps = world.dt / self.time
        return np.exp(-steps), -np.expm1(-steps) / steps


@dataclass
class Limiting(MotorEffect):
    """Base of limits of the torque, which are shares of the limit that a drive has without them.

    In a geared servo they act on the motor, before rotor and gear.
    """

    rated: float = parameter(0.0, "effort: the limit without it; 0: as in the URDF", "N·m", 0.0)
    among = "driven"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.rated:
            self.among = "limited"

    def effort(self, world: Any, joints: np.ndarray) -> np.ndarray:
        """Limit of each joint without the effect [N·m or N], (k,)."""
        return np.full(len(joints), self.rated) if self.rated else world.robot.effort[joints]


@dataclass
class TorqueLimit(Limiting, name="torque_limit"):
    """The torque limit of the drive is below that of the robot's description.

    In a geared servo it acts on the motor, before rotor and gear.
    """

    reduction: float = parameter(0.0, "share of the limit that is missing", "-", 0.0, 1.0)
    law = rows.LIMIT

    identity = Identity(
        site="actuator",
        equation="|tau| <= (1 - reduction) effort",
        priors={"reduction": Prior(0.05, 0.3, 0.8)},
        source="Siciliano, Sciavicco, Villani, Oriolo 2009, Robotics, section 5.2 (saturation of "
        "drives)",
        look_alikes=(
            LookAlike("torque_speed_line", "large step from rest: the "
                                           "line limits only moving joints"),
            LookAlike("supply_sag", "move one joint alone: the supply does not sag"),
            LookAlike("spring_saturation", "torque off: the spring still saturates"),
        ),
        touches=("drive",),
        smooth=False,
    )  # fmt: skip

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return ((1.0 - self.reduction) * self.effort(world, joints),)

    def amount(self, robot: Any) -> str:
        effort = self.rated
        if not effort and robot is not None and self.joint in robot.joints:
            effort = robot.effort[robot.joints.index(self.joint)]
        limit = (1.0 - self.reduction) * effort
        return f"the limit is {limit:.3g} N·m" if 0.0 < effort < np.inf else ""


@dataclass
class TorqueSpeedLine(Limiting, name="torque_speed_line"):
    """The driving torque available decreases linearly with the joint speed.

    Braking is not limited. In a geared servo it acts on the motor, before rotor and gear.
    """

    slope: float = parameter(0.0, "one over the speed without load", "s/rad", 0.0, 10.0)
    law = rows.SPEED_LINE

    identity = Identity(
        site="actuator",
        equation="|tau| <= effort (1 - slope |dq|) while tau dq > 0",
        priors={"slope": Prior(0.01, 0.05, 0.2)},
        source=_DC_MOTOR,
        look_alikes=(
            LookAlike("torque_limit", "large step from rest: a limit acts even without motion"),
            LookAlike("viscous_friction", "small fast motions: the torque stays below the line"),
            LookAlike("supply_sag", "one joint alone at full speed: the supply does not sag"),
        ),
        touches=("drive",),
        smooth=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.effort(world, joints), self.slope


@dataclass
class SupplySag(MotorEffect, name="supply_sag"):
    """The supply voltage, and with it every torque, decreases with the load of all drives.

    In a geared servo it acts on the motor, before rotor and gear.
    """

    sag: float = parameter(0.0, "share lost when all joints are at their limit", "-", 0.0, 1.0)
    law, among, shared = rows.SAG, "limited", True

    identity = Identity(
        site="actuator",
        equation="tau_j <- tau_j (1 - sag mean_i |tau_i| / effort_i)",
        priors={"sag": Prior(0.05, 0.2, 0.6)},
        source=_DC_MOTOR,
        look_alikes=(
            LookAlike("torque_constant_error", "load the other joints: a constant is the same"),
            LookAlike("torque_limit", "small torques: the supply sags there too"),
        ),
        touches=("drive",),
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return world.robot.effort[joints], self.sag


@dataclass
class TorqueConstantError(MotorEffect, name="torque_constant_error"):
    """The torque of the drive differs from the commanded torque by a constant factor.

    In a geared servo it acts on the motor, before rotor and gear.
    """

    error: float = parameter(0.0, "relative error", "-", low=-0.9, high=2.0)
    law, among = rows.GAIN, "driven"

    identity = Identity(
        site="actuator",
        equation="tau <- (1 + error) tau",
        priors={"error": Prior(-0.3, 0.0, 0.3)},
        source="Gautier, Briot 2014, Global identification of joint drive gains and dynamic "
        "parameters of robots, J. Dynamic Systems, Measurement and Control 136(5)",
        look_alikes=(
            LookAlike("payload", "two postures, or a known weight: a mass does not scale kp"),
            LookAlike("load_friction", "raise and lower a weight slowly: friction reverses"),
            LookAlike("supply_sag", "load the other joints: only a supply sags"),
            LookAlike("armature", "hold a known weight: inertia needs no torque"),
        ),
        touches=("drive",),
        passive=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return (self.error,)


@dataclass
class Backlash(DriveEffect, name="backlash"):
    """Play between motor and joint: no torque is transmitted while the motor crosses it.

    Within the play the rotor is moved by the motor torque alone; the contact at either end is
    inelastic. The drive measures the joint.
    """

    width: float = parameter(0.0, "play between the two flanks", "rad", low=0.0, high=0.5)
    inertia: float = parameter(0.003, "inertia of the rotor, at the joint", "kg·m²", 1e-6, 10.0)
    law, among = rows.BACKLASH, "driven"

    identity = Identity(
        site="actuator",
        equation="tau = tau_drive on a flank and pushing, else 0; inertia dw/dt = tau_drive in the "
        "play; |theta - q| <= width / 2",
        priors={"width": Prior(0.002, 0.01, 0.05), "inertia": Prior(1e-4, 0.003, 0.1)},
        source="Nordin, Gutman 2002, Controlling mechanical systems with backlash: a survey, "
        "Automatica 38(10)",
        look_alikes=(
            LookAlike("coulomb_friction", "hold against a load: friction holds, backlash does not"),
            LookAlike("actuation_delay", "constant bias torque: backlash has no effect"),
            LookAlike("hysteresis", "drive off, turn by hand: backlash needs no torque"),
        ),
        touches=("drive",),
        smooth=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return 0.5 * self.width, self.inertia


@dataclass
class SeriesElasticity(Measuring, DriveEffect, name="series_elasticity"):
    """A spring between motor and joint; the drive and its sensor measure the motor.

    The motor's equation is solved implicitly, so it is stable for stiff springs; the rotor
    must be heavy enough for the gains of the drive, kd dt / inertia < 1.
    """

    compliance: float = parameter(0.0, "one over the stiffness", "rad/(N·m)", 0.0, 10.0)
    inertia: float = parameter(0.02, "inertia of the rotor, at the joint", "kg·m²", 1e-6, 10.0)
    damping: float = parameter(0.05, "damping of the spring", "N·m·s/rad", 0.0, 1000.0)
    law, among = rows.SERIES, "driven"
    remembers = True

    identity = Identity(
        site="compliance",
        equation="inertia dw/dt = tau_drive(theta) - tau; tau = (theta - q) / compliance + "
        "damping (w - dq); the encoder reads theta",
        priors={
            "compliance": Prior(1e-4, 0.002, 0.05),
            "inertia": Prior(1e-3, 0.01, 0.2),
            "damping": Prior(0.01, 0.1, 5.0),
        },
        source="Spong 1987, Modeling and control of elastic joint robots, J. Dynamic Systems, "
        "Measurement and Control 109(4); Pratt, Williamson 1995, Series elastic actuators, IROS",
        look_alikes=(
            LookAlike("actuator_lag", "load a resting joint: a lag does not deflect"),
            LookAlike("trunk_flex", "fix the trunk: the joints alone still deflect"),
            LookAlike("torque_constant_error", "excite the joint: a spring adds a resonance"),
        ),
        touches=("command", "drive", "q", "dq"),
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return max(self.compliance, 1e-9), self.inertia, self.damping

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        q, dq = q.copy(), dq.copy()
        reading_laws.move_back(q, dq, self.joints, self.memory)
        return q, dq

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        reading_laws.add_at(values, self.joints, 0, self.memory[:, 2], 1.0)
        reading_laws.add_at(values, self.joints, at.n, self.memory[:, 3], 1.0)

    def measure_run(
        self, values: np.ndarray, at: Layout, times: np.ndarray, memory: np.ndarray
    ) -> None:
        values[:, self.joints] += memory[:, self.in_chain, 2]
        values[:, at.n + self.joints] += memory[:, self.in_chain, 3]

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        stretch, speed = self.memory[:, 2], self.memory[:, 4]
        stored = np.sum(stretch**2) / self.compliance if self.compliance else 0.0
        return float(0.5 * (stored + self.inertia * np.sum(speed**2)))


@dataclass
class JointOffset(Measuring, JointEffect, name="joint_offset"):
    """A joint is mounted rotated: the zero of drive and sensor is not that of the model."""

    offset: float = parameter(0.0, "true angle when the reading is 0", "rad", -3.2, 3.2)
    among, needs = "driven", ("follower",)
    by_itself = True

    identity = Identity(
        site="actuator",
        equation="the drive holds q_d + offset; the sensor reads q - offset",
        priors={"offset": Prior(-0.1, 0.0, 0.1)},
        source="Hollerbach, Khalil, Gautier 2008, Model identification, Springer Handbook of "
        "Robotics, chapter 14",
        look_alikes=(
            LookAlike("sensor_bias", "hold still: a bias separates sensor "
                                     "and command, an offset does not"),
            LookAlike("rest_angle_error", "torque off: the error of the spring remains"),
            LookAlike("com_offset", "turn the robot: a wrong centre of mass changes the torque"),
        ),
        touches=("command", "q"),
        passive=False,
        turned="offset",
    )  # fmt: skip

    def reset(self, rng: np.random.Generator) -> None:
        self._sent: np.ndarray | None = None
        self._offsets = np.full(len(self.joints), self.offset)

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        if q is not self._sent:  # a new command
            self._sent, self._offset_q = q, q.copy()
            self._offset_q[self.joints] += self.offset
        return self._offset_q, dq

    def on_sequence(self, targets: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`on_command` for a whole run: commands, (k, 4, n), and their index at each step."""
        targets = targets.copy()
        targets[:, 0, self.joints] += self.offset
        return targets, which

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if values.ndim == 1:
            reading_laws.add_at(values, self.joints, 0, self._offsets, -1.0)
        else:
            values[:, self.joints] -= self._offsets

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return ()
