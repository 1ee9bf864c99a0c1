# SPDX-License-Identifier: Apache-2.0
"""Mistakes of a set-up drawn by a seed: kind, machine, joint and size, as users make them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .machines import MACHINES, Machine, recordings

Change = Callable[[dict], None]
DEGREE = 180.0 / np.pi
ARMS = ("arm", "geared")


@dataclass(frozen=True)
class Mistake:
    """A mistake in the recordings or in the robot's file.

    Attributes:
        machine: Name of the machine.
        text: What was done.
        faults: Names under which it may be told.
        joints: Joints at which it has to be told; none for the whole robot.
        change: What is done to the columns of each recording.
        robot: Values of robot.yaml, and `about` for `Machine.record`.
    """

    machine: str
    text: str
    faults: frozenset[str]
    joints: tuple[str, ...] = ()
    change: Change | None = None
    robot: dict = field(default_factory=dict)


def _scaled(columns: list[str], factor: float) -> Change:
    def change(data: dict) -> None:
        for column in columns:
            data[column] = factor * data[column]

    return change


def _exchanged(a: str, b: str) -> Change:
    def change(data: dict) -> None:
        data[a], data[b] = data[b], data[a]

    return change


def _moved(column: str, offset: float) -> Change:
    def change(data: dict) -> None:
        data[column] = data[column] + offset

    return change


def _wrapped(column: str, period: float) -> Change:
    def change(data: dict) -> None:
        data[column] = (data[column] + 0.5 * period) % period - 0.5 * period

    return change


def _measured(joint: str, rows: int) -> Change:
    def change(data: dict) -> None:
        q = data[f"q_{joint}"]
        data[f"cmd_{joint}"] = np.concatenate([np.full(rows, q[0]), q[: len(q) - rows]])

    return change


def _ratio(rng: np.random.Generator) -> float:
    """A gear's reduction that was left out, or applied twice."""
    return float(rng.uniform(1.7, 6.0) ** rng.choice([-1.0, 1.0]))


def draw(seed: int, count: int) -> list[Mistake]:
    """Mistakes by a seed.

    Args:
        seed: Seed of kinds, joints and sizes.
        count: Number of mistakes.
    """
    rng = np.random.default_rng(seed)
    out: list[Mistake] = []
    while len(out) < count:
        machine = str(rng.choice(list(MACHINES)))
        kind = _KINDS[int(rng.integers(len(_KINDS)))]
        mistake = kind(rng, machine, MACHINES[machine], str(rng.choice(MACHINES[machine].joints)))
        if mistake:
            out.append(mistake)
    return out


def _turning(machine: str, joint: str) -> bool:
    return joint != "column"


def _sign(rng, name: str, machine: Machine, joint: str) -> Mistake:
    column = f"{rng.choice(['q', 'cmd'])}_{joint}"
    return Mistake(name, f"{column} x -1", frozenset({"sign"}), (joint,), _scaled([column], -1.0))


