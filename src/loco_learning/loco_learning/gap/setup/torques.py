# SPDX-License-Identifier: Apache-2.0
"""Mistakes that joint torques tell: order, sign and unit of their columns; an inclined base.

Torques are regressed on what inverse dynamics needs along the measured motion, with dry and viscous
friction in each joint, and on the commands of each drive.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares, linear_sum_assignment, minimize_scalar, nnls

from loco_sim.bolted.loop import Bolted
from loco_sim.effects import EFFECTS, from_list
from loco_sim.geometry import rotate_back, rotation_matrix
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ImpedanceDrive, TorqueDrive

from ..prediction.led import SMOOTH, TRIM
from ..recordings.record import Record, bridged, spacing
from . import suspect
from .bench import Bench
from .commands import swap
from .finding import EFFECTS as ADDED
from .finding import JOINT, MAPPING, MODEL, OFFSET, SCALE, SIGN, UNIT, Change, Finding, roles_of
from .limits import LIMITS
from .signals import BLOCKS, regressed

ROWS = 400  # rows of all recordings together at which dynamics are computed (taste: 0.1 s)
REST = 0.05  # speed below which dry friction has no sign, over the rms of a joint (taste)
STOP = 0.02  # distance from a joint stop over the range, up to which it may hold (taste)
STEP = 1e-3  # change of a position for a derivative [rad or m]
APART = np.pi / 12.0  # distance of angles that are tried as another zero [rad] (taste)
ROUNDS = 4  # fits, each weighted by the errors of the one before (taste)
FINEST = 0.01  # least error of a torque over its rms: what a model misses at best (taste)
TAU, CMD = "tau", "command_torque"
_READ: WeakKeyDictionary[Bench, Torques | None] = WeakKeyDictionary()


@dataclass(frozen=True)
class Torques:
    """Joint torques and their causes, at T rows spread over all recordings, and n joints.

    Attributes:
        model: Robot, overrides and effects.
        robot: Robot of the first recording.
        tau: Measured torques [N·m or N], (T, n); NaN where not measured.
        commands: Commanded torques, and errors of position and velocity, (T, n, 3); NaN where not
            commanded, or where the drive does not follow them.
        q: Positions [rad or m], (T, n).
        speed: Velocities, (T, n).
        rate: Accelerations, (T, n).
        free: Torques that the motion needs without weight, (T, n); NaN if unknown.
        weight: Torques that hold the weight per component of gravity, (T, n, 3); NaN if unknown.
        gravity: Acceleration of gravity in the model [m/s²], (3,).
    """

    model: Model
    robot: Robot
    tau: np.ndarray
    commands: np.ndarray
    q: np.ndarray
    speed: np.ndarray
    rate: np.ndarray
    free: np.ndarray
    weight: np.ndarray
    gravity: np.ndarray

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Recorded torques by role, (T, n): measured ones, and commands that drives only pass."""
        passed = [isinstance(self.robot.drives.get(j), TorqueDrive) for j in self.robot.joints]
        return {TAU: self.tau, CMD: np.where(passed, self.commands[:, :, 0], np.nan)}

    def joint_torques(self, joint: int) -> np.ndarray:
        """Dry and viscous friction and a rotor, of 1 per unit of sign, speed and rate, (T, 3)."""
        speed = self.speed[:, joint]
        speed_scale = REST * np.sqrt(np.mean(speed**2)) + 1e-9
        return np.stack([np.tanh(speed / speed_scale), speed, self.rate[:, joint]], axis=1)

    def body_torque(self, joint: int) -> np.ndarray:
        """Torque of a joint that inertia and weight of the bodies need, (T,)."""
        return self.free[:, joint] + self.weight[:, joint] @ self.gravity

    def motion(self, joint: int) -> np.ndarray:
        """Torque that the bodies need, then those of the joint itself, (T, 4)."""
        return np.column_stack([self.body_torque(joint), self.joint_torques(joint)])

    def drive(self, joint: int) -> np.ndarray:
        """Causes of a torque by commands of its joint, (T, 0 to 3)."""
        commands = self.commands[:, joint]
        return commands[:, np.isfinite(commands).all(axis=0)]

    def driven(self, joint: int) -> np.ndarray:
        """Torque of a drive by its gains in robot.yaml, (T,); NaN if they do not determine it."""
        drive, commands = self.robot.drives.get(self.robot.joints[joint]), self.commands[:, joint]
        if isinstance(drive, TorqueDrive):
            return drive.motor_torque(commands[:, 0], self.speed[:, joint])
        if not isinstance(drive, ImpedanceDrive) or "drives" in self.robot.guessed:
            return np.full(len(commands), np.nan)
        return np.nan_to_num(commands[:, 0]) + commands[:, 1:] @ [drive.kp, drive.kd]

    def errors(self, role: str, sign: float = 1.0) -> np.ndarray:
        """Error of each torque (row) explained as that of each joint (column), (n, n).

        Over the deviation of the torque; 1 where it is not recorded or does not change.
        """
        out = np.ones((len(self.robot.joints),) * 2)
        for i, torque in enumerate(sign * self.columns[role].T):
            for j in range(len(out)):
                terms = [self.motion(j)] if role == CMD else [self.motion(j), self.drive(j)]
                out[i, j] = min(explained(term, torque)[1] for term in terms)
        return out

    def own_errors(self, role: str) -> np.ndarray:
        """Share of each torque that the motion of its own joint does not explain, (n,)."""
        columns = enumerate(self.columns[role].T)
        return np.array([explained(self.motion(i), torque)[1] for i, torque in columns])

    def missed(self) -> float:
        """Sum of the shares of all torques that the motion of their own joint does not explain."""
        return float(sum(self.own_errors(role).sum() for role in self.columns))

    def exchanged(self, i: int, j: int) -> Torques:
        """The same with the names of two joints exchanged in all columns."""
        order = np.arange(len(self.robot.joints))
        order[[i, j]] = j, i
        q, speed, rate = (values[:, order] for values in (self.q, self.speed, self.rate))
        free, weight = self.plant().needed(q, speed, rate)
        tau, commands = self.tau[:, order], self.commands[:, order]
        return replace(self, tau=tau, commands=commands, q=q, speed=speed, rate=rate, free=free,
                       weight=weight)  # fmt: skip

    def shifted(self, joint: int, offset: float, before: int | None = None) -> Torques:
        """The same with an offset on the angle of a joint [rad], less that of a joint before it."""
        values = [self.q, self.speed, self.rate]
        if before is not None:
            one = np.eye(len(self.robot.joints))[joint]
            values = [x - x[:, before, None] * one for x in values]
        values[0] = values[0] + offset * np.eye(len(self.robot.joints))[joint]
        free, weight = self.plant().needed(*values)
        q, speed, rate = values
        return replace(self, q=q, speed=speed, rate=rate, free=free, weight=weight)

    def plant(self, *effects: dict) -> Bolted:
        """Dynamics with further effects."""
        all_effects = from_list([*self.model.effects, *effects])
        return Bolted(replace(self.robot, sensors=None), all_effects)


