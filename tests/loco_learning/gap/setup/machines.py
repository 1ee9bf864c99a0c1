# SPDX-License-Identifier: Apache-2.0
"""Five machines of other code than loco's: what a recording of each would hold, as files.

A two-link arm, the same with rotors behind its gears or with stiff drives, a pendulum that is told
torques, and a lift that carries an arm.
Lagrange's equations by hand, Runge-Kutta in steps of a millisecond, dry friction, noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import cos, sin
from pathlib import Path

import numpy as np
import yaml

GRAVITY, STEP, EVERY, SECONDS = 9.81, 1e-3, 5, 4.0
ROD = '<inertia ixx="{i}" iyy="{i}" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'


def link(name: str, mass: float, centre: float, inertia: float) -> str:
    return (f'<link name="{name}"><inertial><origin xyz="0 0 {-centre}"/><mass value="{mass}"/>'
            f'{ROD.format(i=inertia)}</inertial></link>')  # fmt: skip


def joint(name: str, parent: str, kind: str, at: float, axis: str, limits: tuple) -> str:
    low, high, effort, speed = limits
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{name}_link"/><origin xyz="0 0 {at}"/><axis xyz="{axis}"/>'
        f'<limit lower="{low}" upper="{high}" effort="{effort}" velocity="{speed}"/></joint>'
    )


@dataclass
class Machine:
    """A robot and its equations.

    Attributes:
        joints: Names.
        urdf: Links and joints.
        acceleration: Of (q, dq, tau, gravity's direction), (n,).
        kp, kd: Gains of the drives; none: torques are commanded.
        size: Amplitude of the commands.
        friction: Dry friction [N·m or N].
    """

    joints: tuple[str, ...]
    urdf: str
    acceleration: Callable
    kp: tuple[float, ...] = ()
    kd: tuple[float, ...] = ()
    size: tuple[float, ...] = (0.5, 0.5)
    friction: float = 0.05
    robot: dict = field(default_factory=dict)

    def record(
        self, seed: int, tilt: float = 0.0, carried: bool = False, friction: float = 0.0
    ) -> dict[str, np.ndarray]:
        """Even samples of t, and per joint q, tau and cmd.

        Args:
            seed: Seed of command and noise.
            tilt: Angle by which the bench is inclined about the axis of the arm [rad].
            carried: The drives carry the weight besides.
            friction: Dry friction instead of that of the machine [N·m]; 0 for its own.
        """
        if friction:
            return replace(self, friction=friction).record(seed, tilt, carried)
        rng, n = np.random.default_rng(seed), len(self.joints)
        told = self._command(rng)
        q, dq, rows = told(0.0) if self.kp else np.zeros(n), np.zeros(n), []
        down = np.array([np.sin(tilt), -np.cos(tilt)]) * GRAVITY
        for k in range(round(SECONDS / STEP)):
            if k % EVERY == 0:
                held = told(k * STEP)
            tau = self._torque(held, q, dq)
            if carried:  # what keeps it at rest
                still = self.acceleration(q, 0.0 * dq, np.zeros(n), down)
                tau = tau - np.linalg.solve(self._mobility(q), still)
            if k % EVERY == 0:
                rows.append(np.concatenate([[k * STEP], q, tau, held]))
            q, dq = self._step(q, dq, tau, down)
        data = np.array(rows)
        noise = rng.normal(size=(len(data), 2 * n)) * np.repeat([1e-4, 0.01], n)
        data[:, 1 : 1 + 2 * n] += noise
        names = [f"{what}_{j}" for what in ("q", "tau", "cmd") for j in self.joints]
        return dict(zip(["t", *names], data.T, strict=True))

    def _command(self, rng: np.random.Generator) -> Callable[[float], np.ndarray]:
        """Sum of sines, another one for each joint."""
        n = len(self.joints)
        f, p = rng.uniform(0.2, 1.6, (n, 5)), rng.uniform(0.0, 6.0, (n, 5))

        def at(t: float) -> np.ndarray:
            wave = np.sum(np.sin(2.0 * np.pi * f * t + p) - np.sin(p), axis=1) / np.sqrt(5.0)
            return np.array(self.size) * min(1.0, t) * wave

        return at

    def _torque(self, told: np.ndarray, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        return np.array(self.kp) * (told - q) - np.array(self.kd) * dq if self.kp else told.copy()

    def _mobility(self, q: np.ndarray) -> np.ndarray:
        """Acceleration of each joint per torque, (n, n)."""
        n, none = len(q), np.zeros(2)
        return np.stack([self.acceleration(q, np.zeros(n), e, none) for e in np.eye(n)], axis=1)

    def _step(self, q, dq, tau, down):
        def rate(q, dq):
            return self.acceleration(q, dq, tau - self.friction * np.tanh(dq / 5e-3), down)

        a = rate(q, dq)
        b = rate(q + 0.5 * STEP * dq, dq + 0.5 * STEP * a)
        middle = dq + 0.5 * STEP * b
        return q + STEP * middle, dq + STEP * rate(q + 0.5 * STEP * middle, middle)

    def write(self, folder: Path, records: list[dict], **more: object) -> Path:
        """Robot, mapping and recordings in a folder.

        Args:
            folder: Folder, made.
            records: Recordings as `record` makes them.
            more: Other values of robot.yaml.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "machine.urdf").write_text(
            f'<robot name="m"><link name="base"/>{self.urdf}</robot>'
        )
        drives = {
            j: {"kind": "impedance", "kp": self.kp[i], "kd": self.kd[i]}
            if self.kp
            else {"kind": "torque"}
            for i, j in enumerate(self.joints)
        }
        values = {"urdf": "machine.urdf", "fixed_base": True, "height": 1.0,
                  "joints": list(self.joints), "control_rate": 200, "drives": drives}  # fmt: skip
        (folder / "robot.yaml").write_text(yaml.safe_dump({**values, **self.robot, **more}))
        kind = "position" if self.kp else "torque"
        columns = [
            {"column": f"{what}_{j}", "role": role, "joint": j}
            for j in self.joints
            for what, role in (("q", "q"), ("dq", "dq"), ("tau", "tau"), ("cmd", f"command_{kind}"))
            if f"{what}_{j}" in records[0]
        ]
        mapping = {"files": "*.csv", "time": {"column": "t"}, "columns": columns}
        (folder / "mapping.yaml").write_text(yaml.safe_dump(mapping))
        for k, data in enumerate(records):
            table = np.stack(list(data.values()), axis=1)
            np.savetxt(folder / f"run{k}.csv", table, "%.7g", ",", header=",".join(data),
                       comments="")  # fmt: skip
        return folder


