# SPDX-License-Identifier: Apache-2.0
"""Nominal robots of the battery, defined independently of loco's robot files.

Sources are docs/tigrillo.md, docs/robot_yaml.md and the URDFs. Drives, springs and sensors are
repeated here and not taken from the plant, so that an error there appears as a gap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingPackageError, NameUnknownError

from . import slots, tree

GRAVITY = 9.81  # [m/s²]


@dataclass(frozen=True)
class Sensor:
    """Resolution and noise of a joint sensor.

    Attributes:
        step: Resolution [rad].
        noise: Standard deviation before rounding [rad].
        table: Angles [rad] and counts of a Hall sensor, empty for other sensors; with a table
            `step` and `noise` are in counts.
    """

    step: float = 0.0
    noise: float = 0.0
    table: tuple[tuple[float, ...], tuple[float, ...]] = ((), ())


@dataclass(frozen=True)
class Record:
    """A recording of a machine.

    Attributes:
        name: Name, part of the name of its bag.
        kind: Kind of excitation, from `excitation.MAKERS`.
        seconds: Duration [s]; 0 is `excitation.DURATION`.
        judge: Whether it is held out.
    """

    name: str
    kind: str
    seconds: float = 0.0
    judge: bool = False


RECORDS = (  # of machines that do not say otherwise
    *(Record(kind, kind) for kind in ("chirp", "steps", "ramp")),
    Record("mix", "mix", judge=True),
)
OFF = (0.03, 0.05, 0.03)  # largest errors of mass, inertia and motor of a model that is off
DEVIATION = (0.02, 0.04, 0.02, 0.02)  # of mass, inertia, motor, servo speed


@dataclass(frozen=True)
class Machine:
    """A robot of the battery.

    Attributes:
        name: Name of the robot in the workflow.
        body: Moving bodies.
        rate: Rate of commands and readings [Hz].
        drives: Constants of the drives, one row per joint, (n, DRIVE).
        springs: Constants of the springs, one row per joint, (n, SPRING).
        start: Joint positions of the standing pose [rad], (n,).
        rest: Rest position of each joint's spring, else the standing pose [rad], (n,).
        sensors: Sensor of each joint.
        centre: Centre of the excitation of the driven joints [rad], (m,); `span` is its amplitude.
        fast: Largest speed of a command [rad/s], one for all or (m,).
        band: Lowest and highest frequency of a chirp [Hz].
        torque_noise: Noise of the torque sensors [N·m], 0 without torque sensors.
        overrides: Values of robot.yaml in which the set-up differs.
        known: Known differences of the set-up as effects, such as attached weights.
        steps: Integration steps per tick.
        quick: Integration steps per tick during the search for sizes; 0 means half of `steps`.
        motor: Ratio of actual to modelled torque of each drive, (n,); None means 1.
        robot: Name of the robot for the workflow, if it differs.
        urdf: URDF of a robot that loco lacks, a file or its text.
        about: Contents of robot.yaml of a robot that loco lacks; by default made from the drives.
        commands: Parts of a command, from ``position``, ``velocity`` and ``effort``.
        weight: Whether the command feeds forward the torque of the weight at its position.
        records: Recordings of a case.
        readings: Rate of the readings [Hz]; 0 is `rate`.
        jitter: Standard deviation of the time at which the sensors are read [s].
        speed_noise: Noise of the velocity sensors [rad/s], (n,), or None without them.
        doubt: Standard deviations of mass, inertia, motor and servo speed that the model states,
            as shares, (4,).
        drive: Kind of its drives, for the score.
        settle: Time for which the first command is held before a record [s], if longer than usual.
        off: Largest errors of mass, inertia and motor of a model that is a little off, as shares.
    """

    name: str
    body: tree.Tree
    rate: float
    drives: np.ndarray
    springs: np.ndarray
    start: np.ndarray
    rest: np.ndarray
    sensors: tuple[Sensor, ...]
    centre: np.ndarray
    span: np.ndarray
    fast: float | np.ndarray
    band: tuple[float, float]
    torque_noise: float = 0.0
    overrides: dict[str, Any] = field(default_factory=dict)
    known: tuple[dict[str, Any], ...] = ()
    steps: int = 80
    quick: int = 0
    motor: np.ndarray | None = None
    robot: str = ""
    urdf: Path | str | None = None
    about: dict[str, Any] = field(default_factory=dict)
    commands: tuple[str, ...] = ("position", "velocity")
    weight: bool = False
    records: tuple[Record, ...] = RECORDS
    readings: float = 0.0
    jitter: float = 0.0
    speed_noise: np.ndarray | None = None
    doubt: tuple[float, ...] = DEVIATION
    off: tuple[float, float, float] = OFF
    settle: float = 0.0
    drive: str = ""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints."""
        return self.body.joints

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return self.body.links

    @property
    def driven(self) -> np.ndarray:
        """Indices of the joints with a drive, (m,)."""
        return np.flatnonzero(self.drives[:, 0] != slots.FREE)

    @property
    def sprung(self) -> np.ndarray:
        """Indices of the joints with a spring."""
        return np.flatnonzero(self.springs[:, 0] > 0.0)

    @property
    def servo(self) -> bool:
        """Whether the drives are servos."""
        return bool(np.any(self.drives[:, 0] == slots.SERVO))

    @property
    def integrates(self) -> bool:
        """Whether a drive has an integrator, whose state a recording does not tell."""
        return bool(np.any(self.drives[self.drives[:, 0] == slots.IMPEDANCE, 3:5] > 0.0))

    def speed(self, column: int) -> float:
        """Largest speed of a driven joint, by its column of the command [rad/s]."""
        return float(np.broadcast_to(self.fast, len(self.driven))[column])

    def with_steps(self, steps: int) -> Machine:
        """The machine with another number of integration steps per tick."""
        return replace(self, steps=steps)


