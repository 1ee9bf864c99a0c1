# SPDX-License-Identifier: Apache-2.0
"""Terminal command `loco gap mapping`."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.files import write_whole
from loco_learning.gap.drafting.draft import of_table
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.importing import importing, tables
from loco_learning.gap.recordings import mapping
from loco_learning.gap.setup.limits import LIMITS
from loco_sim import lazy
from loco_sim.plant import model as models
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import TorqueDrive

from ...bag.foreign.opening import open_bag, suffix_of
from ...outcome import file_at
from .topics import of_bag

_new_robot = lazy.module("loco_bringup.robot.terminal")
FORMATS = (".urdf", ".xacro", ".xml")  # descriptions of a robot without drives


def show_draft(a: argparse.Namespace) -> int:
    """Print a draft, or write it to a new file.

    Returns:
        The exit code.

    Raises:
        LocoError: The recording cannot be read, or the file exists already.
    """
    file = file_at(a.out, Path(mapping.FILE)) if a.out else None
    if file and file.exists():
        raise ParameterError(f"{file} is there already; choose another --out, or remove it")
    text = draft(a.file, _joints(a.robot) if a.robot else Joints())
    if file:
        sys.stdout.write(f"{write_whole(file, text)}\n")
    else:
        sys.stdout.write(text)
    return 0


def _joints(robot: str) -> Joints:
    """`joints_of` a robot, or of a description of one."""
    if Path(robot).suffix not in FORMATS:
        return joints_of(models.load_any(robot).make_robot())
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "robot")
        _new_robot.tried(Path(robot), made)
        return joints_of(models.load_any(str(made)).make_robot())


def joints_of(robot: Robot) -> Joints:
    """Joints of a robot; `follows` and `passive` are empty where drives are guessed."""
    known = {} if "drives" in robot.guessed else robot.drives
    passive = [j for j in robot.joints if j not in known] if known else []
    follows = [j for j, drive in known.items() if not isinstance(drive, TorqueDrive)]
    text = Description(robot.urdf)
    wheels = [joint for joint, kind in text.joint_types().items() if kind == "continuous"]
    endless = {joint: text.velocity(joint) or LIMITS.fastest for joint in wheels}
    return Joints(robot.joints, follows, passive, endless)


def draft(path: str | Path, joints: Joints) -> str:
    """Text of a mapping for a recording.

    Args:
        path: Bag, table, or folder of tables, of which the first is used.
        joints: Joints of the robot, without names if it is unknown.

    Raises:
        LocoError: The recording cannot be read, or the role of no signal can be guessed.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFileError(importing.NO_RECORDING.format(path))
    if suffix_of(path):
        text = of_bag(open_bag(path), joints)
    else:
        file = path
        if path.is_dir():
            file = next((p for p in sorted(path.iterdir()) if tables.is_table(p)), path)
        if not file.is_file() or not tables.is_table(file):
            raise ParameterError(
                f"{path} is no recording: neither a bag (of `ros2 bag record`) nor a table "
                f"({', '.join(tables.SUFFIXES)}); give a text of rows the ending .txt"
            )
        text = of_table(tables.read(file), joints)
        if path.is_dir():
            text += f'files: "*{"".join(file.suffixes)}"\n'
    mapping.loads(text, mapping.FILE)
    return text
