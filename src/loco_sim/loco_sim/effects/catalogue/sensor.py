# SPDX-License-Identifier: Apache-2.0
"""Effects of the sensors: bias, gain, nonlinearity, quantisation, latency, IMU tilt."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from loco_control.params import parameter

from ... import lazy
from ...geometry import Quaternion, multiply, rotation_matrix, seen_from
from ..base import Effect
from ..identity import READ_AS, SENSOR_SIGNALS, Identity, LookAlike, Prior
from ..offers import Motion, Offer, strength, vector
from ..places import joint_places
from ..readings import Layout, Measuring
from .compliance import rest

if TYPE_CHECKING:
    from ...world.world import Base

reading_laws = lazy.module("loco_sim.effects.reading_laws")

_INERTIAL = (
    "Woodman 2007, An introduction to inertial navigation, University of Cambridge, UCAM-CL-TR-696"
)
Vector = tuple[float, float, float]


@dataclass
class JointSensor(Measuring, Effect):
    """Base of effects on sensors, some of them in joints."""

    joint: str = parameter("", "joints, by name or pattern; empty is all")

    @classmethod
    def places(cls, robot: Any) -> list[str]:
        return joint_places(robot, "all")

    def configure(self, world: Any) -> None:
        self._joints = world.joint_index(self.joint or "*")
        self._rest = rest(world.robot, self._joints)


@dataclass
class LinearSensor(JointSensor):
    """Base of effects that multiply readings by a factor and add an offset."""

    names: ClassVar[Mapping[str, str]] = {}  # parameter by signal of a recording
    by_itself = True

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """One parameter for each measured signal, joint by joint for joint signals."""
        rows: list[Offer] = []
        for signal, name in cls.names.items():
            if signal not in signals:
                continue
            if isinstance(cls.__dataclass_fields__[name].default, tuple):
                rows.append(Offer("", (), vector(cls, name), name))
                continue
            free = (strength(cls, name, cls.identity.priors[name].high / 3.0),)
            if signal in ("q", "dq", "tau"):
                rows += [Offer(j, (("joint", j),), free, name) for j in cls.places(robot)]
            else:
                rows.append(Offer("", (), free, name))
        return rows

    def reset(self, rng: np.random.Generator) -> None:
        self._factor: np.ndarray | None = None

    def lines(self, at: Layout, factor: np.ndarray, extra: np.ndarray) -> None:
        """Fill in factors (initially 1) and offsets (initially 0), each (at.size,)."""
        raise NotImplementedError

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if self._factor is None:
            self._factor, self._extra = np.ones(at.size), np.zeros(at.size)
            self.lines(at, self._factor, self._extra)
        if values.ndim == 1:
            reading_laws.scale(values, self._factor, self._extra)
        else:
            values *= self._factor
            values += self._extra


@dataclass
class SensorBias(LinearSensor, name="sensor_bias"):
    """Sensor readings have a constant offset; the drives are not affected (see `joint_offset`)."""

    q: float = parameter(0.0, "joint position", "rad", low=-3.2, high=3.2)
    tau: float = parameter(0.0, "joint torque", "N·m", low=-200.0, high=200.0)
    gyro: Vector = parameter((0.0, 0.0, 0.0), "IMU angular velocity", "rad/s", -10.0, 10.0)
    accelerometer: Vector = parameter((0.0, 0.0, 0.0), "IMU specific force", "m/s²", -50.0, 50.0)
    names = {"q": "q", "tau": "tau", "gyro": "gyro", "acceleration": "accelerometer"}

    identity = Identity(
        site="sensor",
        kind="sensor error",
        equation="y <- y + bias",
        priors={
            "q": Prior(-0.05, 0.0, 0.05),
            "tau": Prior(-0.5, 0.0, 0.5),
            "gyro": Prior(-0.02, 0.0, 0.02),
            "accelerometer": Prior(-0.3, 0.0, 0.3),
        },
        strengths=("q", "tau", "gyro", "accelerometer"),
        source=_INERTIAL,
        look_alikes=(
            LookAlike("joint_offset", "hold still: an offset leaves sensor and command equal"),
            LookAlike("rest_angle_error", "joint at its stop: a spring does not change readings"),
            LookAlike("imu_tilt", "turn the robot on its side: a tilt turns with it"),
            LookAlike("com_offset", "another gain: a bias does not change"),
        ),
        touches=("q", "tau", "angular_velocity", "linear_acceleration"),
    )

    def lines(self, at: Layout, factor: np.ndarray, extra: np.ndarray) -> None:
        extra[at["q"]][self._joints] = self.q
        extra[at["tau"]][self._joints] = self.tau
        extra[at["angular_velocity"]] = self.gyro
        extra[at["linear_acceleration"]] = self.accelerometer


@dataclass
class SensorGain(LinearSensor, name="sensor_gain"):
    """Sensor readings have a scale error; of positions and velocities about the sensor's zero.

    A sensor with a shifted zero has a `sensor_bias` as well.
    """

    q: float = parameter(0.0, "joint position and velocity", "-", low=-0.9, high=2.0)
    tau: float = parameter(0.0, "joint torque", "-", low=-0.9, high=2.0)
    grf: float = parameter(0.0, "ground reaction force", "-", low=-0.9, high=2.0)
    gyro: float = parameter(0.0, "IMU angular velocity", "-", low=-0.9, high=2.0)
    accelerometer: float = parameter(0.0, "IMU specific force", "-", low=-0.9, high=2.0)
    names = {"q": "q", "tau": "tau", "grf": "grf", "gyro": "gyro", "acceleration": "accelerometer"}

    identity = Identity(
        site="sensor",
        kind="sensor error",
        equation="y <- y + error y, q as well",
        priors={
            "q": Prior(-0.1, 0.0, 0.1),
            "tau": Prior(-0.3, 0.0, 0.3),
            "grf": Prior(-0.2, 0.0, 0.2),
            "gyro": Prior(-0.03, 0.0, 0.03),
            "accelerometer": Prior(-0.03, 0.0, 0.03),
        },
        strengths=("q", "tau", "grf", "gyro", "accelerometer"),
        source=_INERTIAL,
        look_alikes=(
            LookAlike("stiffness_error", "known angles by hand: the spring has no effect"),
            LookAlike("torque_constant_error", "the motion: a torque sensor does not change it"),
            LookAlike("sensor_nonlinearity", "small and large angles: a gain error is the same"),
            LookAlike("sensor_bias", "two distant angles: a bias is the same at both"),
        ),
        touches=("q", "dq", "tau", "grf", "angular_velocity", "linear_acceleration"),
    )

    def lines(self, at: Layout, factor: np.ndarray, extra: np.ndarray) -> None:
        factor[at["q"]][self._joints] += self.q
        factor[at["dq"]][self._joints] += self.q
        factor[at["tau"]][self._joints] += self.tau
        factor[at["grf"]] += self.grf
        factor[at["angular_velocity"]] += self.gyro
        factor[at["linear_acceleration"]] += self.accelerometer


@dataclass
class SensorNonlinearity(JointSensor, name="sensor_nonlinearity"):
    """The characteristic of a joint sensor is nonlinear, e.g. from an inaccurate Hall sensor table.

    The velocity is the derivative of the distorted position.
    """

    quadratic: float = parameter(0.0, "coefficient about the joint's rest", "1/rad", -5.0, 5.0)
    cubic: float = parameter(0.0, "coefficient about the joint's rest", "1/rad²", -10.0, 10.0)
    by_itself = True

    identity = Identity(
        site="sensor",
        kind="sensor error",
        equation="q <- q + quadratic x^2 + cubic x^3, x = q - q_rest",
        priors={"quadratic": Prior(-0.5, 0.0, 0.5), "cubic": Prior(-1.0, 0.0, 1.0)},
        strengths=("quadratic", "cubic"),
        source="thesis section 4.2: Hall sensors in the knees, 0.01 to 1 degree per count",
        look_alikes=(
            LookAlike("cubic_stiffness", "hang known weights: they show the true spring"),
            LookAlike("spring_saturation", "move the joint to known angles by hand"),
            LookAlike("sensor_gain", "small and large angles: a gain error is the same"),
        ),
        touches=("q", "dq"),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """Both distortion terms of each joint's sensor."""
        free = strength(cls, "quadratic", 0.2), strength(cls, "cubic", 0.4)
        return [Offer(j, (("joint", j),), free) for j in cls.places(robot)]

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        coefficients = self.quadratic, self.cubic
        rows = values.reshape(-1, at.size)  # one or many samples
        reading_laws.bend(rows, self._joints, at.n, self._rest, *coefficients)