def _urdf(name: str, file: str = "") -> Path:
    # Generator and plant share only the URDF.
    folder = find_spec("loco_sim").submodule_search_locations[0]
    return Path(folder) / "assets" / name / f"{file or name}.urdf"


def _servo(n: int, driven: list[int], effort: float = 2.6) -> np.ndarray:
    """Drive constants of Dynamixel RX-24F (12 V, gear 193 : 1) on driven joints, (n, DRIVE)."""
    rows = np.zeros((n, slots.DRIVE))
    rows[driven] = (slots.SERVO, 2.6, 2.6 / 13.2, 6.2, 0.00506, 0.003, 30.0, 0.05, effort, 0.0)
    return rows


def _impedance(kp: Any, kd: Any, effort: Any) -> np.ndarray:
    """Drive constants of impedance drives, (n, DRIVE)."""
    rows = np.zeros((len(kp), slots.DRIVE))
    rows[:, 0], rows[:, 1], rows[:, 2] = slots.IMPEDANCE, kp, kd
    rows[:, 6:9] = np.transpose(np.broadcast_arrays(np.ones(len(kp)), np.inf, effort))
    return rows


def servo_pendulum() -> Machine:
    """A rod of 0.5 kg and 0.4 m on a servo."""
    body = tree.read(_urdf("servo_pendulum"), ["pivot"])
    return Machine(
        "servo_pendulum", body, 100.0, _servo(1, [0]), np.zeros((1, slots.SPRING)),
        np.zeros(1), np.zeros(1), (Sensor(0.00506),), np.zeros(1), np.array([0.9]), 6.0,
        (0.2, 3.0), steps=80, commands=("position",),
    )  # fmt: skip


def linear_axis() -> Machine:
    """A carriage of 1.5 kg on a rail, with an impedance drive of 2000 N/m and 60 N·s/m."""
    body = tree.read(_urdf("linear_axis"), ["slide"])
    drives = _impedance([2000.0], [60.0], 60.0)
    return Machine(
        "linear_axis", body, 250.0, drives, np.zeros((1, slots.SPRING)), np.zeros(1), np.zeros(1),
        (Sensor(1e-5, 5e-5),), np.zeros(1), np.array([0.15]), 1.0, (0.3, 5.0), steps=16,
    )  # fmt: skip


