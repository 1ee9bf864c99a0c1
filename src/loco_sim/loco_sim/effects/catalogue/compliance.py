# SPDX-License-Identifier: Apache-2.0
"""Effects of joint springs and stops that differ from the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from .. import rows
from ..chain import TorqueEffect
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, logarithmic, strength, within

_TOUCHES = ("torque",)
_KERSCHEN = (
    "Kerschen, Worden, Vakakis, Golinval 2006, Past, present and future of nonlinear system "
    "identification in structural dynamics, Mechanical Systems and Signal Processing 20(3)"
)
_THESIS = "thesis section 5.3.1: springs of the real robot saturate, those of the model do not"


def rest(robot: Any, joints: np.ndarray) -> np.ndarray:
    """Rest angles of joints [rad], (k,): of the joint's spring, else of the standing pose."""
    springs = getattr(robot, "springs", {})
    names = [robot.joints[j] for j in joints]
    return np.array(
        [
            springs[name].slack if name in springs else robot.standing[j]
            for j, name in zip(joints, names, strict=True)
        ],
        dtype=float,
    )


def springs_of(robot: Any, joints: np.ndarray) -> list[np.ndarray]:
    """Columns of the springs' rows (`spring.SpringParams.row`), each (k,)."""
    return list(np.array([robot.springs[robot.joints[j]].row() for j in joints]).T)


@dataclass
class Elastic(TorqueEffect):
    """An effect whose torque depends on the position alone, so it conserves energy."""

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        zero, slack = np.zeros(len(q)), self._slack
        grid = np.linspace(0.0, 1.0, 101)
        tau = [self._chain.torque(zero, slack + s * (q - slack), zero, self._dt, 0.0) for s in grid]
        return -float(np.trapezoid(tau, grid, axis=0) @ (q - slack))

    def configure(self, world: Any) -> None:
        super().configure(world)
        self._slack = rest(world.robot, np.arange(len(world.robot.joints)))