@dataclass
class Quantisation(JointSensor, name="quantisation"):
    """A joint sensor reads only multiples of a step."""

    step: float = parameter(0.0, "step of the position", "rad", low=0.0, high=1.0)

    identity = Identity(
        site="sensor",
        equation="q <- step round(q / step)",
        priors={"step": Prior(2e-4, 3e-3, 0.02)},
        source="Widrow, Kollar 2008, Quantization noise, Cambridge University Press",
        look_alikes=(
            LookAlike("sensor_noise", "hold still: noise varies, a quantised reading does not"),
            LookAlike("stribeck_friction", "turn slowly by hand: the joint itself does not stick"),
        ),
        touches=("q",),
        smooth=False,
        untried="rounding belongs to the noise floor; what the readings show of it is in the notes",
    )

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if self.step:
            reading_laws.quantise(values, self._joints, self.step)


@dataclass
class SensorLatency(Measuring, Effect, name="sensor_latency"):
    """Sensor readings are delayed, with interpolation between samples.

    At its start, the current values are held until the delayed ones arrive. The contact state
    of the feet is not delayed.
    """

    delay: float = parameter(0.0, "delay, also in fractions of a sample", "s", low=0.0, high=1.0)
    channel: str = parameter("all", "sensors", choices=("all", *SENSOR_SIGNALS))

    identity = Identity(
        site="sensor",
        kind="delay",
        equation="y(t) <- y(t - delay)",
        priors={"delay": Prior(0.002, 0.01, 0.1)},
        source="Tan et al. 2018, Sim-to-real: learning agile locomotion for quadruped robots, RSS",
        look_alikes=(
            LookAlike("command_delay", "push the robot by hand: only a late sensor "
                                       "shows; or compare with an external sensor without delay"),
            LookAlike("actuation_delay", "the same experiments as for a command delay"),
            LookAlike("sensor_stuck", "wait: delayed values arrive, a stuck sensor stays"),
        ),
        touches=SENSOR_SIGNALS,
        late="delay",
    )  # fmt: skip

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """All sensors together, and each signal alone if several were measured."""
        free = (strength(cls, "delay", cls.identity.priors["delay"].typical),)
        rows = [Offer("", (), free)]
        for signal in signals if len(signals) > 1 else ():
            channel = READ_AS.get(signal, signal)
            if channel in SENSOR_SIGNALS:
                rows.append(Offer("", (("channel", channel),), free, channel))
        return rows

    def reset(self, rng: np.random.Generator) -> None:
        self._past: deque = deque()

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if self.channel == "all":
            self._read(values, at, t)
        else:
            late, columns = values.copy(), at[self.channel]
            self._read(late, at, t)
            values[columns] = late[columns]

    def _read(self, values: np.ndarray, at: Layout, t: float) -> None:
        """Replace values by their delayed values."""
        past, target_time = self._past, t - self.delay
        past.append((t, values.copy()))
        while len(past) > 1 and past[1][0] <= target_time + 1e-9:
            past.popleft()
        began, old = past[0]
        if target_time <= began or len(past) == 1:
            values[:] = old
            return
        next_time, new = past[1]
        share = (target_time - began) / (next_time - began)
        if share > 1e-6:
            reading_laws.between(values, old, new, share, at["orientation"].start)
        else:
            values[:] = old