def hyq_leg() -> Machine:
    """The left front leg of HyQ on a fixed trunk, with the gains of a swing leg."""
    names = ["lf_haa_joint", "lf_hfe_joint", "lf_kfe_joint"]
    start = np.array([-0.121072, 0.695151, -1.418375])
    drives = _impedance((150.0, 250.0, 250.0), (12.0, 8.0, 6.0), 150.0)
    return Machine(
        "hyq_leg", tree.read(_urdf("hyq"), names), 250.0, drives, np.zeros((3, slots.SPRING)),
        start, start, (Sensor(8e-5, 4e-5),) * 3, np.array([-0.2, 0.4, -1.4]),
        np.array([0.2, 0.5, 0.6]), 6.0, (0.3, 4.0), torque_noise=0.2, steps=16,
    )  # fmt: skip


HALL = {  # angles [°] and counts, docs/tigrillo.md
    "lf": ((40, 49, 55, 60, 70, 80, 90, 100, 110, 120, 180),
           (0, 1300, 1810, 2205, 2640, 2800, 2870, 2910, 2931, 2940, 3200)),
    "rf": ((40, 56, 60, 70, 80, 90, 100, 110, 120, 180),
           (0, 1202, 1600, 2320, 2630, 2760, 2850, 2890, 2910, 3200)),
    "lh": ((40, 49, 55, 60, 70, 80, 90, 100, 110, 120, 180),
           (0, 133, 280, 1110, 2215, 2590, 2773, 2854, 2890, 2915, 3200)),
    "rh": ((48, 54, 60, 70, 80, 90, 100, 110, 120, 180),
           (0, 131, 640, 2170, 2620, 2760, 2850, 2895, 2920, 3200)),
}  # fmt: skip
STOPS = {"lf": 0.88, "rf": 0.96, "lh": 0.863, "rh": 0.94}  # smallest knee angles [rad]


WEIGHT, FOOT = 0.15, (0.0, 0.0, -0.055)  # lead weight on each foot [kg], and its position [m]


def tigrillo() -> Machine:
    """Tigrillo with its trunk fixed in the air: hips driven by servos, knees on springs.

    A weight on each foot makes the knees leave their stops; without it they would not.
    """
    names = [f"{leg}_{joint}" for leg in HALL for joint in ("hfe_joint", "kfe_joint")]
    body = tree.read(_urdf("tigrillo"), names)
    knees, hips = [1, 3, 5, 7], [0, 2, 4, 6]
    body.lower[knees] = list(STOPS.values())
    shanks = [f"{leg}_lower_leg" for leg in HALL]
    for shank in shanks:
        body.add_point(shank, WEIGHT, FOOT)
    measured = tuple(
        {"name": "payload", "link": shank, "mass": WEIGHT, "position": list(FOOT)}
        for shank in shanks
    )
    femur, tibia, length = 0.045, 0.035, 0.025
    springs = np.zeros((8, slots.SPRING))
    springs[knees] = (2.0, 181.6, 0.01, length, femur, tibia)
    slack = np.arccos((femur**2 + tibia**2 - length**2) / (2.0 * femur * tibia))
    sensors = []
    for angles, counts in HALL.values():
        table = tuple(np.deg2rad(angles).tolist()), tuple(map(float, counts))
        sensors += [Sensor(0.00506), Sensor(1.0, 1.0, table)]
    return Machine(
        "tigrillo", body, 100.0, _servo(8, hips), springs, np.array([-0.5, 1.0] * 4),
        np.array([-0.5, slack] * 4), tuple(sensors), np.full(4, 0.3), np.full(4, 0.6), 9.0,
        (0.3, 3.0), overrides={"fixed_base": True, "height": 1.0}, known=measured,
        steps=160, quick=40, commands=("position",),
    )  # fmt: skip


