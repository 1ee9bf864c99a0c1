# SPDX-License-Identifier: Apache-2.0
"""Findings: mistakes of a set-up, with their numbers and the lines that correct them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import yaml

from ..recordings import units
from ..recordings.record import JOINT_SIGNALS, Record

MAPPING, MODEL, ROBOT = "mapping.yaml", "model.yaml", "robot.yaml"
CANCELS = 0.02  # distance of a scale to 1 that an estimate of it has (taste)
EFFECTS = "effects"  # key of a model.yaml whose value is a list of effects
JOINT, SIGN, SCALE, UNIT, OFFSET, WRAP = "joint", "sign", "scale", "unit", "offset", "wrap"


@dataclass(frozen=True)
class Change:
    """A key of a mapping's column or of a model, with its correct value.

    Attributes:
        file: `MAPPING` or `MODEL`.
        key: Key of a column, or dotted name of a value of robot.yaml, or `EFFECTS`.
        value: Value of the key.
        role: Role of the column, for `MAPPING`.
        joint: Joint of the column, for `MAPPING`.
    """

    file: str
    key: str
    value: Any = field(hash=False)
    role: str = ""
    joint: str = ""

    def __str__(self) -> str:
        where = f" at {self.role} of {self.joint}" if self.role else ""
        value = f"{self.value:.6g}" if isinstance(self.value, float) else self.value
        if self.key == EFFECTS:
            value = yaml.safe_dump(list(value), default_flow_style=True).strip()
        file = ROBOT if self.file == MODEL and self.key != EFFECTS else self.file
        return f"{self.key}: {value}{where} in {file}"

    @property
    def factor(self) -> float:
        """Factor on the values of the column; 1 for keys that do not scale."""
        if self.key == UNIT:
            return units.factor(self.value)
        return float(self.value) if self.key in (SIGN, SCALE) else 1.0


def unit_of(unit: str, role: str) -> str:
    """Unit of a role whose angles or lengths are in a unit: that of their rate for velocities."""
    rate = role in ("dq", "command_velocity") and units.dimension(unit) in ("angle", "length")
    return f"{unit}/s" if rate else unit


@dataclass(frozen=True)
class Finding:
    """A mistake of a set-up.

    Attributes:
        fault: Name of the kind of mistake, such as "sign".
        joints: Joints with the mistake; empty for the whole robot.
        says: The mistake in one sentence, with numbers.
        mends: Lines that correct it, all of them needed.
        others: Alternative sets of lines that correct it as well.
        stops: Whether it must be corrected before any effect is sought.
    """

    fault: str
    joints: tuple[str, ...]
    says: str
    mends: tuple[Change, ...] = ()
    others: tuple[tuple[Change, ...], ...] = ()
    stops: bool = True

    def __str__(self) -> str:
        fixes = [" and ".join(map(str, fix)) for fix in (self.mends, *self.others) if fix]
        line = f"; say {fixes[0]}" if fixes else ""
        if len(fixes) > 1:
            line += f", or {', or '.join(fixes[1:])}: these recordings cannot tell which"
        return f"{self.says}{line}"

    def plain(self) -> dict[str, Any]:
        """The finding for a JSON file."""
        return {
            "fault": self.fault,
            "joints": list(self.joints),
            "says": str(self),
            "mends": [vars(change) for change in self.mends],
            "others": [[vars(change) for change in fix] for fix in self.others],
            "stops": self.stops,
        }


def from_plain(values: Mapping[str, Any]) -> Finding:
    """A finding from `Finding.plain`, whose sentence has the lines."""
    mends, *options = (
        tuple(Change(**line) for line in fix) for fix in (values["mends"], *values["others"])
    )
    about = values["fault"], tuple(values["joints"]), values["says"]
    return Finding(*about, mends, tuple(options), values["stops"])


def roles_of(record: Record, joint: str) -> tuple[str, ...]:
    """Roles of the columns of a joint in a record."""
    measured = JOINT_SIGNALS if joint in record.joints else ()
    command_types = record.command if joint in record.driven else ()
    roles = [role for role in measured if role in record.signals]
    return (*roles, *(f"command_{kind}" for kind in command_types))


def composed(changes: Iterable[Change]) -> list[Change]:
    """Changes with signs and scales of a column multiplied, and left out if they cancel."""
    out = list[Change]()
    for c in changes:
        out = _with(out, c)
    return out


def _with(changes: list[Change], new: Change) -> list[Change]:
    """Changes with one more, which may be a factor of one that is there."""
    for k, old in reversed(list(enumerate(changes))):
        if (old.file, old.role) != (new.file, new.role):
            continue
        if new.file == MODEL and old.key == new.key != EFFECTS:
            return [*changes[:k], *changes[k + 1 :], new]
        if old.key == JOINT or old.joint == new.joint and old.key in (OFFSET, WRAP):
            break  # a factor does not commute with it
        if old.joint == new.joint and old.key == new.key and new.key in (SIGN, SCALE):
            by = type(new.value)(old.value * new.value)
            same = [replace(old, value=by)] * (abs(by - 1.0) > CANCELS)
            return [*changes[:k], *same, *changes[k + 1 :]]
    return [*changes, new]


def correct(record: Record, changes: Sequence[Change]) -> Record:
    """A record as imported with changes of its mapping, in their order.

    Consecutive changes of joints are made at once.

    Args:
        record: The record as imported.
        changes: Changes; those of a model are ignored, see `model_with`.
    """
    signals = {key: values.copy() for key, values in record.signals.items()}
    command = {key: values.copy() for key, values in record.command.items()}
    resolution = dict(record.resolution)
    out = replace(record, signals=signals, command=command, resolution=resolution)
    for exchange, group in itertools.groupby(changes, lambda c: c.key == JOINT):
        (_exchange if exchange else _correct)(out, list(group))
    return out


def _correct(record: Record, changes: Sequence[Change]) -> None:
    """Multiply, shift and unwrap columns of a record in place."""
    for c in changes:
        values, names = _columns(record, c.role) if c.file == MAPPING else (None, ())
        if values is not None and c.joint in names:
            k = names.index(c.joint)
            if c.key == WRAP:
                values[:, k] = units.periodic(values[:, k], c.value)
            values[:, k] *= c.factor
            values[:, k] += c.value if c.key == OFFSET else 0.0
            if (c.role, c.joint) in record.resolution:
                record.resolution[c.role, c.joint] *= abs(c.factor)


def _exchange(record: Record, changes: Sequence[Change]) -> None:
    """Give columns of a record to other joints in place, all at once."""
    old = {role: _columns(record, role)[0] for role in {c.role for c in changes}}
    old = {role: values.copy() for role, values in old.items() if values is not None}
    for c in changes:
        values, names = _columns(record, c.role)
        if values is not None and {c.joint, c.value} <= set(names):
            values[:, names.index(c.value)] = old[c.role][:, names.index(c.joint)]


def _columns(record: Record, role: str) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Array of a role, None if absent, and the joints of its columns."""
    if role.startswith("command_"):
        return record.command.get(role.removeprefix("command_")), record.driven
    return record.signals.get(role), record.joints
