# SPDX-License-Identifier: Apache-2.0
"""MuJoCo model of a robot on the ground, built from its URDF."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ..geometry import Triple
from ..meshes.read import load
from ..terrain import CELL, Terrain

OF_WORLD = "link_named_world"  # name of the body of a link named "world"
NET_FORCE = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE), 3, 1  # net force of all contacts
GEOM = mujoco.mjtGeom


@lru_cache(maxsize=64)
def compiled(*arguments: Any) -> mujoco.MjModel:
    """Model of a URDF on the ground; cached, since reading may take longer than a run."""
    spec = plan(*arguments)
    for mesh in spec.meshes:
        _fill(mesh)
    return spec.compile()


def plan(
    text: str,
    dates: tuple[int, ...],
    root: str,
    feet: tuple[str, ...],
    dt: float,
    gravity: Triple,
    iterations: int,
    terrain: Terrain | None,
) -> mujoco.MjSpec:
    """Specification of a model of a URDF on the ground, before compilation.

    Args:
        text: The URDF.
        dates: Modification times of its meshes [ns].
        root: Name of the floating root link; "" if it is fixed to the world.
        feet: Links with measured ground force.
        dt: Physics step [s].
        gravity: Acceleration of gravity [m/s²].
        iterations: Largest number of iterations of the contact solver.
        terrain: Heights of the ground; None for a plane.

    Raises:
        ValueError: MuJoCo cannot build the model.
    """
    spec = mujoco.MjSpec.from_string(_for_mujoco(text))
    for mesh in spec.meshes:
        if mesh.file.lower().endswith(".dae"):  # MuJoCo cannot read it
            _fill(mesh)
    if root:
        spec.body(body_of(root)).add_freejoint()
    option = spec.option
    option.timestep, option.gravity = dt, gravity
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.iterations = iterations
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for geom in spec.geoms:
        geom.contype, geom.conaffinity, geom.solmix = 1, 0, 1.0
    spec.worldbody.add_geom(
        name="loco_ground", **_ground(spec, terrain),
        contype=0, conaffinity=1, condim=3, friction=[0.0, 0.0, 0.0], solmix=0.0,
    )  # fmt: skip
    for foot in feet:
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM, objname="loco_ground",
            reftype=mujoco.mjtObj.mjOBJ_BODY, refname=body_of(foot), intprm=NET_FORCE,
        )  # fmt: skip
    return spec


def _fill(mesh: mujoco.MjsMesh) -> None:
    """Replace the file of a mesh by validated corners and faces."""
    if mesh.file:
        shape = load(Path(mesh.file))
        mesh.uservert, mesh.userface = shape.vertices.ravel(), shape.faces.ravel()
        mesh.file = ""


def _ground(spec: mujoco.MjSpec, terrain: Terrain | None) -> dict[str, Any]:
    """Geom parameters of the ground; MuJoCo scales heights to [0, 1], above a base."""
    if terrain is None:
        return {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [0.0, 0.0, 1.0]}
    heights = terrain.heights
    (rows, columns), low = heights.shape, float(heights.min())
    size = [0.5 * CELL * (columns - 1), 0.5 * CELL * (rows - 1), float(np.ptp(heights)), 1.0]
    spec.add_hfield(
        name="loco_terrain", nrow=rows, ncol=columns, size=size, userdata=heights.ravel().tolist()
    )
    return {"type": mujoco.mjtGeom.mjGEOM_HFIELD, "hfieldname": "loco_terrain",
            "pos": [*terrain.centre, low]}  # fmt: skip


def body_of(link: str) -> str:
    """Name of the body of a link; "world" is reserved by MuJoCo."""
    return OF_WORLD if link == "world" else link


def link_of(body: str) -> str:
    """Name of the link of a body."""
    return "world" if body == OF_WORLD else body


def _for_mujoco(text: str) -> str:
    """URDF without visual shapes, in which every link remains a separate body."""
    robot = ET.fromstring(text)
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for element in robot.iter():
        for key in ("name", "link"):
            if element.tag in ("link", "parent", "child") and element.get(key):
                element.set(key, body_of(element.get(key)))
    extension = robot.find("mujoco")
    if extension is not None:
        robot.remove(extension)
    extension = ET.SubElement(robot, "mujoco")
    ET.SubElement(
        extension, "compiler", fusestatic="false", discardvisual="true", strippath="false",
        balanceinertia="true", inertiafromgeom="auto",
    )  # fmt: skip
    return ET.tostring(robot, encoding="unicode")


def dates(text: str) -> tuple[int, ...]:
    """Modification times of the existing meshes of a URDF [ns]."""
    paths = (Path(name) for name in sorted(set(re.findall(r'filename="([^"]+)"', text))))
    return tuple(path.stat().st_mtime_ns for path in paths if path.is_file())


def lowest_point(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Triple:
    """Lowest point of a shape, or of its convex hull for a mesh, world frame [m].

    Args:
        model: The model.
        data: State of the model, with up-to-date poses of shapes.
        geom: Index of the shape.
    """
    turn, size = data.geom_xmat[geom].reshape(3, 3), model.geom_size[geom]
    down = -turn[2]  # in the frame of the shape
    kind, away = model.geom_type[geom], np.sign(down)
    horizontal = down[:2] / max(float(np.hypot(*down[:2])), 1e-12)
    if kind == GEOM.mjGEOM_SPHERE:
        point = size[0] * down
    elif kind == GEOM.mjGEOM_CAPSULE:
        point = size[0] * down + [0.0, 0.0, size[1] * away[2]]
    elif kind == GEOM.mjGEOM_CYLINDER:
        point = np.array([*(size[0] * horizontal), size[1] * away[2]])
    elif kind == GEOM.mjGEOM_ELLIPSOID:
        point = size**2 * down / np.linalg.norm(size * down)
    elif kind == GEOM.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        corners = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        point = corners[np.argmax(corners @ down)]
    else:
        point = size * away
    return tuple((data.geom_xpos[geom] + turn @ point).tolist())