def hyq_air() -> Machine:
    """The whole HyQ with its trunk fixed in the air: twelve joints, stance gains."""
    names = [f"{leg}_{joint}_joint" for leg in HALL for joint in ("haa", "hfe", "kfe")]
    start = np.tile([-0.121072, 0.695151, -1.418375], 4)
    start[6:] *= (1.0, -1.0, -1.0) * 2  # hind legs bend in the opposite direction
    gains = np.tile((150.0, 250.0, 150.0), 4), np.tile((10.0, 8.0, 6.0), 4)
    drives = _impedance(*gains, 150.0)
    return Machine(
        "hyq_air", tree.read(_urdf("hyq"), names), 250.0, drives, np.zeros((12, slots.SPRING)),
        start, start, (Sensor(8e-5, 4e-5),) * 12, start, np.tile([0.15, 0.4, 0.5], 4), 6.0,
        (0.3, 4.0), torque_noise=0.2, overrides={"fixed_base": True, "height": 1.5}, steps=16,
        robot="hyq",
    )  # fmt: skip


def _foreign(name: str, file: str, joints: list[str], gains: list, start: list) -> Machine:
    """A robot of `pybullet_data` fixed in the air, with impedance drives."""
    data = find_spec("pybullet_data")
    if data is None:
        raise MissingPackageError(f"the URDF of {name} comes with PyBullet, which is not installed")
    urdf = Path(data.submodule_search_locations[0]) / file
    body, n = tree.read(urdf, joints), len(joints)
    drives, at = _impedance(*np.transpose(gains), body.effort), np.array(start)
    return Machine(
        name, body, 250.0, drives, np.zeros((n, slots.SPRING)), at, at,
        (Sensor(5e-5, 2e-5),) * n, at, np.full(n, 0.4), 2.0, (0.2, 2.0), torque_noise=0.1,
        steps=32, urdf=urdf,
    )  # fmt: skip


def kuka_iiwa() -> Machine:
    """The seven-joint arm iiwa of `pybullet_data`, with the gains of a compliant arm."""
    gains = [(200.0, 15.0), (800.0, 60.0), (100.0, 6.0), (300.0, 20.0), (20.0, 1.0), (20.0, 0.8),
             (8.0, 0.12)]  # fmt: skip
    joints = [f"lbr_iiwa_joint_{i}" for i in range(1, 8)]
    start = [0.0, 0.4, 0.0, -1.0, 0.0, 0.6, 0.0]
    return _foreign("kuka_iiwa", "kuka_iiwa/model.urdf", joints, gains, start)


def a1_air() -> Machine:
    """The twelve-joint quadruped A1 of `pybullet_data`, with a fixed trunk."""
    joints = [f"{leg}_{j}_joint" for leg in ("FR", "FL", "RR", "RL")
              for j in ("hip", "upper", "lower")]  # fmt: skip
    gains = [(40.0, 1.5), (40.0, 1.5), (30.0, 0.8)] * 4
    return _foreign("a1_air", "a1/a1.urdf", joints, gains, [0.0, 0.8, -1.6] * 4)


MACHINES: dict[str, Callable[[], Machine]] = {
    "servo_pendulum": servo_pendulum,
    "linear_axis": linear_axis,
    "hyq_leg": hyq_leg,
    "tigrillo": tigrillo,
    "hyq_air": hyq_air,
    "kuka_iiwa": kuka_iiwa,
    "a1_air": a1_air,
}
_made: dict[str, Machine] = {}


def get(name: str) -> Machine:
    """Machine by name; shared, so it must not be modified.

    Raises:
        NameUnknownError: There is no machine of that name.
    """
    if name not in MACHINES:
        raise NameUnknownError("robot of the battery", name, MACHINES)
    if name not in _made:
        _made[name] = MACHINES[name]()
    return _made[name]
