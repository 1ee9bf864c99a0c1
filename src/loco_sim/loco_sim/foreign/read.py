# SPDX-License-Identifier: Apache-2.0
"""Reading of a robot from a URDF, xacro or MJCF file, as a URDF element."""

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
from ..robot.urdf_check import MAX_SIZE, is_xacro, parse, parse_xml
from .notes import Notes
from .rotors import Rotors

mjcf = lazy.module("loco_sim.world.mjcf")  # loaded lazily: only MJCF files need MuJoCo

READ_TAGS = ("link", "joint", "material")
# Substitute for the ROS package index: packages in the environment or near the xacro file.
PACKAGES = """
import os, re
from pathlib import Path

class PackageNotFoundError(KeyError): pass

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
    for place in filter(Path.is_dir, places):
        return str(place)
    raise PackageNotFoundError(f"there is no package {name} near {near}")
"""
UNSUPPORTED = {
    "mujocoinclude": "is a part of an MJCF: name the file that includes it",
    "sdf": "is an SDF; a robot here comes from a URDF, a xacro or an MJCF",
}
TIMEOUT = 60.0  # time-out of xacro [s]


def read(path: Path, notes: Notes) -> tuple[ET.Element, Rotors]:
    """Links, joints and materials of a robot, and joint properties that a URDF cannot hold.

    Args:
        path: A URDF, a xacro or an MJCF.
        notes: Collects notes on omitted parts.

    Raises:
        ParameterError: The file is not a readable robot description.
    """
    text = read_bytes(path, "robot", MAX_SIZE).decode(errors="replace")
    root = parse_xml(text, str(path))
    if root.tag == "mujoco":
        require("mujoco")
        return mjcf.to_urdf(path, notes.add)
    if root.tag in UNSUPPORTED:
        raise ParameterError(f"{path} {UNSUPPORTED[root.tag]}")
    if is_xacro(root):
        text = _expanded(path)
        notes.add("expanded by xacro")
    defaults = re.compile(r"\$\(optenv \S+ ?([^)]*)\)")
    if defaults.search(text):
        notes.add("$(optenv ...) is read as its default")
    root = parse(defaults.sub(r"\1", text), str(path))
    for element in list(root):
        if element.tag not in READ_TAGS:
            root.remove(element)
            _loops(element, notes)
    return root, Rotors()


def stem(path: Path) -> str:
    """File name of a robot without the endings for its format."""
    return path.name.removesuffix(".xacro").removesuffix(".xml").removesuffix(".urdf")


def _loops(element: ET.Element, notes: Notes) -> None:
    """Note closed kinematic chains, which a plain URDF cannot express; they are left open."""
    tags = ("loop_joint",) if element.tag != "gazebo" else ("joint",)
    for joint in element.iter():
        if joint.tag in tags:
            name = joint.get("name") or ""
            notes.add("a closed chain stays open, as robots here are trees; without", name)


def _expanded(path: Path) -> str:
    """URDF expanded from a xacro file.

    Raises:
        ParameterError: xacro is not installed, or it fails.
    """
    command = shutil.which("xacro") or shutil.which(Path(sys.executable).with_name("xacro"))
    by_hand = f"xacro {path} > robot.urdf"
    if command is None:
        raise ParameterError(
            f"{path} is xacro, which makes a URDF: {by_hand} (pip install xacro, or source ROS)"
        )
    with tempfile.TemporaryDirectory() as place:
        try:
            done = subprocess.run(
                [command, str(path)], capture_output=True, text=True, timeout=TIMEOUT,
                check=False, env=_finding(path.resolve().parent, Path(place)),
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ParameterError(f"{path}: xacro did not end in {TIMEOUT:g} s: {by_hand}") from None
    if done.returncode:
        lines = map(str.strip, done.stderr.splitlines())
        reasons = [line for line in lines if line and not line.startswith("when ")]
        raise ParameterError(f"{path}: xacro: {reasons[-1] if reasons else 'failed'}; {by_hand}")
    return done.stdout


def _finding(folder: Path, place: Path) -> dict[str, str]:
    """Environment variables with which xacro finds packages near a folder, without a sourced ROS.

    Args:
        folder: Folder of the xacro.
        place: Empty folder that exists while xacro runs.
    """
    index = place / "ament_index_python"
    index.mkdir()
    (index / "__init__.py").touch()
    (index / "packages.py").write_text(PACKAGES, encoding="utf-8")
    paths = [path for path in (os.environ.get("PYTHONPATH"), str(place)) if path]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "LOCO_NEAR": str(folder)}
