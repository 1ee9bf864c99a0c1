# SPDX-License-Identifier: Apache-2.0
"""Fuzzing targets for URDFs and meshes: small files, checked and simulated for a few steps."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

from loco_control.exceptions import LocoError
from loco_control.types import MotionCommand
from loco_sim import engines
from loco_sim.foreign.tidy import Tidied
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots
from loco_sim.robot.description import Description
from loco_sim.world import mesh_trial as trial

STEPS, STEP = 3, 0.01  # number of steps, step [s]
SMALL = """<robot name="small">
<link name="base"><inertial><origin xyz="0 0 0.1" rpy="0 0 0"/><mass value="2"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
<collision><origin xyz="0 0 0"/><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
<collision><geometry><mesh filename="part.stl" scale="1 1 1"/></geometry></collision></link>
<link name="rod"><inertial><mass value="0.5"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
<visual><geometry><cylinder radius="0.02" length="0.3"/></geometry></visual></link>
<link name="tip"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
<origin xyz="0 0 0.1" rpy="0 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="5"/><dynamics damping="0.1" friction="0"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="rod"/>
<axis xyz="0 0 1"/><limit lower="0" upper="0.2" effort="10" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="rod"/><child link="tip"/></joint>
</robot>
"""
COLLADA = """<COLLADA><asset><unit meter="0.1"/></asset><library_geometries><geometry id="g">
<mesh><source id="s"><float_array count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#a" stride="3" count="4"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="NORMAL" source="#s" offset="1"/><p>0 0 1 0 2 0 0 0 3 0 1 0</p></triangles>
<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount>
<p>0 1 2 3</p></polylist></mesh></geometry></library_geometries>
<library_nodes><node id="n"><scale>1 2 1</scale><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="w"><node><translate>0 0 1</translate>
<rotate>0 0 1 30</rotate><instance_node url="#n"/></node>
<node><matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""
CORNERS = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")


def seeds() -> list[bytes]:
    """A small URDF, and those of loco's test benches."""
    folder = Path(robots.ASSETS)
    names = ("servo_pendulum", "tigrillo")
    return [SMALL.encode(), *((folder / f"{n}/{n}.urdf").read_bytes() for n in names)]


def build(data: bytes, folder: Path) -> None:
    """Read, repair and simulate a URDF.

    Raises:
        LocoError: The URDF is refused.
    """
    path = folder / "robot.urdf"
    path.write_bytes(data)
    (folder / "part.stl").write_bytes(_stl())
    _raise_worst([*_mended(path), *_simulated(path)])


def mesh_seeds() -> list[bytes]:
    """A tetrahedron as binary STL, text STL and OBJ."""
    rows = [" ".join(map(str, row)) for row in CORNERS.tolist()]
    faces = [[r for k, r in enumerate(rows) if k != without] for without in range(4)]
    text = "".join(f"facet\n{' '.join(f'vertex {r}' for r in face)} endfacet\n" for face in faces)
    obj = "".join(f"v {row}\n" for row in rows) + "vn 0 0 1\no a\nf 1 2 3\nf 1//1 4//1 2//1\n"
    return [_stl(), f"solid a\n{text}endsolid\n".encode(), f"{obj}g b\nf -1 -2 -3 1".encode()]


def build_mesh(data: bytes, folder: Path, *suffixes: str) -> None:
    """Read bytes as mesh files of several formats, and simulate the valid ones.

    Raises:
        LocoError: No format can be read, or an engine refuses a mesh.
    """
    errors = []
    for suffix in suffixes:
        path = folder / f"part{suffix}"
        path.write_bytes(data)
        try:
            for engine in engines.installed():
                trial.load(engine, str(path), "1 1 1")
        except LocoError as error:
            errors.append(error)
    if len(errors) == len(suffixes) or any("\n" in str(error) for error in errors):
        _raise_worst(errors)


def _stl() -> bytes:
    """A tetrahedron as a binary STL."""
    faces = [np.delete(CORNERS, k, axis=0).tobytes() for k in range(4)]
    triangles = b"".join(b"\0" * 12 + face + b"\0\0" for face in faces)
    return b"\0" * 80 + (4).to_bytes(4, "little") + triangles


def _raise_worst(errors: list[LocoError]) -> None:
    """Raise the first error with several lines if there is one, else the first error."""
    if errors:
        raise next((error for error in errors if "\n" in str(error)), errors[0])


def _mended(path: Path) -> Iterator[LocoError]:
    try:
        Tidied(path)
    except LocoError as error:
        yield error


def _simulated(path: Path) -> Iterator[LocoError]:
    """Errors of the engines, which receive the URDF only if it is valid."""
    try:
        joints = Description(path.read_text(errors="replace")).joint_types()
        values = {"urdf": path.name, "joints": list(joints), "fixed_base": True, "height": 1.0,
                  "drives": {joint: {"kind": "torque"} for joint in joints}}  # fmt: skip
        (path.parent / "robot.yaml").write_text(json.dumps(values))
        robot = robots.load(path.parent)
    except LocoError as error:
        yield error
        return
    for engine in engines.installed():
        try:
            params = dataclasses.replace(robot.sim, engine=engine)
            unprotected = mock.patch.object(trial, "check")
            with unprotected, Simulation(params, robot=robot, dt=STEP) as plant:
                zeros = np.zeros(len(robot.joints))
                for k in range(STEPS):
                    plant.step(MotionCommand(k, k * plant.dt, zeros, zeros))
        except LocoError as error:
            yield error
