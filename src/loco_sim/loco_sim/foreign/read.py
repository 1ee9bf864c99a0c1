# SPDX-License-Identifier: Apache-2.0
"""The element of a robot from a file of any kind: URDF, xacro or MJCF."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

from loco_control.exceptions import ParameterError
from loco_control.reading import read_bytes

from .. import lazy
from ..engines import require
from ..robot.urdf_check import MOST, is_xacro, parse, parse_xml
from .notes import Notes
from .rotors import Rotors

mjcf = lazy.module("loco_sim.world.mjcf")  # few robots need MuJoCo to be read

KEPT = ("link", "joint", "material")
# Stands for the package index of ROS: folders of packages in the environment or near the xacro.
PACKAGES = """
import os
import re
from pathlib import Path


class PackageNotFoundError(KeyError):
    pass


def get_package_share_directory(name):
    near = Path(os.environ["LOCO_NEAR"])
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    places = [Path(p) / "share" / name for p in prefixes if p]
    for folder in (near, *near.parents):
        manifest = folder / "package.xml"
        text = manifest.read_text(errors="replace") if manifest.is_file() else ""
        if folder.name == name or re.search(rf"<name>\\s*{re.escape(name)}\\s*</name>", text):
            places.append(folder)
        places.append(folder / name)
    for place in places:
        if place.is_dir():
            return str(place)
    raise PackageNotFoundError(f"there is no package {name} near {near}")
"""
REFUSED = {
    "mujocoinclude": "is a part of an MJCF: name the file that includes it",
    "sdf": "is an SDF; a robot here comes from a URDF, a xacro or an MJCF",
}
PATIENCE = 60.0  # of xacro [s]


def read(path: Path, notes: Notes) -> tuple[ET.Element, Rotors]:
    """Links, joints and materials of a robot, and what no URDF says of its joints.

    Args:
        path: A URDF, a xacro or an MJCF.
        notes: Collects what was left out.

    Raises:
        ParameterError: The file is no robot that can be read.
    """
    text = read_bytes(path, "robot", MOST).decode(errors="replace")
    root = parse_xml(text, str(path))
    if root.tag == "mujoco":
        require("mujoco")
        return mjcf.to_urdf(path, notes.add)
    if root.tag in REFUSED:
        raise ParameterError(f"{path} {REFUSED[root.tag]}")
    if is_xacro(root):
        text = _expanded(path)
        notes.add("expanded by xacro")
    defaults = re.compile(r"\$\(optenv \S+ ?([^)]*)\)")
    if defaults.search(text):
        notes.add("$(optenv ...) is read as its default")
    root = parse(defaults.sub(r"\1", text), str(path))
    for element in list(root):
        if element.tag not in KEPT:
            root.remove(element)
            _loops(element, notes)
    return root, Rotors()


def stem(path: Path) -> str:
    """Name of a robot's file without the endings that say what kind it is."""
    return path.name.removesuffix(".xacro").removesuffix(".xml").removesuffix(".urdf")


def _loops(element: ET.Element, notes: Notes) -> None:
    """Say which closed chains stay open: the URDF knows trees, its extensions close them."""
    tags = ("loop_joint",) if element.tag != "gazebo" else ("joint",)
    for joint in element.iter():
        if joint.tag in tags:
            name = joint.get("name") or ""
            notes.add("a closed chain stays open, as robots here are trees; without", name)


def _expanded(path: Path) -> str:
    """The URDF of a xacro.

    Raises:
        ParameterError: There is no xacro, or it fails.
    """
    beside = Path(sys.executable).with_name("xacro")
    command = shutil.which("xacro") or (str(beside) if beside.is_file() else None)
    by_hand = f"xacro {path} > robot.urdf"
    if command is None:
        raise ParameterError(
            f"{path} is xacro, which makes a URDF: {by_hand} (pip install xacro, or source ROS)"
        )
    with tempfile.TemporaryDirectory() as place:
        try:
            done = subprocess.run(
                [command, str(path)], capture_output=True, text=True, timeout=PATIENCE,
                check=False, env=_finding(path.resolve().parent, Path(place)),
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ParameterError(
                f"{path}: xacro did not end in {PATIENCE:g} s: {by_hand}"
            ) from None
    if done.returncode:
        lines = [line.strip() for line in done.stderr.splitlines()]
        reasons = [line for line in lines if line and not line.startswith("when ")]
        raise ParameterError(f"{path}: xacro: {reasons[-1] if reasons else 'failed'}; {by_hand}")
    return done.stdout


def _finding(folder: Path, place: Path) -> dict[str, str]:
    """Environment in which xacro finds packages near a folder, where ROS is not sourced.

    Args:
        folder: Folder of the xacro.
        place: Empty folder that lives as long as xacro runs.
    """
    index = place / "ament_index_python"
    index.mkdir()
    (index / "__init__.py").touch()
    (index / "packages.py").write_text(PACKAGES, encoding="utf-8")
    paths = [path for path in (os.environ.get("PYTHONPATH"), str(place)) if path]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "LOCO_NEAR": str(folder)}
