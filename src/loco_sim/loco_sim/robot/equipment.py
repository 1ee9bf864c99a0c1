# SPDX-License-Identifier: Apache-2.0
"""Sections of ``robot.yaml`` that extend the URDF: drives, springs, contacts, masses, sensors.

Sections name joints and links, or fnmatch patterns of them; later entries extend and
override earlier ones. `override` changes single values by dotted name.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import Params, from_dict, parameter

from ..geometry import added
from .description import Description
from .servo import CONTINUOUS, DRIVES, DriveParams, ServoParams
from .spring import SpringParams

BY_JOINT, BY_LINK = ("drives", "springs", "dynamics"), ("contacts", "masses", "bodies")
NESTED = ("sensors", "sim", "fall")
UNCERTAIN = "uncertain"
GUESSED = {"kp": 0.2, "kd": 0.3}  # deviation of guessed gains that were fitted, as shares (taste)
SCALARS = ("control_rate", "height", "fixed_base")
GRAVITY = 9.81  # [m/s²], for weights and foot loads where `sim.gravity` is not available


@dataclass(frozen=True)
class DynamicsParams(Params):
    """Properties of one joint apart from drive and spring, which override the URDF."""

    damping: float = parameter(
        -1.0, "viscous damping; below 0 is that of the URDF", "N·m·s/rad", low=-1.0, high=1e4
    )
    friction: float = parameter(
        -1.0, "dry friction; below 0 is that of the URDF", "N·m", low=-1.0, high=1e6
    )
    armature: float = parameter(
        0.0, "of rotor and gear: the joint feels it, and none before it", "kg·m²", low=0.0, high=1e3
    )


@dataclass(frozen=True)
class BodyParams(Params):
    """Corrections to a link, with the links fixed to it; its own centre of mass is shifted."""

    mass: float = parameter(1.0, "times the URDF's, inertia with it", "-", low=1e-3, high=1e3)
    inertia: float = parameter(
        1.0, "times the URDF's, about the centre of mass", "-", low=1e-9, high=1e3
    )
    x: float = parameter(0.0, "shift of the centre of mass, link frame", "m", low=-1.0, high=1.0)
    y: float = parameter(0.0, "the same along y", "m", low=-1.0, high=1.0)
    z: float = parameter(0.0, "the same along z", "m", low=-1.0, high=1.0)


@dataclass(frozen=True)
class ContactParams(Params):
    """Contact of one link with the ground.

    `depth` is the penetration of the link when it carries its share of the robot at
    rest, weight / feet, and defines the stiffness. The damping is critical for that share,
    which is more than sufficient for the lighter leg that lands first.
    """

    friction: float = parameter(1.0, "Coulomb friction with the ground", low=0.0, high=1e6)
    depth: float = parameter(
        0.0, "penetration under the static load, 0 is rigid", "m", low=0.0, high=0.1
    )

    def softness(self, mass: float) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N·s/m] for the mass carried by the link [kg]."""
        if self.depth == 0.0:
            return 0.0, 0.0
        stiffness = mass * GRAVITY / self.depth
        return stiffness, 2.0 * (stiffness * mass) ** 0.5


def expanded(
    values: Mapping[str, Any], joints: Iterable[str], links: Iterable[str], path: Path
) -> dict[str, Any]:
    """Contents of a ``robot.yaml`` with patterns expanded to an entry per joint or link.

    Raises:
        NameUnknownError: A pattern matches no joint or link.
        ParameterError: A section or an entry is not a mapping.
    """
    full = dict(values)
    for section in (*BY_JOINT, *BY_LINK):
        available = list(joints if section in BY_JOINT else links)
        kind = "joint" if section in BY_JOINT else "link"
        entries = _mapping(values.get(section) or {}, f"{path}: {section}")
        full[section] = resolved = {}
        for pattern, entry in entries.items():
            for name in matches(available, str(pattern), f"{kind} for {section} in {path}"):
                if section == "masses":
                    resolved[name] = entry
                else:
                    entry = _mapping(entry, f"{path}: {section}.{pattern}")
                    resolved[name] = {**resolved.get(name, {}), **entry}
    for section in NESTED:
        full[section] = dict(_mapping(values.get(section) or {}, f"{path}: {section}"))
    return full


