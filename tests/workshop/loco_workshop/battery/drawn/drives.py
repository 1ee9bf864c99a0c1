# SPDX-License-Identifier: Apache-2.0
"""Random drive laws with gains for the inertia of a robot, as constants and as robot.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics import slots
from .bodies import Body

FREQUENCY = (1.2, 6.0)  # of the closed loop of each joint by itself [Hz]
DAMPING = (0.6, 1.2)  # its damping ratio
SLOW = (0.1, 0.25)  # rate of an integrator, share of that at which the loop is damped
SAG = 0.3  # largest deflection under the weight [rad or m per m of a link]
STRONG = (1.5, 4.0)  # torque limit, share of what weight and motion need
HELD = 0.4  # share of robots whose torque is sampled and held
STEADY = 0.4  # largest share of the speed that a held torque may take away in a period
KINDS = {  # of drive: share of the robots
    "impedance": 0.25, "weight": 0.1, "pid": 0.15, "cascade": 0.15, "servo": 0.15, "velocity": 0.1,
    "torque": 0.1,
}  # fmt: skip


@dataclass(frozen=True)
class Loop:
    """Drives of n joints.

    Attributes:
        kind: Kind of drive, from `KINDS`.
        rows: Their constants, (n, slots.DRIVE).
        told: Sections of robot.yaml, one for each joint.
        commands: Parts of a command: position, velocity, effort.
        weight: Whether the weight is fed forward.
        stiffness: Torque per deflection [N·m/rad], (n,).
        damping: Torque per speed [N·m·s/rad], (n,).
        frequency: Natural frequency of a joint by itself [Hz].
    """

    kind: str
    rows: np.ndarray
    told: list[dict[str, Any]]
    commands: tuple[str, ...]
    weight: bool
    stiffness: np.ndarray
    damping: np.ndarray
    frequency: float


def poles(
    rows: np.ndarray, springs: np.ndarray, mass: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """Poles of the driven robot about a pose, with continuous torques [1/s].

    Args:
        rows: Constants of the drives, (n, slots.DRIVE).
        springs: Constants of the springs, (n, slots.SPRING).
        mass: Mass matrix [kg·m²], (n, n).
        weight: Derivative of the torques that hold the weight by position [N·m/rad], (n, n).
    """
    n = len(rows)
    looped, servo = rows[:, 0] == slots.IMPEDANCE, rows[:, 0] == slots.SERVO
    kp = np.where(looped, rows[:, 1] + rows[:, 2] * rows[:, 5], servo * rows[:, 1] * rows[:, 3])
    kd = np.where(looped, rows[:, 2], servo * rows[:, 2])
    ki = looped * (rows[:, 3] + rows[:, 4] * rows[:, 5])
    speed_ki = looped * rows[:, 4]
    winds = np.flatnonzero(ki + speed_ki > 0.0)
    whole = np.zeros((2 * n + len(winds), 2 * n + len(winds)))
    back = -np.linalg.inv(mass)
    whole[:n, n : 2 * n] = np.eye(n)
    whole[n : 2 * n, :n] = back @ (np.diag(kp + springs[:, 1]) + weight)
    whole[n : 2 * n, n : 2 * n] = back @ np.diag(kd + springs[:, 2])
    whole[n : 2 * n, 2 * n :] = -back[:, winds]
    whole[2 * n :, :n] = -np.diag(ki)[winds]
    whole[2 * n :, n : 2 * n] = -np.diag(speed_ki)[winds]
    found = np.linalg.eigvals(whole)
    drifts = np.sum(winds.size and (ki[winds] == 0.0))  # a velocity loop holds any position
    return np.sort_complex(found)[::-1][int(drifts) :]


def stiffest(mass: np.ndarray) -> float:
    """Largest eigenvalue of M^-1 diag(M): how much faster joints are together than alone."""
    return float(np.max(np.linalg.eigvals(np.linalg.solve(mass, np.diag(np.diag(mass)))).real))


def draw(rng: np.random.Generator, mass: np.ndarray, weight: np.ndarray, body: Body) -> Loop:
    """Drives of a robot.

    Args:
        rng: Generator.
        mass: Mass matrix in the standing pose [kg·m²], (n, n).
        weight: Torques that hold the robot there [N·m], (n,).
        body: The robot.
    """
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    own = np.diag(mass)
    ratio = rng.uniform(*DAMPING)
    omega = 2.0 * np.pi * np.exp(rng.uniform(*np.log(FREQUENCY)))
    unit = np.where(body.slides, body.lengths, 1.0)
    omega = max(omega, float(np.sqrt(np.max(np.abs(weight) / (SAG * unit * own)))))
    k = _short(own * omega**2 * rng.uniform(0.8, 1.25, len(own)))
    d = _short(2.0 * ratio * np.sqrt(k * own))
    needed = np.abs(weight) + 0.5 * omega**2 * np.abs(mass) @ body.span
    effort, slow = _short(rng.uniform(*STRONG) * needed), rng.uniform(*SLOW) * 2.0 * ratio * omega
    rows = np.zeros((len(own), slots.DRIVE))
    rows[:, 0], rows[:, 8] = slots.IMPEDANCE, effort
    rows[:, 6], rows[:, 7] = 1.0, np.inf
    told: dict[str, np.ndarray] = {}
    with_speed = ("position", "velocity") if rng.random() < 0.65 else ("position",)
    commands = with_speed
    if kind in ("impedance", "weight", "pid"):
        told = {"kp": k, "kd": d}
    if kind == "weight":
        commands = (*with_speed, "effort")
    elif kind == "pid":
        told |= {"ki": _short(slow * k), "integral_limit": _short(rng.uniform(0.5, 1.0) * effort)}
    elif kind == "cascade":
        told = {
            "kd": d, "position_gain": _short(k / d),
            "speed_ki": _short(slow * d) if rng.random() < 0.7 else np.zeros(len(own)),
            "integral_limit": effort,
            "speed_feed": np.full(len(own), _short(rng.uniform(0.3, 1.0))),
        }  # fmt: skip
    elif kind == "velocity":
        told, commands = {"kd": d, "speed_ki": k}, ("velocity", "effort")
    elif kind == "servo":
        rows[:, 0], commands = slots.SERVO, ("position",)
        told = {
            "stall_torque": effort,
            "no_load_speed": _short(effort / d),
            "kp": _short(k / effort),
        }
        rows[:, 1:4] = np.transpose([effort, effort / told["no_load_speed"], told["kp"]])
    elif kind == "torque":
        rows[:, 0], rows[:, 6:8], commands = slots.TORQUE, 0.0, ("effort",)
        told = _motor(rng, d)
        rows[:, 1:4] = np.transpose([told["gain"], told["bias"], told["slope"]])
    if rows[0, 0] == slots.IMPEDANCE:
        names = ("kp", "kd", "ki", "speed_ki", "position_gain", "speed_feed", "integral_limit")
        for column, name in enumerate(names, 1):
            rows[:, column] = told.get(name, rows[:, column])
    name = {slots.SERVO: "servo", slots.TORQUE: "torque"}.get(rows[0, 0], "impedance")
    sections = [
        {"kind": name, **{key: float(values[j]) for key, values in told.items()}}
        for j in range(len(own))
    ]
    feeds = "effort" in commands and kind != "torque"
    return Loop(kind, rows, sections, commands, feeds, k, d, omega / 2.0 / np.pi)


def held(loop: Loop, period: float, control: float) -> None:
    """Sample the torque of all drives each `period` [s]; `control` is the control period [s]."""
    loop.rows[:, 9] = period
    for section in loop.told:
        section["torque"] = "held"
        if period != control:
            section["period"] = period


def _motor(rng: np.random.Generator, damping: np.ndarray) -> dict[str, np.ndarray]:
    """Motors commanded by torque, current or voltage."""
    way, n = rng.integers(3), len(damping)
    gain = np.ones(n) if way == 0 else _short(np.exp(rng.uniform(-3.0, 0.7, n)))
    slope = _short(0.3 * damping) if way == 2 else np.zeros(n)
    return {"gain": gain, "bias": np.zeros(n), "slope": slope}


def _short(values: Any) -> Any:
    """Values with four digits, as in a file."""
    return np.vectorize(lambda value: float(f"{value:.4g}"))(values)
