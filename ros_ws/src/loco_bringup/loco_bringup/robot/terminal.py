# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco robot`: values read from a URDF, guessed values, next commands."""

from __future__ import annotations

import argparse
import glob
import shutil
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from loco_control.exceptions import LocoError, ParameterError
from loco_learning.jobs.child import Child, Failed
from loco_sim.foreign.read import stem
from loco_sim.new_robot.make import Result, make
from loco_sim.robot import robot as robots

from ..terminal import console, table


def show_new(a: argparse.Namespace) -> int:
    """`loco robot new`: write the folder, print the table and the next commands."""
    out = a.out or Path(stem(a.urdf))
    result = tried(a.urdf, out)
    title = f"{out}: a robot that {'stands' if result.stands else 'is bolted and swings'}"
    console.print(table(title, ("what", "value", "from"), result.rows))
    for note in result.notes:
        console.print(f"note: {note}")
    hint = f"look at {out / 'picture.png'}, " if (out / "picture.png").is_file() else ""
    sys.stdout.write(
        f"{hint}correct {out / 'robot.yaml'}, then\n"
        f"  loco run {out / 'experiment.yaml'}\n"
        f"  loco gap experiments {out}\n"
    )
    if robots.load(out).legs is not None:
        sys.stdout.write(f"  loco run hyq_trot_open --set robot={out}\n")
    return 0


def tried(urdf: Path, out: Path) -> Result:
    """Create a robot from a URDF in a separate process, since an engine may crash on it.

    Args:
        urdf: The URDF.
        out: New folder.

    Raises:
        ParameterError: The URDF cannot be converted; no files remain.
    """
    before = _unfinished(out)
    child = Child("the process that tries the robot", Result, _make, (urdf, out))
    try:
        while not (news := child.news()):
            time.sleep(0.02)
    finally:
        child.close()
        for folder in _unfinished(out) - before:
            shutil.rmtree(folder, ignore_errors=True)
    if isinstance(news[-1], Failed):
        text = news[-1].text
        raise ParameterError(text if str(urdf) in text or str(out) in text else f"{urdf}: {text}")
    return news[-1]


def _make(pipe: Connection, urdf: Path, out: Path) -> None:
    pipe.send(make(urdf, out))


def _unfinished(out: Path) -> set[Path]:
    """Temporary folders of unfinished robots with this name."""
    above = next(folder for folder in out.resolve().parents if folder.is_dir())
    return set(above.glob(f".{glob.escape(out.name)}.*"))


def show_robots(_: argparse.Namespace) -> int:
    """`loco robot`: print the list of robots."""
    console.print(table(*robot_table()))
    return 0


def robot_table() -> tuple[str, tuple, list]:
    """Title, columns and rows of a table: robots of loco, and in the current folder."""
    local = sorted(str(path.parent) for path in Path().glob("*/robot.yaml"))
    rows = []
    for name in [*robots.names(), *local]:
        try:
            robot = robots.load(name)
        except LocoError as error:
            rows.append((name, "?", "?", str(error)))
            continue
        driven, count = len(robot.driven), len(robot.joints)
        base = "bolted" if robot.fixed_base else f"floating, {len(robot.feet)} feet"
        classes = sorted({type(drive).__name__ for drive in robot.drives.values()})
        labels = ", ".join(c.replace("Params", "").replace("Drive", "").lower() for c in classes)
        what = f"{base}, {driven} of {count} joints driven" + (f" ({labels})" if labels else "")
        rows.append((name, f"{robot.mass:.3g} kg", _size(robot), what))
    return "Robots (loco gap experiments NAME; loco robot new URDF)", COLUMNS, rows


COLUMNS = ("name or folder", "mass", "limits", "what it is")


def _size(robot: robots.Robot) -> str:
    """Largest torque limit of a robot."""
    efforts = robot.effort[np.isfinite(robot.effort)]
    return f"{efforts.max():.3g} N·m" if len(efforts) else "none"