def solved(near, cross, far, x, y):
    """Accelerations of two joints, by the elements of their mass matrix and their torques."""
    determinant = near * far - cross**2
    return np.array([(far * x - cross * y) / determinant, (near * y - cross * x) / determinant])


def arm_acceleration(
    q, dq, tau, down, m=(1.0, 0.6), c=(0.15, 0.12), i=(0.0075, 0.00288), l=0.3, rotor=0.0
):
    (a, bend), (da, db), (x, y), (side, up) = (v.tolist() for v in (q, dq, tau, down))
    first, second = (cos(way) * side + sin(way) * up for way in (a, a + bend))  # along a tip's way
    h = m[1] * l * c[1]
    far = i[1] + m[1] * c[1] ** 2
    cross = far + h * cos(bend)
    near = i[0] + m[0] * c[0] ** 2 + m[1] * l**2 + 2.0 * cross - far
    x += h * sin(bend) * (2.0 * da * db + db**2) + (m[0] * c[0] + m[1] * l) * first
    y -= h * sin(bend) * da**2
    weight = m[1] * c[1] * second
    return solved(near + rotor, cross, far + rotor, x + weight, y + weight)


def pendulum_acceleration(q, dq, tau, down, m=1.5, c=0.4, i=0.03):
    return (tau + m * c * (np.cos(q) * down[0] + np.sin(q) * down[1])) / (i + m * c**2)


def lift_acceleration(q, dq, tau, down, m=(3.0, 0.8), c=0.2, i=0.012):
    (_, a), (_, da), (x, y), (side, up) = (v.tolist() for v in (q, dq, tau, down))
    s, k, h = sin(a), cos(a), m[1] * c
    x += sum(m) * up - h * k * da**2
    return solved(sum(m), h * s, i + h * c, x, y + h * (k * side + s * up))


TURNS = (-2.5, 2.5, 30.0, 12.0)
ARM = Machine(
    ("shoulder", "elbow"),
    link("shoulder_link", 1.0, 0.15, 0.0075) + link("elbow_link", 0.6, 0.12, 0.00288)
    + joint("shoulder", "base", "revolute", 0.0, "0 -1 0", TURNS)
    + joint("elbow", "shoulder_link", "revolute", -0.3, "0 -1 0", TURNS),
    arm_acceleration, kp=(40.0, 25.0), kd=(1.5, 0.8), size=(0.5, 0.7),
)  # fmt: skip
ROTOR = 0.01  # of each joint of the geared arm, behind its gear [kg·m²]
MACHINES = {
    "arm": ARM,
    "geared": replace(
        ARM, acceleration=partial(arm_acceleration, rotor=ROTOR), kp=(20.0, 20.0), kd=(0.6, 0.6),
        robot={"dynamics": {joint: {"armature": ROTOR} for joint in ARM.joints}},
    ),
    "stiff": replace(ARM, kp=(200.0, 125.0), kd=(6.0, 3.0)),
    "pendulum": Machine(
        ("swing",),
        link("swing_link", 1.5, 0.4, 0.03)
        + joint("swing", "base", "revolute", 0.0, "0 -1 0", (-3.1, 3.1, 20.0, 15.0)),
        pendulum_acceleration, size=(2.5,), friction=0.1,
    ),
    "lift": Machine(
        ("column", "arm"),
        link("column_link", 3.0, 0.0, 0.01) + link("arm_link", 0.8, 0.2, 0.012)
        + joint("column", "base", "prismatic", 0.0, "0 0 1", (-0.5, 0.5, 300.0, 2.0))
        + joint("arm", "column_link", "revolute", 0.0, "0 -1 0", TURNS),
        lift_acceleration, kp=(4000.0, 30.0), kd=(120.0, 1.2), size=(0.1, 0.6), friction=0.1,
    ),
}  # fmt: skip


@cache
def recordings(name: str, **about: object) -> list[dict[str, np.ndarray]]:
    """Two recordings of a machine, made once; whoever changes them copies them.

    Args:
        name: One of `MACHINES`.
        about: Arguments of `Machine.record`.
    """
    return [MACHINES[name].record(seed, **about) for seed in (1, 2)]
