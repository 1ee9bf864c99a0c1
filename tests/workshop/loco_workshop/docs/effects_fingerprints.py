# SPDX-License-Identifier: Apache-2.0
"""Experiments that show each effect clearly, for the figures of the documentation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import pi, sin
from typing import Any


@dataclass(frozen=True)
class Fingerprint:
    """An experiment that shows an effect.

    Attributes:
        robot: Name of the test bench or robot.
        values: Parameters of the effect.
        q: Desired positions of all joints relative to the standing pose, as function of time [rad].
        tau: Feed-forward torque of all joints, as function of time [N·m].
        x: Key of the record on the horizontal axis.
        y: Key of the record on the vertical axis.
        labels: Labels of the two axes.
        begin: Initial joint positions relative to the standing pose [rad].
        duration: Duration of the experiment [s].
        after: Start time of the figure [s].
        joint: Index of the joint, for keys of a single joint.
    """

    robot: str
    values: dict[str, Any]
    q: Callable[[float], float] = lambda t: 0.0
    tau: Callable[[float], float] = lambda t: 0.0
    x: str = "t"
    y: str = "q"
    labels: tuple[str, str] = ("time [s]", "angle [rad]")
    begin: float = 0.0
    duration: float = 2.0
    after: float = 0.0
    joint: int = 0
    base: list[dict[str, Any]] = field(default_factory=list)


def sine(amplitude: float, frequency: float) -> Callable[[float], float]:
    """A sine as function of time."""
    return lambda t: amplitude * sin(2.0 * pi * frequency * t)


def step(size: float, at: float = 0.1) -> Callable[[float], float]:
    """A step as function of time."""
    return lambda t: size if t >= at else 0.0


def ramp(speed: float) -> Callable[[float], float]:
    """A ramp as function of time."""
    return lambda t: speed * t


def chirp(amplitude: float, slope: float) -> Callable[[float], float]:
    """A sine whose frequency grows at the rate `slope` [Hz/s]."""
    return lambda t: amplitude * sin(pi * slope * t * t)


def swing(values: dict[str, Any], **more: Any) -> Fingerprint:
    """Free swing of the pendulum."""
    return Fingerprint("pendulum", values, **{"begin": 1.0, "duration": 4.0, **more})


def ring(values: dict[str, Any], **more: Any) -> Fingerprint:
    """Free oscillation of the mass on a spring; force of the spring over its length."""
    axes = {"x": "q", "y": "tau", "labels": ("way [m]", "force [N]")}
    return Fingerprint("spring_mass", values, **{"begin": 0.1, "duration": 2.0, **axes, **more})


def moved(values: dict[str, Any], **more: Any) -> Fingerprint:
    """Step response of the belt axis."""
    usual = {"q": step(0.05), "duration": 0.5, "labels": ("time [s]", "way [m]")}
    return Fingerprint("linear_axis", values, **{**usual, **more})


def sensed(values: dict[str, Any], **more: Any) -> Fingerprint:
    """Response of the belt axis to a slow sine."""
    usual = {"q": sine(0.1, 1.0), "duration": 1.0, "x": "q", "y": "said"}
    labels = ("true way [m]", "sensor [m]")
    return Fingerprint("linear_axis", values, **{**usual, "labels": labels, **more})


def tigrillo(values: dict[str, Any], **more: Any) -> Fingerprint:
    """Tigrillo with swinging hips."""
    usual = {"q": sine(0.1, 1.0), "duration": 3.0, "after": 0.5}
    return Fingerprint("tigrillo", values, **{**usual, **more})


_FORCE = {"x": "dq", "y": "tau", "labels": ("velocity [m/s]", "force [N]")}
_TRACK = {"q": sine(0.1, 1.0), "duration": 1.5, "after": 0.5}
_LEAN = {"y": "height", "labels": ("time [s]", "base height [m]")}

FINGERPRINTS: dict[str, Fingerprint] = {
    # actuator
    "coulomb_friction": swing({"torque": 0.05}),
    "stribeck_friction": swing({"torque": 0.2, "velocity": 1.0}, begin=0.0, tau=ramp(0.1)),
    "viscous_friction": swing({"damping": 0.03}),
    "load_friction": moved({"share": 0.3}, **_TRACK, **_FORCE),
    "actuator_lag": moved({"time": 0.02}),
    "torque_limit": moved({"reduction": 0.8}),
    "torque_speed_line": moved({"slope": 3.0}),
    "supply_sag": moved({"sag": 0.9}),
    "torque_constant_error": moved({"error": -0.6}, base=[{"name": "slope", "pitch": 0.3}]),
    "backlash": moved({"width": 0.01, "inertia": 3.0}, q=sine(0.05, 2.0), duration=1.0),
    "command_delay": moved({"delay": 0.05}),
    "actuation_delay": moved({"delay": 0.012}),
    "torque_hold": moved({"period": 0.02}),
    "joint_offset": moved({"offset": 0.01}),
    "torque_bias": swing({"torque": 0.2}),
    "torque_ripple": swing({"sine": 0.15, "count": 12.0}),
    "friction_compensation": swing({"torque": 0.02, "damping": 0.01}),
    "gravity_compensation": swing({"share": 0.5}),
    "asymmetric_friction": moved({"forward": 20.0, "backward": 5.0}, **_TRACK),
    "coupled_friction": Fingerprint(
        "hyq_leg", {"torque": 30.0}, q=sine(0.2, 1.0), duration=1.5, after=0.5, joint=1
    ),
    "learned_residual": swing(
        {"weights": (0.0, 0.0, 0.0, 0.5, *[0.0] * 14), "travel": 1.2, "speed": 99.0}, duration=2.5
    ),
    # compliance
    "stiffness_error": ring({"error": 0.5}),
    "added_stiffness": swing({"stiffness": 1.0}, duration=2.5),
    "cubic_stiffness": swing({"cubic": 1.5}, duration=2.5),
    "spring_saturation": ring({"lost": 0.8, "torque": 2.0}),
    "rest_angle_error": ring({"offset": 0.03}),
    "end_stop": swing({"angle": 0.5, "stiffness": 20.0, "damping": 0.05}, begin=-1.0, duration=2.5),
    "hysteresis": ring({"torque": 1.5, "stroke": 0.02}),
    "viscoelasticity": ring({"stiffness": 30.0, "time": 0.1}),
    "series_elasticity": moved({"compliance": 5e-4, "inertia": 1.0, "damping": 5.0}),
    # body
    "payload": swing({"mass": 0.3, "position": (0.0, 0.0, -0.1)}, duration=2.5),
    "com_offset": swing({"offset": (0.05, 0.0, 0.0)}, duration=2.5),
    "armature": swing({"inertia": 0.02}, duration=2.5),
    "trunk_flex": tigrillo(
        {"compliance": 0.3, "damping": 0.01}, y="pitch", labels=("time [s]", "pitch [rad]")
    ),
    "cable_force": swing(
        {"stiffness": 3.0, "anchor": (0.4, 0.0, 0.5), "length": 0.2, "point": (0.0, 0.0, -0.4)},
        duration=2.5,
    ),
    # contact
    "foot_friction": tigrillo({"error": 4.0}, y="forward", labels=("time [s]", "forward [m]")),
    "slip": tigrillo(
        {"loss": 1.0},
        y="forward",
        labels=("time [s]", "forward [m]"),
        base=[{"name": "foot_friction", "error": 6.0}],
    ),
    "soft_patches": tigrillo(
        {"compliance": 2e-3, "damping": 5.0, "length": 0.1, "flat": 0.0},
        y="pitch",
        labels=("time [s]", "pitch [rad]"),
    ),
    "terrain": tigrillo(
        {"roughness": 0.01, "length": 0.1, "flat": 0.0},
        y="pitch",
        labels=("time [s]", "pitch [rad]"),
    ),
    "ground_compliance": tigrillo({"compliance": 2e-3, "damping": 5.0}, **_LEAN),
    "ground_height": tigrillo(
        {"height": 0.008, "foot": "lf_foot"}, y="pitch", labels=("time [s]", "pitch [rad]")
    ),
    "slope": tigrillo(
        {"pitch": 0.15}, y="ahead", labels=("time [s]", "IMU ahead [m/s²]"), q=step(0.0)
    ),
    # sensor
    "sensor_bias": sensed({"q": 0.02}),
    "sensor_gain": sensed({"q": 0.3}),
    "sensor_nonlinearity": sensed({"quadratic": 3.0, "cubic": 8.0}),
    "quantisation": sensed({"step": 0.02}),
    "sensor_latency": sensed({"delay": 0.05}),
    "sensor_noise": sensed({"q": 0.005}, x="t", labels=("time [s]", "sensor [m]")),
    "sensor_stuck": sensed(
        {"channel": "q", "start": 0.4}, x="t", labels=("time [s]", "sensor [m]")
    ),
    "imu_tilt": tigrillo({"pitch": 0.1}, y="ahead", labels=("time [s]", "IMU ahead [m/s²]")),
    # outside
    "constant_force": swing({"force": (0.3, 0.0, 0.0), "point": (0.0, 0.0, -0.4)}, begin=0.0),
    "push": swing({"force": (0.3, 0.0, 0.0), "random": 0.5, "point": (0.0, 0.0, -0.4)}, begin=0.0),
    "command_dropout": moved({"probability": 0.8}, q=ramp(0.1)),
    "command_rate_limit": moved({"slowness": 5.0}),
}
