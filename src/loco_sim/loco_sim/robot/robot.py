# SPDX-License-Identifier: Apache-2.0
"""Robots, each defined by a URDF and a ``robot.yaml``.

All differences between robots are in these two files; ``world`` and ``simulation.py`` make no
assumption on the number of joints and feet.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.gait import similarity
from loco_control.gait.generator import standing_pose
from loco_control.names import JOINT_KINDS
from loco_control.params import Params, from_dict, parameter, to_dict
from loco_control.reading import read_bytes, read_yaml, shown, understood

from ..params import SimParams
from . import equipment, urdf_check
from . import legs as leg_geometry
from .clearance import base_height
from .description import Description
from .equipment import ContactParams
from .frames import inertia_along
from .hall import HallSensor
from .sensors import SensorParams
from .servo import DRIVES, DriveParams
from .spring import SpringParams

ASSETS = Path(__file__).parent.parent / "assets"


@dataclass(frozen=True)
class FallLimits(Params):
    """Limits beyond which a robot counts as fallen; by default never."""

    height: float = parameter(-1e9, "base origin lower than this", "m")
    roll: float = parameter(10.0, "|roll| larger than this", "rad", low=0.0)
    pitch: float = parameter(10.0, "|pitch| larger than this", "rad", low=0.0)


LOCKED = "locked"  # key of robot.yaml: joints that do not move, with their positions
# Default fall limits of a quadruped: those of HyQ (the author's hyq_ml), scaled to its size.
LEGGED_FALL = FallLimits(height=0.35, roll=0.8, pitch=0.8)
HYQ_LEGS = 25.796  # mass of HyQ's legs [kg], reference for scaling drive gains


@dataclass(frozen=True)
class Robot:
    """A robot from its ``robot.yaml``, validated against the URDF.

    Attributes:
        name: Name of the folder.
        urdf: Text of the URDF.
        folder: Folder of the URDF, for relative paths of meshes.
        joints: Actuated joints, in the order of every (n,) array.
        feet: Links with measured ground reaction force, in the order of (m, 3) arrays.
        standing: Initial joint positions [rad], (n,).
        effort: Torque limit of each joint [N·m], (n,), from the URDF.
        fixed_base: Whether the base is fixed to the world.
        height: Initial height of the base [m]; None to put the lowest foot on the ground. A bolted
            robot without feet hangs above it by default (`clearance.base_height`).
        fall: Limits of height and tilt beyond which the robot counts as fallen.
        driven: Indices of the joints with a drive, (m,); the others are passive.
        control_rate: Default rate of commands [Hz].
        rate_stated: Whether robot.yaml states that rate, and no draft guessed it.
        sim: Default physics parameters of the robot.
        drives: Drives by joint.
        springs: Springs and dampers by joint.
        armature: Rotor inertia behind the gear [kg·m², kg], by joint; the joint alone feels it,
            but for PyBullet, where it is part of the link.
        joint_friction: Dry friction of joints that have any [N·m or N], by joint.
        friction: Friction coefficients by link; other links have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] by link.
        sensors: Sensors, None for exact measurements.
        hall: Hall sensors by joint.
        legs: Leg geometry of a quadruped with a section `legs`, (4, 16), columns named by
            `legs.geometry.COLUMNS`; None for other robots.
        uncertain: Standard deviation of uncertain values, by dotted name, in the unit of each
            value.
        guessed: Sections of ``robot.yaml`` that a draft guessed: "control_rate" and "drives".
        followers: Leader, factor and offset [rad or m] of each joint that follows another one
            (``<mimic>``), by name.
        mass: Mass of all links [kg].
        motor_torque: Whether the measured torque of a joint is that of its drive alone, as a motor
            current tells it; otherwise springs and effects on the joint are part of it.
        foot_of: Index in `feet` of the foot moved by each joint, (n,); -1 for a joint that
            moves none or several.
    """

    name: str
    urdf: str = field(repr=False)
    folder: Path
    joints: tuple[str, ...]
    feet: tuple[str, ...]
    standing: np.ndarray
    effort: np.ndarray
    fixed_base: bool = False
    height: float | None = None
    fall: FallLimits = FallLimits()
    driven: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    control_rate: float = 250.0
    rate_stated: bool = False
    sim: SimParams = SimParams()
    drives: dict[str, DriveParams] = field(default_factory=dict)
    springs: dict[str, SpringParams] = field(default_factory=dict)
    armature: dict[str, float] = field(default_factory=dict)
    joint_friction: dict[str, float] = field(default_factory=dict)
    friction: dict[str, float] = field(default_factory=dict)
    contact: dict[str, tuple[float, float]] = field(default_factory=dict)
    sensors: SensorParams | None = None
    hall: dict[str, HallSensor] = field(default_factory=dict, repr=False)
    legs: np.ndarray | None = field(default=None, repr=False)
    uncertain: dict[str, float] = field(default_factory=dict, repr=False)
    guessed: tuple[str, ...] = ()
    followers: dict[str, tuple[str, float, float]] = field(default_factory=dict, repr=False)
    mass: float = 0.0
    motor_torque: bool = False
    foot_of: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int), repr=False)

    @property
    def equipped(self) -> bool:
        """Whether ``robot.yaml`` has drives or springs."""
        return bool(self.drives or self.springs)

    @property
    def encoder_step(self) -> float:
        """Largest step to which a drive rounds its position [rad or m]; 0 if none does."""
        return max((getattr(d, "resolution", 0.0) for d in self.drives.values()), default=0.0)

    @property
    def damping(self) -> np.ndarray:
        """Largest damping of drive and spring of each joint [N·m·s/rad], (n,)."""
        parts = [(self.drives.get(joint), self.springs.get(joint)) for joint in self.joints]
        return np.array([sum(getattr(part, "damping", 0.0) for part in pair) for pair in parts])

    def coupled(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Desired positions and velocities, with those of followers computed from their leaders.

        Args:
            q: Desired positions [rad or m], (..., n).
            dq: Desired velocities [rad/s or m/s], (..., n).
        """
        if not self.followers:
            return q, dq
        q, dq = np.array(q, dtype=float), np.array(dq, dtype=float)
        for joint, (leader, factor, offset) in self.followers.items():
            i, k = self.joints.index(joint), self.joints.index(leader)
            q[..., i], dq[..., i] = factor * q[..., k] + offset, factor * dq[..., k]
        return q, dq

    def swinging(self, stance: np.ndarray) -> np.ndarray:
        """1.0 for each joint whose leg swings, 0.0 for all others, (n,).

        Args:
            stance: Feet in stance, (m,) bool.

        Raises:
            ParameterError: The number of flags in `stance` differs from that of feet.
        """
        if len(stance) != len(self.feet):
            raise ParameterError(
                f"robot {self.name!r} has {len(self.feet)} feet, got {len(stance)} stance flags"
            )
        swings = np.append(~np.asarray(stance, dtype=bool), False)
        return swings[self.foot_of].astype(float)


