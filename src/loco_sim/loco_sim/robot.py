# SPDX-License-Identifier: Apache-2.0
"""A robot as the plant sees it: a URDF and the ``robot.yaml`` beside it.

Everything that differs between robots is in these two files; ``world.py`` and
``simulation.py`` know neither the number of joints nor that feet come in fours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.params import Params, from_dict, parameter

from . import equipment
from .description import Description
from .equipment import ContactParams
from .hall import HallSensor
from .params import SimParams
from .sensors import SensorParams
from .servo import DriveParams
from .spring import SpringParams

ASSETS = Path(__file__).parent / "assets"


@dataclass(frozen=True)
class FallLimits(Params):
    """Beyond these a robot counts as fallen. The defaults never do."""

    height: float = parameter(-1e9, "base origin lower than this", "m")
    roll: float = parameter(10.0, "|roll| larger than this", "rad", low=0.0)
    pitch: float = parameter(10.0, "|pitch| larger than this", "rad", low=0.0)


@dataclass(frozen=True)
class Robot:
    """What ``robot.yaml`` says, checked against the URDF.

    Attributes:
        name: Name of the folder.
        urdf: Text of the URDF.
        folder: Where the URDF lies; meshes are found from here.
        joints: Actuated joints, in the order of every (n,) array.
        feet: Links whose ground reaction force is sensed, in the order of (m, 3) arrays.
        standing: Joint positions at the start [rad], (n,).
        effort: Torque limit of each joint [N·m], (n,), from the URDF.
        fixed_base: The base is bolted to the world.
        height: Height of the base at the start [m]; None puts the lowest foot on the ground.
        fall: When the robot counts as fallen.
        driven: Indices in `joints` of those with a drive, (m,); the others are passive.
        control_rate: Rate at which the robot is usually commanded [Hz].
        sim: Physics that suits the robot.
        drives: Drive of each joint that has one; none at all means that every joint has
            an impedance whose gains come with the experiment.
        springs: Spring and damper of each joint that has them.
        friction: Friction of single links; others have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] of single links.
        sensors: Sensors, None if they tell the truth.
        hall: Hall sensor of each joint that has one.
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
    sim: SimParams = SimParams()
    drives: dict[str, DriveParams] = field(default_factory=dict)
    springs: dict[str, SpringParams] = field(default_factory=dict)
    friction: dict[str, float] = field(default_factory=dict)
    contact: dict[str, tuple[float, float]] = field(default_factory=dict)
    sensors: SensorParams | None = None
    hall: dict[str, HallSensor] = field(default_factory=dict, repr=False)

    @property
    def equipped(self) -> bool:
        """Drives or springs are in ``robot.yaml``."""
        return bool(self.drives or self.springs)

    def damping(self, stance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Zeros, and the damping of drives and springs [N·m·s/rad]; each (n,).

        The face of `drive.GainsOf`, with which the plant chooses its sub-steps.
        """
        each = [
            getattr(self.drives.get(joint), "damping", 0.0)
            + getattr(self.springs.get(joint), "damping", 0.0)
            for joint in self.joints
        ]
        return np.zeros(len(each)), np.array(each)


def names() -> list[str]:
    """Robots that come with the package."""
    return sorted(p.parent.name for p in ASSETS.glob("*/robot.yaml"))


def load(name_or_path: str | Path, overrides: Mapping[str, Any] | None = None) -> Robot:
    """Read a robot by name, or by the path of its ``robot.yaml`` or of the folder with it.

    Args:
        name_or_path: Which robot.
        overrides: Values of ``robot.yaml`` to change, by dotted name
            (`equipment.override`).

    Raises:
        NameUnknownError: No such robot comes with the package, or the file or an override
            names what is not there.
        MissingFileError: The path, or the URDF it names, does not exist.
        ParameterError: The file is not what it should be, or does not fit the URDF.
    """
    path = _path(name_or_path)
    values = _read(path)
    urdf = path.parent / str(values["urdf"])
    if not urdf.is_file():
        raise MissingFileError(f"{path}: there is no URDF at {urdf}")
    description = Description(urdf.read_text(encoding="utf-8"))
    joints, feet = tuple(values["joints"]), tuple(values.get("feet") or ())
    limits = _check_names(path, description, joints, feet)
    values = equipment.expanded(values, joints, description.links(), path)
    equipment.override(values, overrides or {}, description.links())
    try:
        fitted = _fit(path.parent, description, joints, feet, values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    return Robot(
        name=path.parent.name, folder=path.parent, joints=joints, feet=feet, effort=limits, **fitted
    )


def _fit(
    folder: Path, description: Description, joints: tuple, feet: tuple, values: dict[str, Any]
) -> dict[str, Any]:
    """Fields of a `Robot` that follow from an expanded ``robot.yaml``; edits the URDF."""
    standing = _standing(values.get("standing"), len(joints))
    drives = equipment.drives(values["drives"])
    springs = equipment.parts(values["springs"], SpringParams, "springs")
    contacts = equipment.parts(values["contacts"], ContactParams, "contacts")
    dynamics = equipment.parts(values["dynamics"], equipment.DynamicsParams, "dynamics")
    edited = bool(values["masses"] or dynamics)
    edited |= any(s.stop > -math.inf for s in springs.values())
    equipment.set_masses(description, values["masses"])
    equipment.set_dynamics(description, dynamics)
    for joint, spring in springs.items():
        if spring.stop > -math.inf:
            description.set_lower_limit(joint, spring.stop)
    sensors = from_dict(SensorParams, values["sensors"], "sensors")
    share = description.mass() / max(1, len(feet))
    equipped = bool(drives or springs)
    height, rate = values.get("height"), values.get("control_rate", 250.0)
    if not _is_number(rate) or not 0.0 < rate <= 1e5:
        raise ParameterError(f"control_rate must be in (0, 100000] Hz, got {rate!r}")
    if height is not None and not _is_number(height):
        raise ParameterError(f"height must be a number [m], got {height!r}")
    return {
        "urdf": description.text() if edited else (folder / str(values["urdf"])).read_text(),
        "standing": standing,
        "fixed_base": bool(values.get("fixed_base", False)),
        "height": None if height is None else float(height),
        "fall": from_dict(FallLimits, values["fall"], "fall"),
        "driven": np.array(
            [i for i, joint in enumerate(joints) if joint in drives or not equipped], dtype=int
        ),
        "control_rate": float(rate),
        "sim": from_dict(SimParams, values["sim"], "sim"),
        "sensors": sensors if values["sensors"] else None,
        "hall": sensors.hall_sensors(folder, joints),
        "drives": drives,
        "springs": springs,
        "friction": {link: contact.friction for link, contact in contacts.items()},
        "contact": {link: contact.softness(share) for link, contact in contacts.items()},
    }


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
    """Indices of the joints that a name or fnmatch pattern names.

    Raises:
        NameUnknownError: It names none.
    """
    found = [i for i, joint in enumerate(joints) if fnmatchcase(joint, pattern)]
    if not found:
        raise NameUnknownError("joint", pattern, joints)
    return np.array(found)


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
    """Contents of a ``robot.yaml``, not to be changed."""
    return _parsed(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)  # reading YAML takes most of the time of loading a robot
def _parsed(path: Path, written: int) -> dict[str, Any]:
    """As `_read`, for a file as it was written at a time [ns]."""
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ParameterError(f"{path} is not YAML: {error}") from None
    sections = (*equipment.BY_JOINT, *equipment.BY_LINK, *equipment.NESTED)
    known = ("urdf", "joints", "feet", "standing", *equipment.SCALARS, *sections)
    if not isinstance(values, dict) or not {"urdf", "joints"} <= set(values):
        raise ParameterError(f"{path} must be a mapping with at least 'urdf' and 'joints'")
    for key in ("joints", "feet"):
        listed = values.get(key) or []
        if not isinstance(listed, list) or len(set(map(str, listed))) != len(listed):
            raise ParameterError(f"{path}: {key} must be a list without repeats, got {listed!r}")
    for key in values:
        if key not in known:
            raise NameUnknownError(f"key in {path}", key, known)
    return values


def _check_names(path: Path, description: Description, joints: tuple, feet: tuple) -> np.ndarray:
    """Effort limit of each joint; every joint and foot must be in the URDF."""
    efforts = description.efforts()
    for kind, wanted, known in (("joint", joints, efforts), ("link", feet, description.links())):
        for name in wanted:
            if name not in known:
                raise NameUnknownError(f"{kind} of the URDF that {path} names", name, known)
    return np.array([efforts[j] for j in joints])
