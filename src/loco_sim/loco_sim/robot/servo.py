# SPDX-License-Identifier: Apache-2.0
"""Drives of a robot in ``robot.yaml``: servos, joint impedance and plain torque.

A servo is a geared DC motor with its own position loop:

    u = clip(kp (q_d - q), -1, 1)                        duty cycle (share of the supply voltage)
    tau_m = stall_torque (u - w / no_load_speed)         torque-speed line, |tau_m| <= effort
    J dw/dt = tau_m - tau                                rotor, reflected to the joint
    tau = gear_stiffness (x - q) + gear_damping (w - dq) on the joint; dx/dt = w

with q and q_d rounded to the resolution of its encoder. Behind a gear of 193 : 1 the
rotor inertia is far larger than that of a leg of 40 g, so a model without it (`rotor_inertia` 0,
then tau is tau_m with w = dq) is less accurate and needs ten times finer steps. With
`gear_stiffness` 0 the gear is rigid: the joint has the inertia of the rotor, and tau is tau_m.

An impedance is a cascade of a position and a velocity loop with an integrator, of which most
gains are 0:

    v = speed_feed dq_d + position_gain (q_d - q)        desired velocity
    dz/dt = ki (q_d - q) + speed_ki (v - dq)             |z| <= integral_limit
    tau = kp (q_d - q) + kd (v - dq) + z + tau_ff        |tau| <= effort

z is frozen while tau is at its limit and the error would increase it. The output of a drive may be
sampled: see `Sampled`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter

TORQUE, IMPEDANCE, SERVO = 1.0, 2.0, 3.0  # kind of drive, first column of a row; 0 is passive
# Named columns of a row; the others depend on the kind of drive.
EFFORT, PERIOD, AVERAGED, SPEED_FEED, INTEGRAL_LIMIT = 8, 9, 10, 11, 12
COLUMNS = 13
CONTINUOUS, HELD, MEAN = "continuous", "held", "averaged"


@dataclass(frozen=True)
class Sampled(Params):
    """Base of drives whose torque, or duty cycle, may be sampled and held.

    A digital controller samples the joint once per period and holds its output until the next
    sample.
    """

    torque: str = parameter(
        CONTINUOUS,
        "continuous: at every physics step; held: of the last sample; averaged: mean over the "
        "period before",
        choices=(CONTINUOUS, HELD, MEAN),
    )
    period: float = parameter(
        0.0, "of the samples; in robot.yaml by default the control period", "s", low=0.0, high=10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.torque != CONTINUOUS and self.period <= 0.0:
            raise ParameterError(
                f"a drive whose torque is {self.torque} needs a period above 0 s, got "
                f"{self.period:g}; say for instance period: 0.004"
            )

    @property
    def sampled(self) -> bool:
        """Whether the torque is sampled, not computed at every physics step."""
        return self.torque != CONTINUOUS

    def _sampling(self) -> tuple[float, float]:
        """Columns `PERIOD` and `AVERAGED` of a row."""
        return self.period if self.sampled else 0.0, float(self.torque == MEAN)


@dataclass(frozen=True)
class Following(Sampled):
    """Base of drives that follow a setpoint."""

    setpoint_speed: float = parameter(
        0.0, "largest speed of the setpoint (velocity profile); 0 is no limit", "rad/s", low=0.0
    )


@dataclass(frozen=True)
class ServoParams(Following):
    """A geared servo with a position loop, e.g. a Dynamixel."""

    stall_torque: float = parameter(2.6, "torque at rest at full voltage", "N·m", low=1e-6)
    no_load_speed: float = parameter(13.2, "speed without load at full voltage", "rad/s", low=1e-3)
    kp: float = parameter(6.2, "share of full voltage per position error", "1/rad", low=0.0)
    resolution: float = parameter(
        0.0, "step of the encoder, and of the command; 0 is none", "rad", low=0.0, high=1.0
    )
    rotor_inertia: float = parameter(
        0.0, "inertia of rotor and gear at the joint", "kg·m²", low=0.0, high=1e3
    )
    gear_stiffness: float = parameter(
        0.0, "stiffness of gear and horn, used with a rotor; 0 is rigid", "N·m/rad", low=0.0
    )
    gear_damping: float = parameter(
        0.05, "damping of gear and horn, used with a rotor", "N·m·s/rad", low=0.0
    )

    def row(self, effort: float) -> tuple[float, ...]:
        """Parameter row for the kernels, (COLUMNS,)."""
        line = self.stall_torque, self.stall_torque / self.no_load_speed, self.kp
        gear = self.rotor_inertia, self.gear_stiffness, self.gear_damping
        return (SERVO, *line, self.resolution, *gear, effort, *self._sampling(), 0.0, 0.0)

    @property
    def command(self) -> str:
        """Kind of command: ``position``."""
        return "position"

    @property
    def damping(self) -> float:
        """Effective damping of the joint within one physics step [N·m·s/rad]."""
        geared = self.rotor_inertia > 0.0
        return self.gear_damping if geared else self.stall_torque / self.no_load_speed


@dataclass(frozen=True)
class ImpedanceDrive(Following):
    """Joint impedance kp (q_d - q) + kd (dq_d - dq) + feed-forward torque, within the effort limit.

    The gains of a joint of a leg may differ while that leg swings (thesis section 7.3.3). With
    integrators it is a PI or PID loop, with `position_gain` a cascade: see above.
    """

    kp: float = parameter(0.0, "stiffness", "N·m/rad", low=0.0)
    kd: float = parameter(0.0, "damping", "N·m·s/rad", low=0.0)
    swing_kp: float = parameter(-1.0, "stiffness while the leg swings; -1: kp", "N·m/rad", low=-1.0)
    swing_kd: float = parameter(-1.0, "damping while the leg swings; -1: kd", "N·m·s/rad", low=-1.0)
    ki: float = parameter(0.0, "torque per integral of the position error", "N·m/(rad·s)", low=0.0)
    speed_ki: float = parameter(
        0.0, "torque per integral of the velocity error", "N·m/rad", low=0.0
    )
    integral_limit: float = parameter(math.inf, "largest torque of the integrator", "N·m", low=0.0)
    position_gain: float = parameter(
        0.0, "velocity asked for per position error, of a cascade", "1/s", low=0.0
    )
    speed_feed: float = parameter(
        1.0, "share of the commanded velocity that is asked for", "-", low=0.0, high=10.0
    )

    def row(self, effort: float) -> tuple[float, ...]:
        """Parameter row for the kernels, (COLUMNS,)."""
        loop = self.ki, self.speed_ki, self.position_gain
        end = self.speed_feed, self.integral_limit
        return (IMPEDANCE, self.kp, self.kd, *self.swing, *loop, effort, *self._sampling(), *end)

    @property
    def integrates(self) -> bool:
        """Whether the loop has an integrator."""
        return self.ki > 0.0 or self.speed_ki > 0.0

    @property
    def command(self) -> str:
        """Kind of command: ``position``, or ``velocity`` without a position gain."""
        stiff = max(self.kp, self.swing[0], self.ki, self.position_gain)
        return "velocity" if stiff == 0.0 and self.kd + self.speed_ki > 0.0 else "position"

    @property
    def swing(self) -> tuple[float, float]:
        """Stiffness [N·m/rad] and damping [N·m·s/rad] while the leg swings."""
        kp = self.kp if self.swing_kp < 0.0 else self.swing_kp
        return kp, self.kd if self.swing_kd < 0.0 else self.swing_kd

    @property
    def damping(self) -> float:
        """Largest effective damping of the joint within one physics step [N·m·s/rad]."""
        return 0.0 if self.sampled else max(self.kd, self.swing[1])


@dataclass(frozen=True)
class TorqueDrive(Sampled):
    """A motor without a loop: gain u + bias - slope dq, within the joint's limit.

    The command u is a torque, or with another `gain` a current (gain is the torque constant), or a
    voltage or duty cycle (gain is the torque at rest per unit, slope the effect of the back
    electromotive force).
    """

    gain: float = parameter(1.0, "torque at rest per unit of the command", low=0.0, high=1e6)
    bias: float = parameter(0.0, "torque when none is asked for", "N·m", low=-1e4, high=1e4)
    slope: float = parameter(
        0.0, "torque lost per velocity, where a voltage is told", "N·m·s/rad", low=0.0, high=1e6
    )

    def motor_torque(self, commanded: np.ndarray, speed: np.ndarray | float) -> np.ndarray:
        """Torque [N·m] by a command and the velocity of the joint [rad/s], (T,), without limit."""
        return self.gain * commanded + self.bias - self.slope * speed

    def row(self, effort: float) -> tuple[float, ...]:
        """Parameter row for the kernels, (COLUMNS,)."""
        rest = (0.0,) * 4
        motor = self.gain, self.bias, self.slope
        return (TORQUE, *motor, *rest, effort, *self._sampling(), 0.0, 0.0)

    @property
    def command(self) -> str:
        """Kind of command: ``torque``."""
        return "torque"

    @property
    def damping(self) -> float:
        """Effective damping of the joint within one physics step [N·m·s/rad]."""
        return self.slope


DriveParams = ServoParams | ImpedanceDrive | TorqueDrive
DRIVES: dict[str, type[DriveParams]] = {
    "servo": ServoParams,
    "impedance": ImpedanceDrive,
    "torque": TorqueDrive,
}
