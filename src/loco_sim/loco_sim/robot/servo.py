# SPDX-License-Identifier: Apache-2.0
"""Drives that a robot brings along in ``robot.yaml``: servos, impedance and plain torque.

A servo is a DC motor behind a gear with a position loop of its own:

    u = clip(kp (q_d - q), -1, 1)                        share of the supply voltage
    tau_m = stall_torque (u - w / no_load_speed)         torque-speed line, |tau_m| <= effort
    J dw/dt = tau_m - tau                                rotor, seen at the joint
    tau = gear_stiffness (x - q) + gear_damping (w - dq) on the joint; dx/dt = w

with q and q_d rounded to the resolution of its encoder. Behind a gear of 193 : 1 the
rotor is far heavier than a leg of 40 g, so leaving it out (`rotor_inertia` 0, then tau
is tau_m with w = dq) is the worse model, and one that needs ten times finer steps.
"""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.params import Params, parameter

TORQUE, IMPEDANCE, SERVO = 1.0, 2.0, 3.0  # in the first column of a row; 0 is passive
COLUMNS = 9


@dataclass(frozen=True)
class ServoParams(Params):
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
        30.0, "stiffness of gear and horn, used with a rotor", "N·m/rad", low=0.0
    )
    gear_damping: float = parameter(
        0.05, "damping of gear and horn, used with a rotor", "N·m·s/rad", low=0.0
    )

    def row(self, effort: float) -> tuple[float, ...]:
        """Constants of the kernel, (COLUMNS,)."""
        line = self.stall_torque, self.stall_torque / self.no_load_speed, self.kp
        gear = self.rotor_inertia, self.gear_stiffness, self.gear_damping
        return (SERVO, *line, self.resolution, *gear, effort)

    @property
    def damping(self) -> float:
        """Damping that the joint feels within one physics step [N·m·s/rad]."""
        geared = self.rotor_inertia > 0.0
        return self.gear_damping if geared else self.stall_torque / self.no_load_speed


@dataclass(frozen=True)
class ImpedanceDrive(Params):
    """Joint impedance kp (q_d - q) + kd (dq_d - dq) + feed-forward torque, within the effort limit.

    The gains of a joint of a leg may differ while that leg swings (thesis section 7.3.3).
    """

    kp: float = parameter(0.0, "stiffness", "N·m/rad", low=0.0)
    kd: float = parameter(0.0, "damping", "N·m·s/rad", low=0.0)
    swing_kp: float = parameter(-1.0, "stiffness while the leg swings; -1: kp", "N·m/rad", low=-1.0)
    swing_kd: float = parameter(-1.0, "damping while the leg swings; -1: kd", "N·m·s/rad", low=-1.0)

    def row(self, effort: float) -> tuple[float, ...]:
        """Constants of the kernel, (COLUMNS,)."""
        return (IMPEDANCE, self.kp, self.kd, *self.swing, 0.0, 0.0, 0.0, effort)

    @property
    def swing(self) -> tuple[float, float]:
        """Stiffness [N·m/rad] and damping [N·m·s/rad] while the leg swings."""
        kp = self.kp if self.swing_kp < 0.0 else self.swing_kp
        return kp, self.kd if self.swing_kd < 0.0 else self.swing_kd

    @property
    def damping(self) -> float:
        """Largest damping that the joint feels within one physics step [N·m·s/rad]."""
        return max(self.kd, self.swing[1])


@dataclass(frozen=True)
class TorqueDrive(Params):
    """A direct drive: gain times the feed-forward torque plus bias, within the joint's limit."""

    gain: float = parameter(1.0, "torque per torque asked for", low=0.0, high=100.0)
    bias: float = parameter(0.0, "torque when none is asked for", "N·m", low=-1e4, high=1e4)

    def row(self, effort: float) -> tuple[float, ...]:
        """Constants of the kernel, (COLUMNS,)."""
        return (TORQUE, self.gain, self.bias, 0.0, 0.0, 0.0, 0.0, 0.0, effort)

    @property
    def damping(self) -> float:
        """Damping that the joint feels within one physics step [N·m·s/rad]."""
        return 0.0


DriveParams = ServoParams | ImpedanceDrive | TorqueDrive
DRIVES: dict[str, type[DriveParams]] = {
    "servo": ServoParams,
    "impedance": ImpedanceDrive,
    "torque": TorqueDrive,
}