def override(values: dict[str, Any], changes: Mapping[str, Any], links: Iterable[str]) -> None:
    """Change values of an `expanded` robot by dotted names.

    ``springs.l?_kfe_joint.stiffness``, ``masses.front_body``, ``sim.physics_rate``.

    Args:
        values: Expanded contents, changed in place.
        changes: New values by dotted name; patterns for joints and links are allowed.
        links: Links of the robot.

    Raises:
        NameUnknownError: A name does not exist.
    """
    for dotted, value in changes.items():
        section, *rest = str(dotted).split(".")
        if section in SCALARS and not rest:
            values[section] = value
        elif section == "masses" and len(rest) == 1:
            names = matches(list(links), rest[0], f"link for the override {dotted!r}")
            values[section].update(dict.fromkeys(names, value))
        elif section in (*BY_JOINT, "contacts", "bodies") and len(rest) == 2:
            what = f"entry of {section} for the override {dotted!r}"
            free = {"dynamics": values.get("joints", ()), "bodies": list(links)}
            available = free.get(section, values.get(section))
            for name in matches(available, rest[0], what):
                values[section][name] = {**values[section].get(name, {}), rest[1]: value}
        elif section == UNCERTAIN and rest:
            values[UNCERTAIN] = {**(values.get(UNCERTAIN) or {}), ".".join(rest): value}
        elif section in NESTED and rest:
            _set(values[section], rest, value)
        else:
            raise NameUnknownError("value of a robot to override", str(dotted), _legal(values))


def drives(section: Mapping[str, dict], period: float) -> dict[str, DriveParams]:
    """Drive parameters of each joint with a drive; `kind` selects their class.

    Args:
        section: Entries by joint.
        period: Default period of drives whose torque is sampled [s].
    """
    by_joint = {}
    for joint, entry in section.items():
        kind = entry.get("kind")
        if kind not in DRIVES:
            raise NameUnknownError(f"kind of drive for {joint}", str(kind), DRIVES)
        rest = {key: value for key, value in entry.items() if key != "kind"}
        if rest.get("torque", CONTINUOUS) != CONTINUOUS:
            rest = {"period": period, **rest}
        by_joint[joint] = from_dict(DRIVES[kind], rest, f"drives.{joint}")
    return by_joint


def rigid_gears(
    by_joint: Mapping[str, DriveParams],
) -> tuple[dict[str, DriveParams], dict[str, float]]:
    """Drives without the rotors behind rigid gears, and the inertia of each of these [kg·m²]."""
    rotors = {
        joint: drive.rotor_inertia
        for joint, drive in by_joint.items()
        if isinstance(drive, ServoParams) and drive.gear_stiffness == 0.0
    }
    rest = {joint: replace(by_joint[joint], rotor_inertia=0.0) for joint in rotors}
    return {**by_joint, **rest}, rotors


def parts(section: Mapping[str, dict], kind: type[Params], where: str) -> dict[str, Any]:
    """Parameters of each entry of a section."""
    return {name: from_dict(kind, entry, f"{where}.{name}") for name, entry in section.items()}


def set_masses(description: Description, masses: Mapping[str, Any]) -> None:
    """Set masses of links, each including all its descendants.

    Raises:
        ParameterError: A mass is not a positive number, or smaller than that of the descendants.
    """
    for link in sorted(masses, key=lambda name: len(description.below(name))):
        mass, rest = masses[link], description.below(link)[1:]
        if isinstance(mass, bool) or not isinstance(mass, (int, float)) or not 0.0 < mass < 1e6:
            raise ParameterError(f"masses.{link} must be a number above 0 [kg], got {mass!r}")
        hanging = added(description.mass_of(name) for name in rest)
        if mass <= hanging:
            raise ParameterError(
                f"masses.{link} must be above {hanging:g} kg, which is what hangs on it, "
                f"got {mass:g}"
            )
        description.set_mass(link, mass - hanging)


def set_bodies(description: Description, bodies: Mapping[str, BodyParams]) -> None:
    """Change mass, inertia and centre of mass of links, including the links fixed to them.

    Raises:
        ParameterError: A link has no mass.
    """
    for link, body in bodies.items():
        for part in description.fixed_to(link):
            if description.mass_of(part) > 0.0:
                description.set_mass(part, body.mass * description.mass_of(part))
                description.scale_inertia(part, body.inertia)
        description.shift_com(link, (body.x, body.y, body.z))