@cache
def _shipped() -> tuple[str, ...]:
    return tuple(sorted(p.parent.name for p in ASSETS.glob("*/robot.yaml")))


def names() -> list[str]:
    """Names of the robots included in the package."""
    return list(_shipped())


def is_name(name_or_path: str) -> bool:
    """Whether a text is the name of a robot, not a path."""
    path = Path(name_or_path)
    return path.parent == Path(".") and not path.suffix and name_or_path not in ("", ".", "..")


@understood("whole robot")
def load(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Robot:
    """Read a robot by name, or by the path of its ``robot.yaml`` or of the folder with it.

    Args:
        name_or_path: Name of a shipped robot, or a path.
        overrides: Values of ``robot.yaml`` to change, by dotted name
            (`equipment.override`).

    Raises:
        NameUnknownError: There is no such robot in the package, or the file or an override has
            an unknown name.
        MissingFileError: The path, or the URDF it names, does not exist.
        ParameterError: The file is invalid or does not match the URDF.
    """
    path = _path(name_or_path)
    values = _read(path)
    urdf = path.parent / str(values["urdf"])
    if not urdf.is_file():
        raise MissingFileError(f"{path}: there is no URDF at {urdf}")
    text = _text(urdf)
    bolted = bool({**values, **(overrides or {})}.get("fixed_base", False))
    text = _checked(text, urdf, bolted, bolted and not values.get("feet"))
    description = Description(text)
    reflected: dict[str, float] = {}
    if isinstance(values.get(LOCKED) or {}, dict) and (unlisted := _unlisted(values, description)):
        locked = values.get(LOCKED) or {}
        reflected = _reflected(description, {*unlisted} - {*locked})
        values = {**values, LOCKED: unlisted | locked}
    if values.get(LOCKED):
        values = _with_locked(values, description, path)
    legs = None
    if "legs" in values:
        values, legs = _with_legs(values, description, path)
    joints, feet = tuple(values["joints"]), tuple(values.get("feet") or ())
    limits = _check_names(path, description, joints, feet)
    moved = [description.child(joint) for joint in joints]
    values = equipment.expanded(values, joints, description.links(), path)
    equipment.override(values, overrides or {}, description.links())
    for joint, inertia in reflected.items():
        entry = values["dynamics"].setdefault(joint, {})
        entry["armature"] = entry.get("armature", 0.0) + inertia
    driven = np.array([joint in values["drives"] for joint in joints], dtype=bool)
    limits[driven & (limits <= 0.0)] = math.inf  # exporters write 0 where they know nothing
    try:
        fitted = _fit(path.parent, text, description, joints, feet, values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    return Robot(
        name=path.parent.name,
        folder=path.parent,
        joints=joints,
        feet=feet,
        effort=limits,
        legs=legs,
        uncertain=equipment.uncertain(values, moved, path),
        guessed=tuple(values.get("guessed") or ()),
        followers=_followers(description, joints),
        **fitted,
    )


def _with_locked(values: dict[str, Any], description: Description, path: Path) -> dict[str, Any]:
    """Contents without the joints in ``locked`` and those that follow them, fixed in the URDF."""
    locked, types, legs = values[LOCKED], description.joint_types(), values.get("legs") or {}
    if not isinstance(locked, dict) or not all(map(_is_number, locked.values())):
        raise ParameterError(f"{path}: {LOCKED} must give joints a position, got {shown(locked)}")
    of_legs = {v for leg in legs.values() if isinstance(leg, dict) for v in leg.values()}
    for joint in locked:
        if joint not in types:
            raise NameUnknownError(f"joint of the URDF that {path} locks", joint, types)
        if joint in of_legs:
            raise ParameterError(f"{path}: {LOCKED}: {joint} is a joint of a leg, which cannot be")
    locked = dict(locked)
    followers = _followers(description, tuple(types))
    while added := {
        joint: factor * locked[leader] + offset
        for joint, (leader, factor, offset) in followers.items()
        if leader in locked and joint not in locked
    }:
        locked |= added
    for joint, position in locked.items():
        description.lock(joint, float(position))
    joints = values["joints"]
    moving = [joint not in locked for joint in joints]
    remaining = {LOCKED: locked, "joints": [joint for joint in joints if joint not in locked]}
    if values.get("standing"):
        remaining["standing"] = _standing(values["standing"], len(joints))[moving].tolist()
    for section in equipment.BY_JOINT:
        entries = values.get(section) or {}
        if isinstance(entries, dict):
            remaining[section] = {key: entry for key, entry in entries.items() if key not in locked}
    return {**values, **remaining}


def _unlisted(values: dict[str, Any], description: Description) -> dict[str, float]:
    """Positions of joints that follow one in `joints` and are not listed: they are held there.

    Without a drive of its own such a joint would fall freely, which no mimic does.
    """
    joints = list(values["joints"])
    standing = dict(zip(joints, _standing(values.get("standing"), len(joints)), strict=True))
    types = tuple(description.joint_types())
    return {
        joint: factor * float(standing[leader]) + offset
        for joint, (leader, factor, offset) in _followers(description, types).items()
        if leader in standing and joint not in standing
    }


def _reflected(description: Description, held: Collection[str]) -> dict[str, float]:
    """Inertia that each leader moves with joints which follow it and are held [kg·m² or kg].

    The kinetic energy of a follower that turns k times as fast is that of k² its inertia.
    """
    added: dict[str, float] = {}
    for joint, (leader, factor, _) in _followers(
        description, tuple(description.joint_types())
    ).items():
        if joint in held:
            added[leader] = added.get(leader, 0.0) + factor**2 * inertia_along(description, joint)
    return added


def _followers(
    description: Description, joints: tuple[str, ...]
) -> dict[str, tuple[str, float, float]]:
    """Leader, factor and offset of each joint that follows another joint of the robot."""
    try:
        couplings = description.mimics()
    except ValueError as error:
        raise ParameterError(f"a <mimic> of the URDF has no number: {error}") from None
    return {j: lead for j, lead in couplings.items() if j in joints and lead[0] in joints}


def _text(urdf: Path) -> str:
    """Text of a URDF, without bytes around it that XML parsers refuse."""
    return (
        read_bytes(urdf, "URDF", urdf_check.MAX_SIZE)
        .decode(errors="replace")
        .strip("\0\ufeff")
        .lstrip()
    )


@lru_cache(maxsize=64)  # cached, since loading a robot reads its meshes
def _checked(text: str, urdf: Path, bolted: bool, hangs: bool) -> str:
    """Checked text; of a robot that hangs without shapes whose mesh is not there."""
    text = urdf_check.without_lost_meshes(text, urdf.parent, str(urdf)) if hangs else text
    urdf_check.check(text, urdf.parent, str(urdf), bolted)
    return text


def _fit(
    folder: Path, text: str, description: Description, joints: tuple, feet: tuple, values: dict
) -> dict[str, Any]:
    """Fields of a `Robot` that follow from an expanded ``robot.yaml``; edits the URDF."""
    standing = _standing(values.get("standing"), len(joints))
    springs = equipment.parts(values["springs"], SpringParams, "springs")
    contacts = equipment.parts(values["contacts"], ContactParams, "contacts")
    dynamics = equipment.parts(values["dynamics"], equipment.DynamicsParams, "dynamics")
    bodies = equipment.parts(values["bodies"], equipment.BodyParams, "bodies")
    stops = {joint: spring.stop for joint, spring in springs.items() if spring.stop > -math.inf}
    edited = bool(values["masses"] or dynamics or bodies or stops or values.get(LOCKED))
    equipment.set_masses(description, values["masses"])
    for joint, params in dynamics.items():
        if params.damping >= 0.0:
            description.set_damping(joint, params.damping)
    frictions = {joint: description.friction(joint) for joint in joints}
    frictions |= {joint: p.friction for joint, p in dynamics.items() if p.friction >= 0.0}
    equipment.set_bodies(description, bodies)
    for joint, stop in stops.items():
        description.set_lower_limit(joint, stop)
    sensors = from_dict(SensorParams, values["sensors"], "sensors")
    share = description.mass() / max(1, len(feet))
    height, rate = _height_and_rate(values)
    drives, rotors = equipment.rigid_gears(equipment.drives(values["drives"], 1.0 / rate))
    for joint, params in dynamics.items():
        rotors[joint] = rotors.get(joint, 0.0) + params.armature
    bolted = bool(values.get("fixed_base", False))
    if height is None and bolted and not feet:
        height = base_height(description, folder)
    return {
        "urdf": description.text() if edited else text,
        "standing": standing,
        "fixed_base": bolted,
        "height": None if height is None else float(height),
        "fall": from_dict(FallLimits, values["fall"], "fall"),
        "driven": np.array([i for i, joint in enumerate(joints) if joint in drives], dtype=int),
        "control_rate": float(rate),
        "rate_stated": "control_rate" in {*values} - {*(values.get("guessed") or ())},
        "sim": from_dict(SimParams, values["sim"], "sim"),
        "sensors": sensors if values["sensors"] else None,
        "hall": sensors.hall_sensors(folder, joints),
        "foot_of": _foot_of(description, joints, feet),
        "drives": drives,
        "springs": springs,
        "armature": {joint: inertia for joint, inertia in rotors.items() if inertia > 0.0},
        "joint_friction": {joint: value for joint, value in frictions.items() if value > 0.0},
        "friction": {link: contact.friction for link, contact in contacts.items()},
        "mass": description.mass(),
        "contact": {link: contact.softness(share) for link, contact in contacts.items()},
    }


def _height_and_rate(values: dict[str, Any]) -> tuple[float | None, float]:
    """Height of the base [m], None if not given, and control rate [Hz]."""
    height, rate = values.get("height"), values.get("control_rate", 250.0)
    if not _is_number(rate) or not 0.0 < rate <= 1e5:
        raise ParameterError(f"control_rate must be in (0, 100000] Hz, got {rate!r}")
    if height is not None and not _is_number(height):
        raise ParameterError(f"height must be a number [m], got {height!r}")
    return height, rate


def _with_legs(
    values: dict[str, Any], description: Description, path: Path
) -> tuple[dict[str, Any], np.ndarray]:
    """Contents of a ``robot.yaml`` completed from its legs, and the leg geometry, (4, 16).

    Joints, feet and standing pose are in the order of the legs. Missing values of pose, drives
    and fall limits are those of HyQ, scaled to the size of this robot.

    Raises:
        ParameterError: `joints` or `feet` are not those of the legs.
    """
    joints, feet = leg_geometry.names(values["legs"], description, str(path))
    listed, standing = list(values["joints"]), values.get("standing")
    for key, required, entries in (("joints", joints, listed), ("feet", feet, values.get("feet"))):
        if entries and sorted(map(str, entries)) != sorted(required):
            raise ParameterError(f"{path}: {_not_of_legs(key, list(map(str, entries)), required)}")
    posed = None
    if standing:
        posed = _standing(standing, len(joints))[[listed.index(joint) for joint in joints]]
    legs = leg_geometry.geometry(description, joints, feet, posed)
    size = similarity.size_of(legs, description.mass())
    if posed is None:
        posed = standing_pose(similarity.foot_origin(legs, size), legs)
    ordered = {"joints": list(joints), "feet": list(feet), "standing": posed.tolist()}
    if not values.get("drives"):
        swung = leg_geometry.swung_mass(description, joints)
        ordered["drives"] = _drives_like_hyq(joints, size.length, swung)
    if not values.get("fall"):
        ordered["fall"] = to_dict(similarity.scaled(LEGGED_FALL, size))
    return {**values, **ordered}, legs


def _not_of_legs(key: str, listed: list[str], expected: tuple[str, ...]) -> str:
    """Message on missing and extra names of a list compared with the legs, with the remedy."""
    extra = [name for name in listed if name not in expected]
    missing = [name for name in expected if name not in listed]
    if extra:
        cure = "fix it in the URDF, or take `legs` out" if key == "joints" else "take it out"
        return f"{key} must be those of legs, {', '.join(extra)} is none of them: {cure}"
    return f"{key} must be those of legs, {', '.join(missing) or 'one'} is missing or there twice"


def _drives_like_hyq(joints: tuple[str, ...], length: float, mass: float) -> dict[str, dict]:
    """Drives of HyQ by joint, scaled to legs of another length and mass [kg].

    The mass is that of the legs, since these gains swing the legs while the trunk controller
    carries the weight. With motors in the legs it is 46 to 63 % of a robot (HyQ: 30 %), for
    which gains scaled by the total mass are too small.
    """
    size = similarity.Size(length, round(mass / HYQ_LEGS, 6))
    hyq, drives = _read(ASSETS / "hyq" / "robot.yaml")["drives"], {}
    for i, joint in enumerate(joints):
        entry = dict(hyq[f"*_{JOINT_KINDS[i % len(JOINT_KINDS)]}_joint"])
        kind = DRIVES[entry.pop("kind")]
        drive = similarity.scaled(from_dict(kind, entry), size)
        drives[joint] = {"kind": "impedance", **to_dict(drive)}
    return drives


def _foot_of(description: Description, joints: tuple, feet: tuple) -> np.ndarray:
    """Index of the foot moved by each joint, (n,); -1 for none or several."""
    chains = [set(description.above(foot)) for foot in feet]
    moved = [[k for k, chain in enumerate(chains) if joint in chain] for joint in joints]
    return np.array([indices[0] if len(indices) == 1 else -1 for indices in moved], dtype=int)


def _standing(values: Any, count: int) -> np.ndarray:
    if values is None or values == []:
        return np.zeros(count)
    if not isinstance(values, list) or not all(map(_is_number, values)):
        raise ParameterError(f"standing must be a list of numbers, got {values!r}")
    if len(values) != count:
        raise ParameterError(f"standing must have {count} values, got {len(values)}")
    return np.array(values, dtype=float)


def _is_number(value: Any) -> bool:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number and math.isfinite(value)


def joint_index(joints: tuple[str, ...], pattern: str) -> np.ndarray:
    """Indices of the joints that match a name or fnmatch pattern.

    Raises:
        NameUnknownError: No joint has this name or matches this pattern.
    """
    indices = [i for i, joint in enumerate(joints) if fnmatchcase(joint, pattern)]
    if not indices:
        raise NameUnknownError("joint", pattern, joints)
    return np.array(indices)


def _path(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.parent == Path(".") and not path.suffix and not (path / "robot.yaml").is_file():
        if str(name_or_path) not in names():
            raise NameUnknownError("robot", str(name_or_path), names())
        path = ASSETS / path
    path = path / "robot.yaml" if path.is_dir() else path
    if not path.is_file():
        raise MissingFileError(f"there is no robot at {path}")
    return path


def _read(path: Path) -> dict[str, Any]:
    """Contents of a ``robot.yaml``, cached and therefore read-only."""
    return _parsed(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)  # cached: reading YAML dominates the time of loading a robot
def _parsed(path: Path, written: int) -> dict[str, Any]:
    """As `_read`, cached by the modification time `written` [ns]."""
    values = read_yaml(path, "robot")
    allowed = ("urdf", "joints", "feet", "standing", "legs", "guessed", LOCKED, equipment.UNCERTAIN)
    allowed += (*equipment.SCALARS, *equipment.BY_JOINT, *equipment.BY_LINK, *equipment.NESTED)
    if not isinstance(values, dict) or not {"urdf", "joints"} <= set(values):
        raise ParameterError(f"{path} must be a mapping with at least 'urdf' and 'joints'")
    for key in ("joints", "feet", "guessed"):
        listed = values.get(key) or []
        if not isinstance(listed, list) or len(set(map(str, listed))) != len(listed):
            raise ParameterError(
                f"{path}: {key} must be a list without repeats, got {shown(listed)}"
            )
    for key in (*values, *(values.get("guessed") or ())):
        if key not in allowed:
            raise NameUnknownError(f"key in {path}", key, allowed)
    return values


def _check_names(path: Path, description: Description, joints: tuple, feet: tuple) -> np.ndarray:
    """Effort limit of each joint [N·m], (n,); raises if a joint or foot is not in the URDF."""
    efforts = description.efforts()
    for kind, listed, valid in (("joint", joints, efforts), ("link", feet, description.links())):
        for name in listed:
            if name not in valid:
                raise NameUnknownError(f"{kind} of the URDF that {path} names", name, valid)
    return np.array([efforts[j] for j in joints])