@dataclass
class ImuTilt(Measuring, Effect, name="imu_tilt"):
    """The IMU is mounted rotated: roll, then pitch, then yaw about fixed axes of the base."""

    roll: float = parameter(0.0, "rotation of the IMU in the base", "rad", low=-3.2, high=3.2)
    pitch: float = parameter(0.0, "rotation of the IMU in the base", "rad", low=-3.2, high=3.2)
    yaw: float = parameter(0.0, "rotation of the IMU in the base", "rad", low=-3.2, high=3.2)
    needs = ("base",)

    identity = Identity(
        site="sensor",
        equation="orientation <- orientation R; gyro, force <- R' gyro, R' force",
        priors={name: Prior(-0.05, 0.0, 0.05) for name in ("roll", "pitch", "yaw")},
        strengths=("roll", "pitch", "yaw"),
        source=_INERTIAL,
        look_alikes=(
            LookAlike("slope", "turn the robot around: a slope does not turn with it"),
            LookAlike("com_offset", "foot forces: a tilted IMU does not change them"),
            LookAlike("sensor_bias", "turn the robot on its side: a bias does not change"),
        ),
        touches=("orientation", "angular_velocity", "linear_acceleration"),
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)

    def turn(self) -> Quaternion:
        """Attitude of the IMU in the base, x y z w."""
        turn = (0.0, 0.0, 0.0, 1.0)
        for axis, angle in enumerate((self.roll, self.pitch, self.yaw)):
            about = [0.0, 0.0, 0.0, cos(0.5 * angle)]
            about[axis] = sin(0.5 * angle)
            turn = multiply(about, turn)
        return turn

    def begin(self, base: Base) -> Base:
        """True base state: tilt removed from attitude and leg odometry, gyro rates unchanged."""
        (x, y, z, w), (a, b, c, d) = self.turn(), base.orientation
        back = multiply(base.orientation, (-x, -y, -z, w))  # attitude of the base, without the tilt
        moved = seen_from(multiply(back, (-a, -b, -c, d)), base)
        return moved._replace(angular_velocity=base.angular_velocity)

    def reset(self, rng: np.random.Generator) -> None:
        turn = self.turn()
        self._turn = np.array(turn)
        self._back = np.array(rotation_matrix(turn)).reshape(3, 3).T.copy()

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        reading_laws.tilt(values, at["orientation"].start, self._turn, self._back)