@dataclass
class StiffnessError(Elastic, name="stiffness_error"):
    """A spring of the robot is stiffer or softer than the model says."""

    error: float = parameter(0.0, "relative error of the stiffness", "-", -0.99, 5.0)
    law, among = rows.RESCALED, "sprung"

    identity = Identity(
        site="compliance",
        kind="stiffness",
        equation="s(q) <- (1 + error) s(q), s the spring's torque",
        priors={"error": Prior(-0.5, 0.0, 1.5)},
        source="thesis eq. (5.1) and Table 5.1: hind springs 181.6 to 440.6 N/m",
        look_alikes=(
            LookAlike("cubic_stiffness", "small and large motions: the error is the same"),
            LookAlike("spring_saturation", "small motions: the error is still there"),
            LookAlike("payload", "two postures, or the robot in the air"),
            LookAlike("sensor_nonlinearity", "hang known weights: they show the true spring"),
        ),
        touches=_TOUCHES,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.error, 0.0, *springs_of(world.robot, joints)


@dataclass
class AddedStiffness(Elastic, name="added_stiffness"):
    """A spring parallel to the drive that the model lacks, e.g. from a cable or a seal."""

    stiffness: float = parameter(0.0, "stiffness of the joint", "N·m/rad", -1e3, 1e5)
    rest: float = parameter(0.0, "slack angle, from the joint's rest", "rad", -3.2, 3.2)
    law = rows.SPRING

    identity = Identity(
        site="compliance",
        kind="stiffness",
        equation="tau <- tau - stiffness (q - q_rest - rest)",
        priors={"stiffness": Prior(-5.0, 0.0, 50.0), "rest": Prior(-0.3, 0.0, 0.3)},
        source=_KERSCHEN,
        look_alikes=(
            LookAlike("cubic_stiffness", "small and large motions: the stiffness is the same"),
            LookAlike("stiffness_error", "torque off, bend by hand: the slack angles differ"),
            LookAlike("joint_offset", "two gains: a spring deflects the joint less at the higher"),
            LookAlike("torque_constant_error", "torque off: a spring still acts"),
            LookAlike("cable_force", "bend to both sides: a cable pulls and never pushes"),
        ),
        touches=_TOUCHES,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return rest(world.robot, joints) + self.rest, self.stiffness

    def amount(self, robot: Any) -> str:
        if self.joint not in robot.joints:
            return ""
        (at,) = rest(robot, np.array([robot.joints.index(self.joint)])) + self.rest
        return f"it is slack at {at:.3g} rad"


@dataclass
class CubicStiffness(Elastic, name="cubic_stiffness"):
    """A joint becomes stiffer (softer for negative values) with its deflection."""

    cubic: float = parameter(0.0, "torque per cube of the angle", "N·m/rad³", -1e4, 1e6)
    law = rows.SPRING

    identity = Identity(
        site="compliance",
        kind="stiffness",
        equation="tau <- tau - cubic (q - q_rest)^3",
        priors={"cubic": Prior(-20.0, 0.0, 200.0)},
        source=f"{_KERSCHEN}; Wigren, Schoukens 2013, Three free data sets for development and "
        "benchmarking in nonlinear system identification, ECC (Silverbox)",
        look_alikes=(
            LookAlike("stiffness_error", "small motions: a cubic spring has no effect"),
            LookAlike("added_stiffness", "small motions: a cubic spring has no effect"),
            LookAlike("end_stop", "half the amplitude: the stop is not reached"),
            LookAlike("spring_saturation", "largest motions: a cubic torque may change its sign"),
            LookAlike("sensor_nonlinearity", "hang known weights: they show the true spring"),
        ),
        touches=_TOUCHES,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return rest(world.robot, joints), 0.0, self.cubic


@dataclass
class SpringSaturation(Elastic, name="spring_saturation"):
    """Above a certain torque a spring of the robot has a smaller stiffness."""

    lost: float = parameter(0.0, "share of the stiffness lost above the torque", "-", 0.0, 1.0)
    torque: float = parameter(0.1, "torque at which saturation begins", "N·m", 1e-4, 1e3)
    law, among = rows.SATURATION, "sprung"

    identity = Identity(
        site="compliance",
        kind="stiffness",
        equation="s <- sign(s) (torque + (1 - lost) (|s| - torque)) where |s| > torque",
        priors={"lost": Prior(0.2, 0.7, 1.0), "torque": Prior(0.02, 0.1, 2.0)},
        source=_THESIS,
        look_alikes=(
            LookAlike("stiffness_error", "small motions: no saturation"),
            LookAlike("cubic_stiffness", "largest motions: a saturated slope is positive"),
            LookAlike("hysteresis", "load and unload slowly: saturation has no loop"),
            LookAlike("sensor_nonlinearity", "hang known weights and measure the angle by hand"),
            LookAlike("torque_limit", "torque off: the spring still saturates"),
        ),
        touches=_TOUCHES,
        smooth=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.torque, 1.0 - self.lost, *springs_of(world.robot, joints)


@dataclass
class RestAngleError(Elastic, name="rest_angle_error"):
    """The rest angle of a spring of the robot differs from the model."""

    offset: float = parameter(0.0, "error of the rest angle", "rad", -1.5, 1.5)
    law, among = rows.SHIFTED, "sprung"

    identity = Identity(
        site="compliance",
        equation="s(q) <- s(q - offset), s the spring's torque",
        priors={"offset": Prior(-0.15, 0.0, 0.15)},
        source="thesis section 5.1: the slack position of a mounted spring is hard to measure",
        look_alikes=(
            LookAlike("sensor_bias", "joint against its stop: with a bias the reading is wrong"),
            LookAlike("payload", "robot in the air: the legs carry no payload"),
            LookAlike("joint_offset", "torque off: an offset of the drive has no effect"),
        ),
        touches=_TOUCHES,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.offset, 0.0, *springs_of(world.robot, joints)


@dataclass
class EndStop(Elastic, name="end_stop"):
    """A soft stop limits the joint at an angle; list it twice for both sides.

    For a negative angle the stop is on the other side, unless `side` says which way it stops. A
    stop only pushes.
    """

    angle: float = parameter(0.0, "angle from the joint's rest; 0: no stop", "rad", -3.2, 3.2)
    stiffness: float = parameter(20.0, "of the stop", "N·m/rad", 1e-3, 1e6)
    damping: float = parameter(0.0, "of the stop", "N·m·s/rad", 0.0, 1e4)
    side: float = parameter(
        0.0, "1: stops motion to larger angles, -1: to smaller ones; 0: sign of the angle",
        "-", -1, 1,
    )  # fmt: skip
    law = rows.END_STOP

    identity = Identity(
        site="compliance",
        equation="tau <- tau - max(0, stiffness (x - angle) + damping dq) where x > angle, "
        "x = q - q_rest",
        priors={
            "angle": Prior(-1.0, 0.0, 1.0),
            "stiffness": Prior(2.0, 20.0, 500.0),
            "damping": Prior(0.01, 0.1, 10.0),
        },
        source="Hunt, Crossley 1975, Coefficient of restitution interpreted as damping in "
        "vibroimpact, J. Applied Mechanics 42(2)",
        look_alikes=(
            LookAlike("cubic_stiffness", "half the amplitude: a cubic spring still acts"),
            LookAlike("sensor_stuck", "push the joint further: only at a stop the torque rises"),
        ),
        touches=_TOUCHES,
        smooth=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At either side of each joint, inside the measured range."""
        rows, slack = [], rest(robot, np.arange(len(robot.joints)))
        free = strength(cls, "stiffness", 20.0), logarithmic(cls, "damping", (0.1,))
        for j, joint in enumerate(robot.joints):
            edges = {"above": motion.high[j] - slack[j], "below": motion.low[j] - slack[j]}
            for side, limit in edges.items():
                if not np.isfinite(limit):  # a joint without limits has no stop
                    continue
                fixed, sign = (("joint", joint),), 1.0 if side == "above" else -1.0
                if abs(limit) >= 1e-3 and limit * sign > 0.0:
                    size, starts, interval = limit, (0.9, 0.7, 0.98), (0.05 * limit, 1.3 * limit)
                else:  # the joint did not pass its rest, from where angles count
                    inwards = -sign * (edges["above"] - edges["below"])
                    fixed = (*fixed, ("side", sign))
                    size, *points = (float(limit + share * inwards) for share in (0.1, 0.3, 0.02))
                    starts = (1.0, *(point / size for point in points)) if size else ()
                    interval = limit + 1e-3 * inwards, limit + 0.95 * inwards
                bounds = map(float, sorted(interval))
                if size and (angle := within(cls, "angle", float(size), starts, *bounds)):
                    rows.append(Offer(joint, fixed, (free[0], angle, free[1]), side))
        return rows

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        side = float(np.sign(self.side or self.angle))
        at = rest(world.robot, joints) + self.angle
        return at, side, self.stiffness * abs(side), self.damping * abs(side)


@dataclass
class Hysteresis(TorqueEffect, name="hysteresis"):
    """Rate-independent friction with a spring in series (Bouc-Wen with exponent 1: Dahl's law)."""

    torque: float = parameter(0.0, "friction torque after a long displacement", "N·m", 0.0, 200.0)
    stroke: float = parameter(0.02, "displacement after which it reaches 63 %", "rad", 1e-4, 3.0)
    law = rows.HYSTERESIS

    identity = Identity(
        site="compliance",
        equation="stroke dz/dt = dq - |dq| z; tau <- tau - torque z",
        priors={"torque": Prior(0.005, 0.05, 2.0), "stroke": Prior(0.003, 0.02, 0.2)},
        source="Wen 1976, Method for random vibration of hysteretic systems, J. Engineering "
        "Mechanics Division 102(2); Dahl 1968, A solid friction model",
        look_alikes=(
            LookAlike("coulomb_friction", "small reversals: dry friction does not spring back"),
            LookAlike("viscoelasticity", "two speeds: hysteresis is the same"),
            LookAlike("backlash", "drive off, turn by hand: backlash needs no torque"),
            LookAlike("spring_saturation", "load and unload slowly: saturation has no loop"),
        ),
        touches=_TOUCHES,
        kind="friction",
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.torque, self.stroke

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        return float(0.5 * self.torque * self.stroke * np.sum(self.memory[:, 0] ** 2))


@dataclass
class Viscoelasticity(TorqueEffect, name="viscoelasticity"):
    """A spring in series with a damper (Maxwell): stiff in fast motion, soft in slow motion."""

    stiffness: float = parameter(0.0, "stiffness of the spring in fast motion", "N·m/rad", 0.0, 1e5)
    time: float = parameter(0.1, "time constant of the decay of its torque", "s", 1e-3, 100.0)
    law = rows.MAXWELL

    identity = Identity(
        site="compliance",
        equation="dz/dt = dq - z / time; tau <- tau - stiffness z",
        priors={"stiffness": Prior(0.05, 1.0, 50.0), "time": Prior(0.01, 0.1, 2.0)},
        source="Findley, Lai, Onaran 1976, Creep and relaxation of nonlinear viscoelastic "
        "materials, North-Holland (Maxwell model)",
        look_alikes=(
            LookAlike("viscous_friction", "fast oscillations: the torque of a damper still grows"),
            LookAlike("added_stiffness", "step and hold: the torque of a spring does not decay"),
            LookAlike("hysteresis", "two speeds: hysteresis is the same"),
        ),
        touches=_TOUCHES,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.stiffness, np.exp(-world.dt / self.time), self.time

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        return float(0.5 * self.stiffness * np.sum(self.memory[:, 0] ** 2))