def uncertain(values: Mapping[str, Any], bodies: Iterable[str], path: Path) -> dict[str, float]:
    """Standard deviation of each uncertain value of a robot, by dotted name.

    Gains that a draft guessed are uncertain by shares of them, unless a pattern says another one.

    Args:
        values: An `expanded` robot.
        bodies: Links moved by joints.
        path: File, for messages.

    Raises:
        NameUnknownError: A pattern matches nothing.
        ParameterError: A deviation is not a number above 0.
    """
    by_section: dict[str, list[str]] = {
        "bodies": [f"{link}.{name}" for link in bodies for name in vars(BodyParams())],
        "masses": list(bodies),
    }
    for section in ("drives", "springs"):
        entries = values[section]
        by_section[section] = [f"{j}.{k}" for j in entries for k in _numbers(section, entries[j])]
    dotted = [f"{section}.{name}" for section, names in by_section.items() for name in names]
    deviations = _of_guesses(values) if "drives" in (values.get("guessed") or ()) else {}
    for pattern, size in _mapping(values.get(UNCERTAIN) or {}, f"{path}: {UNCERTAIN}").items():
        part = isinstance(size, str) and size.endswith("%")
        try:
            number = math.nan if isinstance(size, bool) else float(size[:-1] if part else size)
        except (TypeError, ValueError):
            number = math.nan
        if not 0.0 < number < 1e6:
            raise ParameterError(
                f"{UNCERTAIN}: {pattern} must be a deviation above 0 or a share such as 3%, "
                f"got {size!r}"
            )
        for name in matches(dotted, str(pattern), f"value for {UNCERTAIN} in {path}"):
            reference = abs(_value(values, name)) / 100.0 if part else 1.0
            if reference > 0.0:  # a relative deviation of zero is zero
                deviations[name] = number * reference
    return deviations


def _of_guesses(values: Mapping[str, Any]) -> dict[str, float]:
    """Standard deviation of the gains of drives that were guessed, by dotted name."""
    return {
        f"drives.{joint}.{key}": share * abs(entry[key])
        for joint, entry in values["drives"].items()
        for key, share in GUESSED.items() if entry.get(key)
    }  # fmt: skip


def _value(values: Mapping[str, Any], dotted: str) -> float:
    """Value of a dotted name in an `expanded` robot, or its default."""
    section, _, rest = dotted.partition(".")
    if section == "masses":
        return float(values.get(section, {}).get(rest, 0.0))
    place, _, name = rest.rpartition(".")
    entry = values.get(section, {}).get(place, {})
    kind = {"bodies": BodyParams, "springs": SpringParams}.get(section)
    kind = kind or DRIVES[entry.get("kind")]
    return float(entry.get(name, kind.__dataclass_fields__[name].default))


def _numbers(section: str, entry: Mapping[str, Any]) -> list[str]:
    """Names of the numeric values of a drive or spring that may be uncertain."""
    kind = DRIVES.get(entry.get("kind")) if section == "drives" else SpringParams
    return [k for k, f in getattr(kind, "__dataclass_fields__", {}).items() if f.type == "float"]


def matches(names: Iterable[str], pattern: str, what: str) -> list[str]:
    """Names that a pattern matches.

    Raises:
        NameUnknownError: The pattern matches no name.
    """
    selected = [name for name in names if fnmatchcase(name, pattern)]
    if not selected:
        raise NameUnknownError(what, pattern, names)
    return selected


def _mapping(value: Any, where: str) -> Mapping:
    if not isinstance(value, Mapping):
        raise ParameterError(f"{where} must be a mapping, got {value!r}")
    return value


def _set(values: dict[str, Any], keys: list[str], value: Any) -> None:
    for key in keys[:-1]:
        values[key] = dict(_mapping(values.get(key) or {}, key))
        values = values[key]
    values[keys[-1]] = value


def _legal(values: Mapping[str, Any]) -> list[str]:
    per_name = [f"{s}.{name}.<parameter>" for s in (*BY_JOINT, "contacts") for name in values[s]]
    return [*SCALARS, "masses.<link>", *(f"{s}.<parameter>" for s in NESTED), *per_name]
