# SPDX-License-Identifier: Apache-2.0
"""Trial of meshes in a child process, since a mesh may crash an engine.

A mesh with valid numbers can still crash an engine's convex hull computation.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

from loco_control.exceptions import LocoError, ParameterError

from ..mesh_files import mesh_path
from ..robot import robot as robots
from . import world

SECONDS = 60  # processor time of all meshes of a robot [s]
MEMORY = 8 * 2**30  # memory limit of the child [bytes]
STEPS = 3  # physics steps, on the ground
VARIABLE = "LOCO_MESHES_TRIED"  # environment variable, so that workers do not repeat the trial
_COMMAND = ("-m", "loco_sim.world.mesh_trial")
_LINE = "mesh trial "
_URDF = """<robot name="trial"><link name="base"/><link name="part"><inertial><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial><collision><geometry>
<mesh filename={name} scale={scale}/></geometry></collision></link><joint name="joint"
type="continuous"><parent link="base"/><child link="part"/><axis xyz="0 1 0"/></joint></robot>"""
_ROBOT = {
    "urdf": "trial.urdf", "joints": ["joint"], "fixed_base": True, "height": 0.0,
    "drives": {"joint": {"kind": "torque"}},
}  # fmt: skip


def check(robot: robots.Robot, engine: str) -> None:
    """Refuse meshes of a robot on which an engine crashes or hangs, or which it refuses.

    Raises:
        ParameterError: An engine fails on a mesh; the message names the file and the failure.
    """
    parts = _meshes(robot)
    if not parts:
        return
    dates = [Path(path).stat().st_mtime_ns for path, _ in parts]
    key = hashlib.sha256(json.dumps([engine, parts, dates]).encode()).hexdigest()[:16]
    passed = os.environ.get(VARIABLE, "")
    if key not in passed.split():
        _try(engine, parts)
        os.environ[VARIABLE] = f"{passed} {key}"


def _meshes(robot: robots.Robot) -> list[tuple[str, str]]:
    """Unique files and scales of collision meshes."""
    pairs = set()
    for mesh in ET.fromstring(robot.urdf).iterfind("link/collision/geometry/mesh"):
        path = mesh_path(mesh.get("filename", ""), robot.folder)
        if path is not None:
            pairs.add((str(path.resolve()), mesh.get("scale", "1 1 1")))
    return sorted(pairs)


def _try(engine: str, parts: Sequence[tuple[str, str]]) -> None:
    child = subprocess.run(
        [sys.executable, *_COMMAND, json.dumps([engine, parts])],
        env={**os.environ, "PYTHONSAFEPATH": "1"}, stdin=subprocess.DEVNULL, capture_output=True,
        text=True, errors="replace", check=False,
    )  # fmt: skip
    lines = [line for line in child.stdout.splitlines() if line.startswith(_LINE)]
    report = json.loads(lines[-1].removeprefix(_LINE)) if lines else {}
    if child.returncode == 0 and "error" not in report:
        return
    if "error" not in report:
        report["error"] = f"{engine} {_end(child.returncode)}; simplify it, or take a box for it"
    raise ParameterError(f"the mesh {report.get('path', parts[0][0])}: {report['error']}")


def _end(code: int) -> str:
    if code == -signal.SIGXCPU:
        return f"is not done with it after {SECONDS} s of processor time"
    return f"ends on it ({signal.Signals(-code).name if code < 0 else f'exit code {code}'})"


def main() -> None:
    """Try the meshes listed in the first argument one by one, printing the current one."""
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    engine, parts = json.loads(sys.argv[1])
    for path, scale in parts:
        _report(path=path)
        try:
            load(engine, path, scale)
        except LocoError as error:
            _report(path=path, error=str(error))
            return


def load(engine: str, path: str, scale: str) -> None:
    """Build and step a robot with a single mesh in an engine in this process.

    Raises:
        LocoError: The engine refuses the mesh.
    """
    with tempfile.TemporaryDirectory() as folder:
        urdf = _URDF.format(name=quoteattr(path), scale=quoteattr(scale))
        (Path(folder) / "trial.urdf").write_text(urdf)
        (Path(folder) / "robot.yaml").write_text(json.dumps(_ROBOT))
        robot = robots.load(folder)
        module = importlib.import_module(world.MODULES[engine], world.__package__)
        simulator = module.World(robot, robot.sim.replace(engine=engine), 0.001)
        simulator.rebuild([0.0])
        for _ in range(STEPS):
            simulator.step([0.0])
        simulator.lowest_points()
        simulator.close()


def _report(**values: str) -> None:
    sys.stdout.write(f"\n{_LINE}{json.dumps(values)}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