def read(bench: Bench) -> Torques | None:
    """Torques and their causes in whole recordings, with the changes of a bench so far.

    Computed once for each bench. None if there are too few rows away from joint stops.
    """
    if bench not in _READ:
        _READ[bench] = _read(bench)
    return _READ[bench]


def _read(bench: Bench) -> Torques | None:
    model, records = bench.whole()
    tables, gravity = [], np.zeros(3)
    for record in records:
        robot = model.make_robot(record.overrides)
        table = _table(record, robot, max(ROWS // len(records), 2))
        none = np.full(table["q"].shape, np.nan)
        table |= {"free": none, "weight": np.stack([none] * 3, axis=2)}
        if not bench.free and not robot.springs and np.isfinite(table["q"]).all():
            plant = Bolted(replace(robot, sensors=None), from_list(model.effects))
            motion = (table[key] for key in ("q", "speed", "rate"))
            table["free"], table["weight"] = plant.needed(*motion)
            gravity = plant.gravity
        tables.append(table)
    arrays = {key: np.concatenate([table[key] for table in tables]) for key in tables[0]}
    if len(arrays["q"]) < LIMITS.samples:
        return None
    return Torques(model, model.make_robot(records[0].overrides), gravity=gravity, **arrays)


def _table(record: Record, robot: Robot, count: int) -> dict[str, np.ndarray]:
    """Smoothed motion, torques and commands at some rows of a recording."""
    q, tau = record.read_of(robot, "q"), record.read_of(robot, "tau")
    measured = np.flatnonzero(np.isfinite(q).any(axis=1))
    width = max(SMOOTH / record.dt, 2.0 * spacing(measured))
    low, high = np.transpose([Description(robot.urdf).limits(joint) for joint in robot.joints])
    margin = STOP * np.where(np.isfinite(high - low), high - low, 0.0)
    at = q[measured]  # far beyond a stop it is none: the limit, or the name of the joint, is wrong
    free = ~np.any((abs(at - low) < margin) | (abs(at - high) < margin), axis=1)
    inner = measured[(measured >= TRIM * width) & (measured < len(q) - TRIM * width) & free]
    rows = inner[np.linspace(0, len(inner) - 1, min(count, len(inner))).astype(int)]

    def smooth(values: np.ndarray, order: int = 0) -> np.ndarray:
        # a kernel cut at 4 deviations, as by default, takes a constant for an acceleration
        mean = gaussian_filter1d(bridged(values), width, axis=0, order=order, truncate=6.0)
        return np.where(np.isfinite(values).any(axis=0), mean, np.nan) / record.dt**order

    commands, speed = np.full((*q.shape, 3), np.nan), smooth(q, 1)
    for joint in set(record.driven) & set(robot.joints):
        i, k = robot.joints.index(joint), record.driven.index(joint)
        of = {kind: values[:, k] for kind, values in record.command.items()}
        drive = robot.drives.get(joint)
        commands[:, i, 0] = of.get("torque", np.nan)
        if "position" in of and not getattr(drive, "integrates", isinstance(drive, TorqueDrive)):
            commands[:, i, 1] = of["position"] - q[:, i]
            wish = getattr(drive, "speed_feed", 1.0) * of.get("velocity", 0.0)
            commands[:, i, 2] = wish - speed[:, i]
    commands = np.stack([smooth(commands[:, :, k]) for k in range(3)], axis=2)
    table = {"q": smooth(q), "speed": speed, "rate": smooth(q, 2), "tau": smooth(tau)}
    return {key: values[rows] for key, values in {**table, "commands": commands}.items()}


def explained(
    terms: np.ndarray, torque: np.ndarray, fixed_part: np.ndarray | float = 0.0
) -> tuple[np.ndarray, float]:
    """Regression of a torque on causes that do not act backwards, and on a constant.

    Args:
        terms: (T, k).
        torque: (T,).
        fixed_part: Part of the torque that is not fitted, (T,).

    Returns:
        Coefficients, (k,), not negative; the error over the deviation of the torque, 1 if
        something is unknown or the torque hardly changes.
    """
    size = float(np.linalg.norm(torque - torque.mean()))
    rest, terms = torque - fixed_part, terms - terms.mean(axis=0)
    lowest = LIMITS.varies * float(np.linalg.norm(torque))
    if not terms.size or not np.isfinite(rest.sum() + terms.sum()) or not size > lowest:
        return np.zeros(terms.shape[1]), 1.0
    by, error = nnls(terms, rest - rest.mean())
    return by, float(error) / size


def renamed(bench: Bench) -> list[Finding]:
    """Findings of pairs of joints that have each other's name in all columns.

    Commands cannot tell it, as each joint follows its own; the weight and inertia of the bodies
    can, where they explain the torques under the exchanged names alone.
    """
    torques = read(bench)
    if torques is None or not np.isfinite(torques.free).all():
        return []
    candidates = []
    for role in torques.columns:
        errors = np.maximum(torques.own_errors(role), FINEST)
        for pair in itertools.combinations(np.flatnonzero(errors < 1.0).tolist(), 2):
            before = errors.copy()  # of each torque, under the name that it gets
            before[[*pair]] = errors[[*pair[::-1]]]
            after = np.maximum(torques.exchanged(*pair).own_errors(role), FINEST)
            gains, best = np.log(before / after), int(np.argmax(before / after))
            if (
                gains.sum() > 2.0 * np.log(LIMITS.better)
                and gains.min() > -np.log(LIMITS.alike)
                and after[best] <= LIMITS.left
            ):
                candidates.append((float(gains.sum()), pair, best, before, after))
    if not candidates:
        return []
    _, pair, best, before, after = max(candidates, key=lambda candidate: candidate[0])
    a, b = (torques.robot.joints[i] for i in pair)
    note = (f"{a} and {b} have each other's name in all columns: with the names exchanged, weight "
            f"and inertia leave {after[best]:.0%} of the torque of {torques.robot.joints[best]} "
            f"unexplained, {before[best]:.0%} as it is")  # fmt: skip
    finding = Finding("exchanged", (a, b), note, swap(bench, a, b, ""))
    return [finding, *renamed(bench.mended(finding.mends))]


def exchanged(bench: Bench) -> list[Finding]:
    """Findings of joints whose torques are those of other joints."""
    torques, findings = read(bench), list[Finding]()
    for role in torques.columns if torques else ():
        errors = np.minimum(torques.errors(role), torques.errors(role, -1.0))
        to = linear_sum_assignment(np.log(np.maximum(errors, FINEST)))[1]
        for ring in _rings(to):
            after, before = errors[ring, to[ring]], np.diag(errors)[ring]
            if np.any(after > np.minimum(before / LIMITS.better, LIMITS.left)):
                continue
            pairs = [(torques.robot.joints[i], torques.robot.joints[to[i]]) for i in ring]
            notes = (f"{role} of {a} is that of {b}: {e:.0%} not explained, {o:.0%} as its own"
                     for (a, b), e, o in zip(pairs, after, before, strict=True))  # fmt: skip
            lines = tuple(Change(MAPPING, JOINT, b, role, a) for a, b in pairs)
            findings.append(
                Finding("exchanged", tuple(a for a, _ in pairs), ", ".join(notes), lines)
            )
    return findings


def _rings(to: np.ndarray) -> Iterator[list[int]]:
    """Cycles of a permutation, (n,), without those of one."""
    moved = set(np.flatnonzero(to != np.arange(len(to))).tolist())
    while moved:
        ring = [min(moved)]
        while (following := int(to[ring[-1]])) != ring[0]:
            ring.append(following)
        moved -= set(ring)
        yield ring


def zeros(bench: Bench) -> list[Finding]:
    """Findings of turning joints whose angle has another zero than in the URDF, or another base.

    Their torque is not explained as it is, but where the weight is that of another angle. If the
    torque with the other sign is explained as well, both lines are given.
    """
    torques = read(bench)
    if torques is None or not np.isfinite(torques.free).all() or not torques.gravity.any():
        return []
    cases = []
    for role, (i, joint) in itertools.product(torques.columns, enumerate(torques.robot.joints)):
        torque = torques.columns[role][:, i]
        before, opposite = (explained(torques.motion(i), x)[1] for x in (torque, -torque))
        limit = min(before / LIMITS.better, LIMITS.left, opposite * LIMITS.alike)
        fits = _zeros(torques, i, torque) if limit > FINEST else {}
        for base, (after, offset) in fits.items():
            is_offset = after < fits[""][0] / LIMITS.alike if base else abs(offset) >= LIMITS.zero
            if after <= limit and is_offset:
                cases.append((after / before, after, joint, role, base, offset, before, opposite))
    if not cases:
        return []
    _, after, joint, role, base, offset, before, opposite = min(cases)
    note = f"motion leaves {before:.0%} of {role} of {joint} unexplained, and {after:.0%}"
    if base:
        note += f" if q of {joint} is an angle from the link before {base}: write its difference " \
                f"to q of {base} into the recording"  # fmt: skip
        return [Finding("zero", (joint,), note)]
    note += f" with {np.degrees(offset):+.0f} degrees on q: the zero of the log is not that of " \
            "the URDF"  # fmt: skip
    i = torques.robot.joints.index(joint)
    error = np.nan_to_num(np.median(torques.commands[:, i, 1]))  # of the command, less q
    # The command has the zero of q if both keep together: else q is as far away as its zero.
    own_zero = abs(_angle(error)) > abs(_angle(error - offset))
    roles = {of for record in bench.whole()[1] for of in roles_of(record, joint)}
    lines = tuple(Change(MAPPING, OFFSET, round(offset, 3), of, joint)
                  for of in (("q",) if own_zero else ("q", "command_position"))
                  if of in roles)  # fmt: skip
    sign = ((Change(MAPPING, SIGN, -1, role, joint),),)
    finding = Finding("zero", (joint,), note, lines, sign * (opposite < after * LIMITS.alike))
    return [finding, *zeros(bench.mended(lines))]


def _zeros(torques: Torques, joint: int, torque: np.ndarray) -> dict[str, tuple[float, float]]:
    """Error of a torque, and the offset of the angle [rad] from which motion explains it best.

    By the joint before whose link the angle may be measured from; empty for the URDF's.
    """
    text, names = Description(torques.robot.urdf), torques.robot.joints
    if text.joint_types().get(names[joint]) == "prismatic" or not np.isfinite(torque).all():
        return {}
    chain = text.above(text.child(names[joint]))[1:]  # the next first
    before = [names.index(name) for name in chain if name in names]
    fits = {}
    for base in (None, *before[:1]):

        def left(offset: float, base: int | None = base) -> float:
            return explained(torques.shifted(joint, offset, base).motion(joint), torque)[1]

        nearest = min(np.arange(-np.pi, np.pi, APART), key=left)
        bracket, fine = (nearest - APART, nearest + APART), {"xatol": 1e-3}
        best = minimize_scalar(left, bounds=bracket, method="bounded", options=fine)
        after = max(float(best.fun), FINEST)
        fits[names[base] if base is not None else ""] = after, _angle(float(best.x))
    return fits


def _angle(x: float) -> float:
    """The angle between -π and π that differs by whole turns [rad]."""
    return (x + np.pi) % (2.0 * np.pi) - np.pi


def reversed_torques(bench: Bench) -> list[Finding]:
    """Findings of joints whose torque has the other sign than motion and drive need."""
    torques, findings = read(bench), list[Finding]()
    for role in torques.columns if torques else ():
        errors = [np.diag(torques.errors(role, sign)) for sign in (1.0, -1.0)]
        for joint, before, after in zip(torques.robot.joints, *errors, strict=True):
            if after <= min(before / LIMITS.better, LIMITS.left):
                note = f"{role} of {joint} has the other sign than motion and drive ask for: " \
                       f"motion leaves {before:.0%} unexplained, reversed {after:.0%}"  # fmt: skip
                line = Change(MAPPING, SIGN, -1, role, joint)
                findings.append(Finding("sign", (joint,), note, (line,)))
    return findings


def commanded(bench: Bench) -> list[Finding]:
    """Findings of joints whose commanded torque has another unit than that of other joints."""
    torques = read(bench)
    if torques is None:
        return []
    units = [_unit(torques, i, torque) for i, torque in enumerate(torques.columns[CMD].T)]
    rows = zip(torques.robot.joints, units, strict=True) if "" in units else ()
    return [_effort(CMD, joint, 1.0 / suspect.POWERS[unit], unit) for joint, unit in rows if unit]


def effort(bench: Bench) -> list[Finding]:
    """Findings of joints whose measured torque is a multiple of what motion and drive need."""
    torques, findings = read(bench), list[Finding]()
    for i, joint in enumerate(torques.robot.joints if torques else ()):
        tau = torques.tau[:, i]
        unit, (by_motion, determined) = _unit(torques, i, tau), _ratio(torques, i, tau)
        gains = None if torques.robot.guessed else regressed(bench, joint)
        if not gains:
            absurd = determined and abs(np.log(by_motion)) > np.log(suspect.RATIO_FAR)
            if unit:
                findings.append(_effort(TAU, joint, 1.0 / suspect.POWERS[unit], unit))
            elif absurd and not torques.robot.springs:
                findings.append(_effort(TAU, joint, by_motion))
            elif unit is None:
                findings += _tiny(torques, i, joint)
            continue
        ratio = float(gains[0][0]) / torques.robot.drives[joint].kp
        size, power = abs(np.log(ratio)), suspect.power_of_ten(ratio)
        agrees = determined and abs(np.log(ratio / by_motion)) < 0.5 * size
        if size > np.log(LIMITS.effort) and (agrees or unit and unit == power):
            findings.append(_effort(TAU, joint, ratio, power))  # else the motor is weak, or masses
    return findings


def _effort(role: str, joint: str, ratio: float, unit: str = "") -> Finding:
    """Finding of a torque that is so many times what it should be, in a unit or by a scale."""
    what = f"probably it is in {unit.replace(' ', '·')}" if unit else (
        f"a current in A, of {1.0 / ratio:.3g} N·m per A, or raw counts? Here it is taken so"
    )  # fmt: skip
    note = f"{role} of {joint} is {ratio:.3g} times what inertia, weight and drive ask for: {what}"
    line = Change(MAPPING, *((UNIT, unit) if unit else (SCALE, 1.0 / ratio)), role, joint)
    return Finding("effort", (joint,), note, (line,), stops=False)


def _tiny(torques: Torques, joint: int, name: str) -> list[Finding]:
    """Finding of a measured torque that is far too small for the weight that it should hold."""
    size, needed = (float(np.median(np.abs(x)))
                    for x in (torques.tau[:, joint], torques.body_torque(joint)))  # fmt: skip
    if not size < needed / LIMITS.tiny:
        return []
    note = f"tau of {name} is {size:.2g} most of the time, where inertia and weight need " \
           f"{needed:.2g}: it is a current or in another unit, and needs a scale; or something " \
           "else holds the weight: then leave the column out"  # fmt: skip
    return [Finding("effort", (name,), note)]


def _unit(torques: Torques, joint: int, torque: np.ndarray) -> str | None:
    """Unit with which inertia and weight explain a torque; empty for N·m, None if none does.

    Friction and the rotor of the joint, which the model may lack, are fitted.
    """
    body, terms = torques.body_torque(joint), torques.joint_torques(joint)
    sizes = {"": 1.0, **suspect.POWERS}
    errors = {unit: explained(terms, size * torque, body)[1] for unit, size in sizes.items()}
    unit = min(errors, key=errors.get)
    limits = [errors[""]] if unit else []
    limits.append(explained(terms, torque)[1])  # inertia and weight must matter
    limit = min(LIMITS.left, *np.divide(limits, LIMITS.better))
    return unit if errors[unit] <= limit else None


def _ratio(torques: Torques, joint: int, torque: np.ndarray) -> tuple[float, bool]:
    """Ratio of a torque to what inertia and weight need, and whether it is well determined."""
    terms = torques.motion(joint)[:, :-1]
    (by, *_), error = explained(terms, torque)
    parts = np.array_split(np.arange(len(torque)), BLOCKS) if by > 0.0 else ()
    each = [explained(np.delete(terms, part, axis=0), np.delete(torque, part))[0][0]
            for part in parts]  # fmt: skip
    determined = by > LIMITS.sure * np.sqrt(BLOCKS - 1.0) * np.std(each) if each else False
    return float(by), bool(determined and error < LIMITS.explained)


@dataclass(frozen=True)
class Residual:
    """Torques that a model misses, without what friction and rotors in the joints explain.

    Attributes:
        torque: Torques, (T, n); 0 in joints whose torques are not measured.
        friction: Orthonormal functions of time of friction and rotor of each joint, (n, T, 3).
        weights: One over the error of each joint, (n,); 0 where torques are not measured.
    """

    torque: np.ndarray
    friction: np.ndarray
    weights: np.ndarray

    @staticmethod
    def of(torques: Torques, torque: np.ndarray, measured: np.ndarray) -> Residual:
        """Torques that a model misses, weighted by the errors that remain with gravity fitted."""
        values = np.where(measured, torque - torques.free - torques.weight @ torques.gravity, 0.0)
        friction = np.array(
            [np.linalg.qr(torques.joint_torques(i))[0] for i in range(len(measured))]
        )
        floor = FINEST * np.sqrt(np.mean(np.where(measured, torque, 0.0) ** 2, axis=0)) + 1e-9
        residual = Residual(values, friction, measured / np.max(floor))
        for _ in range(ROUNDS):
            by = residual.fitted(torques.weight)[0]
            rest = residual.without((values - torques.weight @ by)[..., None])[..., 0]
            error = np.maximum(np.sqrt(np.mean(rest**2, axis=0)), floor)
            residual = replace(residual, weights=measured / error)
        return residual

    def without(self, values: np.ndarray) -> np.ndarray:
        """Part of some values of each joint that friction does not explain, (T, n, k)."""
        part = np.einsum("nta,tnk->nak", self.friction, values)
        return values - np.einsum("nta,nak->tnk", self.friction, part)

    def fitted(self, columns: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Least squares of the torques.

        Args:
            columns: Torques per unit of each unknown, (T, n, k).

        Returns:
            The unknowns, (k,); their error by leaving out each joint, and parts of the time; the
            error of the torques over that of each joint.
        """
        both = np.concatenate([columns, self.torque[..., None]], axis=2)
        both = self.without(both) * self.weights[:, None]

        def solved(table: np.ndarray) -> np.ndarray:
            table = table.reshape(-1, table.shape[2])
            return np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=LIMITS.seen)[0]

        by, square = solved(both), 0.0
        used = np.flatnonzero(self.weights)
        for parts, axis in ((np.array_split(np.arange(len(both)), BLOCKS), 0), (used, 1)):
            each = [solved(np.delete(both, part, axis=axis)) for part in parts]
            square += (len(each) - 1.0) * float(np.sum(np.var(each, axis=0)))
        return by, np.sqrt(square), self.error(columns, by)

    def error(self, columns: np.ndarray, by: np.ndarray) -> float:
        """Error that given unknowns leave, over that of each joint."""
        rest = self.without((self.torque - columns @ by)[..., None])[..., 0] * self.weights
        return float(np.sqrt(np.mean(rest[:, self.weights > 0.0] ** 2)))


def inclined(bench: Bench) -> list[Finding]:
    """Finding of a base that is inclined, by the torques that hold the weight.

    Gravity is fitted to the torques of all joints at once, with friction in each. It is reported if
    no offset of one angle or one torque, and no change of one body, explains them as well, and if
    the angle is above those of the slopes that a search looks for.
    """
    torques = read(bench)
    if torques is None:
        return []
    torque, pull = torques.tau.copy(), float(np.linalg.norm(torques.gravity))
    for i in np.flatnonzero(np.isnan(torque).any(axis=0)):
        torque[:, i] = torques.driven(i)
    measured = np.isfinite(torque).all(axis=0)
    if not measured.any() or not pull or not np.isfinite(torques.weight).all():
        return []
    residual = Residual.of(torques, torque, measured)
    by, error, _ = residual.fitted(torques.weight)
    down = (torques.gravity + by) * pull / max(float(np.linalg.norm(torques.gravity + by)), 1e-9)
    angle = float(np.arccos(np.clip(down @ torques.gravity / pull**2, -1.0, 1.0)))
    before, after = (
        residual.error(torques.weight, x) for x in (np.zeros(3), down - torques.gravity)
    )
    min_angle = EFFECTS["slope"].identity.priors["pitch"].high + LIMITS.doubt * error / pull
    if angle < min_angle or after > before / LIMITS.better:
        return []
    if any(
        residual.fitted(columns)[2] < LIMITS.alike * after
        for columns in _rivals_of(torques, residual)
    ):
        return []
    lines = [change for finding in zeros(bench) for change in finding.mends]
    zero = read(bench.mended(lines)) if lines else None
    if zero and zero.missed() < replace(torques, gravity=down).missed():
        return []
    spec = {"name": "slope", **_slope(torques.gravity, down)}
    pose = "upside down" if angle > 0.9 * np.pi else "inclined"
    angles = f"{np.degrees(angle):.1f} ± {np.degrees(error / pull):.1f} degrees"
    note = f"by the torques that hold the weight it pulls {angles} away from where the model has " \
           f"it: the base is {pose}"  # fmt: skip
    return [Finding("gravity turned", (), note, (Change(MODEL, ADDED, (spec,)),))]


def _slope(gravity: np.ndarray, down: np.ndarray) -> dict[str, float]:
    """Pitch and roll of an effect `slope` that turns gravity to another direction, (3,) each."""

    def rest(x: np.ndarray) -> np.ndarray:
        turn = EFFECTS["slope"](pitch=x[0], roll=x[1]).turn()
        return np.array(rotate_back(rotation_matrix(turn), tuple(gravity))) - down

    up = -down / np.linalg.norm(down)
    start = np.arcsin(np.clip(up[0], -1.0, 1.0)), np.arctan2(up[1], up[2])
    pitch, roll = least_squares(rest, start, bounds=(-3.2, 3.2)).x
    return {"pitch": round(float(pitch), 4), "roll": round(float(roll), 4)}


def _rivals_of(torques: Torques, residual: Residual) -> Iterator[np.ndarray]:
    """Torques of what may pass for an inclined base, per unit of each unknown, (T, n, k).

    Offsets of the torque and of the angle of a joint, and a mass anywhere in the body it moves.
    An offset of an angle that the drive does not know is none of the drive's torque either.
    """
    holding, none = torques.weight @ torques.gravity, np.zeros(torques.q.shape)
    text = Description(torques.robot.urdf)
    for i, joint in enumerate(torques.robot.joints):
        one = np.eye(len(torques.robot.joints))[i]
        yield (none + one)[..., None]
        shifted = torques.plant().needed(torques.q + STEP * one, none, none)[1] @ torques.gravity
        columns = ((shifted - holding) / STEP)[..., None]
        stiff = getattr(torques.robot.drives.get(joint), "kp", 0.0)
        if np.isnan(torques.tau[:, i]).any():
            yield columns + (stiff * one)[:, None]
        elif not abs(np.mean(torques.tau[:, i] - torques.driven(i))) < 0.5 * stiff * abs(
            residual.fitted(columns)[0][0]
        ):
            yield columns
        positions = ([0.0, 0.0, 0.0], *np.eye(3).tolist())
        body = {"name": "payload", "link": text.child(joint), "mass": 1.0}
        loaded = (torques.plant({**body, "position": at}) for at in positions)
        yield np.stack(
            [p.needed(torques.q, none, none)[1] @ torques.gravity - holding for p in loaded], 2
        )