def _exchange(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name not in ARMS:  # a lift's column and arm have other units
        return None
    what, (a, b) = rng.choice(["q", "cmd"]), machine.joints
    change = _exchanged(f"{what}_{a}", f"{what}_{b}")
    return Mistake(name, f"{what} exchanged", frozenset({"exchanged"}), (a, b), change)


def _gear(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not machine.kp:  # a torque that is scaled is a mass that is scaled
        return None
    column, factor = f"{rng.choice(['q', 'cmd'])}_{joint}", _ratio(rng)
    change = _scaled([column], factor)
    return Mistake(name, f"{column} x {factor:.2f}", frozenset({"scale", "unit"}), (joint,), change)


def _reduced(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name not in ARMS:  # a torque alone, or a stiff column, moves a scaled joint as well
        return None
    factor = _ratio(rng)
    change = _scaled([f"{what}_{joint}" for what in ("q", "cmd")], factor)
    text = f"q and cmd of {joint} x {factor:.2f}"
    return Mistake(name, text, frozenset({"joint scale"}), (joint,), change)


def _unit(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    factor = DEGREE if _turning(name, joint) else 1000.0
    which = [["q"], ["cmd"], ["q", "cmd"]][int(rng.integers(3))] if machine.kp else ["q"]
    change = _scaled([f"{what}_{joint}" for what in which], factor)
    faults = frozenset({"unit", "scale", "joint scale"})
    return Mistake(name, f"{which} of {joint} x {factor:.1f}", faults, (joint,), change)


def _wrap(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not _turning(name, joint):
        return None
    period = float(rng.choice([np.pi / 2.0, 2.0 * np.pi / 3.0]))
    if max(np.ptp(data[f"q_{joint}"]) for data in recordings(name)) < 1.05 * period:
        return None  # it may never have jumped
    change = _wrapped(f"q_{joint}", period)
    return Mistake(name, f"{joint} wraps at {period:.3f}", frozenset({"wrap"}), (joint,), change)


def _turns(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not _turning(name, joint):
        return None
    what = str(rng.choice(["q", "cmd"])) if machine.kp else "q"
    turns = int(rng.choice([-3, -1, 1, 2]))
    change = _moved(f"{what}_{joint}", 2.0 * np.pi * turns)
    return Mistake(name, f"{what}_{joint} + {turns} turns", frozenset({"turns"}), (joint,), change)


def _axis(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name not in ARMS:  # where weight and inertia are the same about both sides nothing tells it
        return None
    change = _scaled([f"{what}_{joint}" for what in ("q", "cmd", "tau")], -1.0)
    return Mistake(name, f"axis of {joint} reversed", frozenset({"axis"}), (joint,), change)


def _gains(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not machine.kp:
        return None
    drives = {
        j: {"kind": "impedance", "kp": kp / DEGREE, "kd": kd / DEGREE}
        for j, kp, kd in zip(machine.joints, machine.kp, machine.kd, strict=True)
    }
    return Mistake(name, "gains per degree", frozenset({"gains"}), (), None, {"drives": drives})


def _masses(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name == "lift":
        return None  # its drives are stiff
    factor = float(rng.choice([0.1, 10.0, 1000.0]))
    arm = {"shoulder_link": 1.0, "elbow_link": 0.6}
    masses = {"arm": arm, "geared": arm, "stiff": arm, "pendulum": {"swing_link": 1.5}}
    values = {link: factor * mass for link, mass in masses[name].items()}
    return Mistake(
        name, f"masses x {factor:g}", frozenset({"masses"}), (), None, {"masses": values}
    )


def _carried(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name not in ARMS:  # a lift is stiff, and torques alone hold no pendulum without weight
        return None
    robot = {"about": {"carried": True}}
    return Mistake(name, "gravity carried", frozenset({"gravity carried"}), (), None, robot)


def _tilt(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if name == "lift":
        return None
    angle = -float(rng.uniform(0.45, 1.5))  # the other way a pendulum goes over the top
    if name in ARMS:
        angle = float(rng.choice([np.pi, angle, -angle]))
    robot = {"about": {"tilt": angle}}
    return Mistake(name, f"inclined by {angle:.2f}", frozenset({"gravity turned"}), (), None, robot)


def _ahead(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not machine.kp:
        return None
    rows = int(rng.integers(0, 6))
    change = _measured(joint, rows)
    text = f"command of {joint} measured, {rows} rows late"
    return Mistake(name, text, frozenset({"ahead"}), (joint,), change)


def _effort(rng, name: str, machine: Machine, joint: str) -> Mistake | None:
    if not machine.kp:
        return None  # there the effort is the command
    factor = float(rng.uniform(1.3, 20.0) ** rng.choice([-1.0, 1.0]))
    change = _scaled([f"tau_{joint}"], factor)
    return Mistake(name, f"tau_{joint} x {factor:.2f}", frozenset({"effort"}), (joint,), change)


_KINDS = (
    *(_sign, _exchange, _gear, _unit, _wrap, _turns, _axis, _gains, _masses, _carried, _tilt),
    *(_ahead, _effort, _reduced),
)
