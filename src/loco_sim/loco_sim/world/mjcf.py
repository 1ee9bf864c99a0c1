# SPDX-License-Identifier: Apache-2.0
"""Conversion of MJCF files to URDF, with MuJoCo's own reader.

A body becomes a link with its frame at the anchor of its last joint; each further joint of a
body adds a massless link in between. Joint positions are those of MuJoCo, including `ref`.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from loco_control.exceptions import ParameterError

from ..foreign.rotors import Rotors
from ..mesh_files import is_pointer
from ..meshes.read import read_mesh
from ..robot.frames import set_pose, turns

WORLD = "world"
JOINT_TYPES = {
    int(mujoco.mjtJoint.mjJNT_HINGE): "revolute",
    int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic",
    int(mujoco.mjtJoint.mjJNT_BALL): "spherical",
}
TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
GEOM = mujoco.mjtGeom
AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
EARTH, OFF_EARTH = 9.81, 0.01  # gravity [m/s²]; share by which that of a file differs in earnest
Note = Callable[[str, str], None]


@dataclass(frozen=True)
class Pose:
    """Position and rotation relative to another frame."""

    at: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))

    def then(self, other: Pose) -> Pose:
        """Composition of poses: `other`, given in this frame, relative to the outer frame."""
        return Pose(self.at + self.turn @ other.at, self.turn @ other.turn)

    def inverse(self) -> Pose:
        """Pose of the outer frame relative to this one."""
        return Pose(-self.turn.T @ self.at, self.turn.T)


def to_urdf(path: Path, note: Note) -> tuple[ET.Element, Rotors]:
    """URDF of the robot in an MJCF: the tree of bodies with the most joints.

    Args:
        path: The MJCF.
        note: Function called with a sentence about an omitted part, and its name.

    Returns:
        Root element of a URDF, and joint properties that a URDF cannot hold.

    Raises:
        ParameterError: MuJoCo cannot read the file.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        is_cut = _without_files(spec, path.resolve().parent, note)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about deprecated attributes
            model = spec.compile()
    except (ValueError, RuntimeError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        if "mass and inertia" in str(error) and is_cut:
            lines[2:] = ["a mass follows from a mesh, and that file is not there: put it where the "
                         "MJCF names it, or give the body an <inertial>"]  # fmt: skip
        raise ParameterError(f"{path}: MuJoCo: {'; '.join(lines[:3])}") from None
    return _Writer(spec, model, path.resolve().parent, note).written()


def _without_files(spec: mujoco.MjSpec, folder: Path, note: Note) -> bool:
    """Remove textures, and shapes with missing files; whether there was such a shape."""
    for part in (*spec.geoms, *spec.sites, *spec.tendons):
        part.material = ""
    for part in (*spec.skins, *spec.materials, *spec.textures):
        spec.delete(part)
    lost = {m.name: m.file for m in spec.meshes if m.file and not _exists(spec, folder, m.file)}
    for geom in list(spec.geoms):
        if geom.type == GEOM.mjGEOM_MESH and geom.meshname in lost:
            file = lost[geom.meshname]
            note("without a shape, as its mesh is not there", f"{geom.parent.name} ({file})")
            spec.delete(geom)
        elif geom.type == GEOM.mjGEOM_HFIELD:
            spec.delete(geom)
    for part in (*(m for m in spec.meshes if m.name in lost), *spec.hfields):
        spec.delete(part)
    return bool(lost)


def _mesh_file(spec: mujoco.MjSpec, folder: Path, file: str) -> Path:
    return folder / (spec.meshdir or "") / file


def _exists(spec: mujoco.MjSpec, folder: Path, file: str) -> bool:
    path = _mesh_file(spec, folder, file)
    return path.is_file() and not is_pointer(path) and read_mesh(path) is not None


class _Writer:
    """Traversal of a model that writes links and joints."""

    def __init__(self, spec: mujoco.MjSpec, model: mujoco.MjModel, folder: Path, note: Note):
        self._spec, self._model, self._folder, self._note = spec, model, folder, note
        self._root = ET.Element("robot", name=spec.modelname or "robot")
        self._rotors, self._frames = Rotors(), {0: Pose()}  # poses of bodies in their links
        self._limits = self._efforts()

    def written(self) -> tuple[ET.Element, Rotors]:
        """The URDF, and joint properties that it cannot hold."""
        model = self._model
        trees = self._trees()
        main = max(trees, key=lambda top: len(self._joints(trees[top])), default=None)
        if main is None:
            raise ParameterError("there is no body in it")
        held = [top for top in trees if not self._free(top) and self._joints(trees[top])]
        tops = [main] if self._free(main) or main not in held else held
        omitted = [self._name(top) for top in trees if top not in tops]
        for name in omitted:
            self._note("left out, as it is no part of the robot with the most joints", name)
        rooted = len(tops) == 1 and not self._joints([tops[0]])
        if not rooted:
            ET.SubElement(self._root, "link", name=WORLD)
        for top in tops:
            for body in trees[top]:
                self._body(body, rooted and body == top)
        self._leave_out()
        self._rotors.gravity = self._gravity()
        moved = {j for top in tops for j in self._joints(trees[top])}
        if model.nu:
            driven = {self._joint_name(j) for j in moved} & set(self._limits)
            self._rotors.idle = {self._joint_name(j) for j in moved} - driven if driven else set()
        return self._root, self._rotors

    # ---- the tree

    def _trees(self) -> dict[int, list[int]]:
        """Bodies of each tree, from its root outwards, by root."""
        trees: dict[int, list[int]] = {}
        for body in range(1, self._model.nbody):
            trees.setdefault(int(self._model.body_rootid[body]), []).append(body)
        return trees

    def _jnts(self, body: int) -> list[int]:
        first = self._model.body_jntadr[body]
        return list(range(first, first + self._model.body_jntnum[body]))

    def _free(self, body: int) -> bool:
        return any(self._model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE for j in self._jnts(body))

    def _joints(self, bodies: list[int]) -> list[int]:
        """Joints of bodies, except free joints."""
        joints = [j for body in bodies for j in self._jnts(body)]
        return [j for j in joints if self._model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE]

    def _name(self, body: int) -> str:
        name = self._model.body(body).name or f"body_{body}"
        return f"{name}_body" if name == WORLD else name

    def _joint_name(self, joint: int) -> str:
        body = self._model.jnt_bodyid[joint]
        return self._model.joint(joint).name or f"{self._name(body)}_joint_{joint}"

    def _body(self, body: int, root: bool) -> None:
        """Add a body: its joints, the links between them and its own link."""
        model, name = self._model, self._name(body)
        link = ET.Element("link", name=name)
        before, joints = int(model.body_parentid[body]), self._joints([body])
        parent = WORLD if before == 0 else self._name(before)
        place = Pose(model.body_pos[body], _turn(model.body_quat[body]))
        pending = self._frames[before].then(place)
        for k, joint in enumerate(joints):
            last = k == len(joints) - 1
            child = name if last else f"{name}_{self._joint_name(joint)}"
            pending = self._add_joint(joint, parent, child, pending)
            if not last:
                ET.SubElement(self._root, "link", name=child)
            parent = child
        if not joints and not root:
            self._connect(f"{name}_mount", "fixed", (parent, name), pending)
            pending = Pose()
        self._frames[body] = Pose() if root else pending
        self._root.append(link)
        self._weigh(body, link)
        for geom in range(
            model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]
        ):
            self._shape(geom, link, self._frames[body])

    def _connect(self, name: str, kind: str, links: tuple[str, str], at: Pose) -> ET.Element:
        joint = ET.SubElement(self._root, "joint", name=name, type=kind)
        set_pose(ET.SubElement(joint, "origin"), at.at, at.turn)
        ET.SubElement(joint, "parent", link=links[0])
        ET.SubElement(joint, "child", link=links[1])
        return joint

    def _add_joint(self, joint: int, parent: str, child: str, pending: Pose) -> Pose:
        """Add a joint; the pose of its child body in the frame of its child link."""
        model, name = self._model, self._joint_name(joint)
        kind, axis, anchor = (
            JOINT_TYPES[int(model.jnt_type[joint])],
            model.jnt_axis[joint],
            model.jnt_pos[joint],
        )
        ref = float(model.qpos0[model.jnt_qposadr[joint]]) if kind != "spherical" else 0.0
        if kind == "prismatic":
            place, back = pending.then(Pose(-ref * axis)), Pose()
        else:
            place, back = (
                pending.then(Pose(anchor, turns(axis, np.array([-ref]))[0])),
                Pose(-anchor),
            )
        limited = bool(model.jnt_limited[joint])
        written = "continuous" if kind == "revolute" and not limited else kind
        element = self._connect(name, written, (parent, child), place)
        ET.SubElement(element, "axis", xyz=_text(axis))
        limit = ET.SubElement(element, "limit")
        if limited and kind != "spherical":
            for key, value in zip(("lower", "upper"), model.jnt_range[joint], strict=True):
                limit.set(key, f"{value:.9g}")
        if self._limits.get(name, 0.0) > 0.0:
            limit.set("effort", f"{self._limits[name]:.9g}")
        dof = model.jnt_dofadr[joint]
        damping, friction = float(model.dof_damping[dof]), float(model.dof_frictionloss[dof])
        ET.SubElement(element, "dynamics", damping=f"{damping:.9g}", friction=f"{friction:.9g}")
        if kind != "spherical" and model.dof_armature[dof] > 0.0:
            self._rotors.armature[name] = float(model.dof_armature[dof])
        if kind != "spherical" and model.jnt_stiffness[joint] > 0.0:
            rest = float(model.qpos_spring[model.jnt_qposadr[joint]])
            self._rotors.springs[name] = float(model.jnt_stiffness[joint]), rest
        self._mimic(joint, element)
        return back

    def _mimic(self, joint: int, element: ET.Element) -> None:
        """Add ``<mimic>`` to a joint that a MuJoCo equality couples to another."""
        model = self._model
        for k in range(model.neq):
            if model.eq_type[k] != mujoco.mjtEq.mjEQ_JOINT or model.eq_obj1id[k] != joint:
                continue
            lead, data = int(model.eq_obj2id[k]), model.eq_data[k]
            if lead < 0:
                self._note("free, where the MJCF holds it by an equality", element.get("name"))
                continue
            if data[2:5].any():
                self._note(
                    "follows another along a straight line, not the curve", element.get("name")
                )
            reference, other = (float(model.qpos0[model.jnt_qposadr[j]]) for j in (joint, lead))
            ET.SubElement(
                element, "mimic", joint=self._joint_name(lead), multiplier=f"{data[1]:.9g}",
                offset=f"{reference + data[0] - data[1] * other:.9g}",
            )  # fmt: skip

    # ---- contents of links

    def _weigh(self, body: int, link: ET.Element) -> None:
        model = self._model
        if not model.body_mass[body] > 0.0:
            return
        place = Pose(model.body_ipos[body], _turn(model.body_iquat[body]))
        place = self._frames[body].then(place)
        tensor = place.turn @ np.diag(model.body_inertia[body]) @ place.turn.T
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_text(place.at))
        ET.SubElement(inertial, "mass", value=f"{model.body_mass[body]:.12g}")
        element = ET.SubElement(inertial, "inertia")
        for key, value in zip(TENSOR, tensor[np.triu_indices(3)], strict=True):
            element.set(key, f"{value:.12g}")

    def _shape(self, geom: int, link: ET.Element, frame: Pose) -> None:
        """Add a shape; as visual if it has no contacts."""
        model, kind = self._model, self._model.geom_type[geom]
        place = Pose(model.geom_pos[geom], _turn(model.geom_quat[geom]))
        size, body = model.geom_size[geom], None
        if kind == GEOM.mjGEOM_MESH:
            body, place = self._mesh(int(model.geom_dataid[geom]), place)
        elif kind == GEOM.mjGEOM_BOX:
            body = ET.Element("box", size=_text(2.0 * size))
        elif kind == GEOM.mjGEOM_CYLINDER or kind == GEOM.mjGEOM_CAPSULE:
            tag = "cylinder" if kind == GEOM.mjGEOM_CYLINDER else "capsule"
            body = ET.Element(tag, radius=f"{size[0]:.9g}", length=f"{2.0 * size[1]:.9g}")
        elif kind == GEOM.mjGEOM_SPHERE:
            body = ET.Element("sphere", radius=f"{size[0]:.9g}")
        elif kind == GEOM.mjGEOM_ELLIPSOID:
            self._note("an ellipsoid is read as a ball of its volume", link.get("name"))
            body = ET.Element("sphere", radius=f"{np.cbrt(size.prod()):.9g}")
        if body is None:
            self._note("without a shape that no URDF has", link.get("name"))
            return
        touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
        shape = ET.SubElement(link, "collision" if touches else "visual")
        place = frame.then(place)
        set_pose(ET.SubElement(shape, "origin"), place.at, place.turn)
        ET.SubElement(shape, "geometry").append(body)

    def _mesh(self, mesh: int, place: Pose) -> tuple[ET.Element | None, Pose]:
        """Element of a mesh, and its pose, corrected for MuJoCo's shift to the centre of mass."""
        model = self._model
        written = self._spec.meshes[mesh]
        if not written.file:
            return None, place
        moved = Pose(model.mesh_pos[mesh], _turn(model.mesh_quat[mesh]))
        path = _mesh_file(self._spec, self._folder, written.file).resolve()
        body = ET.Element("mesh", filename=str(path), scale=_text(model.mesh_scale[mesh]))
        return body, place.then(moved.inverse())

    # ---- gravity, actuators, and omitted parts

    def _gravity(self) -> float | None:
        """Gravity of a file that states another one than that of the earth [m/s²], else None."""
        pull = np.array(self._model.opt.gravity)
        if self._model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY:
            pull[:] = 0.0
        size = float(np.linalg.norm(pull))
        if np.hypot(*pull[:2]) > OFF_EARTH * EARTH or pull[2] > 0.0:
            self._note(f"gravity of {_text(pull)} m/s² in the file is read as downwards", "")
        elif abs(size - EARTH) <= OFF_EARTH * EARTH:
            return None
        return size

    def _efforts(self) -> dict[str, float]:
        """Effort limit of each joint with an actuator [N·m or N], 0 if it has none."""
        model, efforts, gains = self._model, {}, self._rotors.gains
        by_joint = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        for k in range(len(model.actuator_trntype)):
            if int(model.actuator_trntype[k]) not in by_joint:
                what = model.actuator(k).name or f"{k}"
                self._note("without the actuator, as it drives no joint (a tendon, a site)", what)
                continue
            joint, gear = int(model.actuator_trnid[k][0]), abs(float(model.actuator_gear[k][0]))
            name, effort = self._joint_name(joint), 0.0
            if model.actuator_forcelimited[k]:
                effort = gear * float(np.abs(model.actuator_forcerange[k]).max())
            elif model.actuator_ctrllimited[k] and not model.actuator_biastype[k]:
                gain = abs(float(model.actuator_gainprm[k][0]))
                effort = gear * gain * float(np.abs(model.actuator_ctrlrange[k]).max())
            efforts[name] = efforts.get(name, 0.0) + effort
            kp, (_, slope, drag) = (
                float(model.actuator_gainprm[k][0]),
                model.actuator_biasprm[k][:3],
            )
            if model.actuator_biastype[k] == AFFINE and kp > 0.0 and np.isclose(slope, -kp):
                gains[name] = gear**2 * kp, gear**2 * max(0.0, -float(drag))
        for joint in np.flatnonzero(model.jnt_actfrclimited):
            efforts[self._joint_name(joint)] = float(np.abs(model.jnt_actfrcrange[joint]).max())
        return efforts

    def _leave_out(self) -> None:
        """Note parts of the model that a URDF cannot hold."""
        model = self._model
        for k in range(model.neq):
            kind, pair = model.eq_type[k], (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))
            if kind == mujoco.mjtEq.mjEQ_CONNECT or kind == mujoco.mjtEq.mjEQ_WELD:
                on_bodies = model.eq_objtype[k] == mujoco.mjtObj.mjOBJ_BODY
                names = [self._name(end) for end in pair if end > 0] if on_bodies else []
                text = "a closed chain stays open, as robots here are trees; without the tie of"
                self._note(text, " and ".join(names) or model.equality(k).name or f"equality {k}")
            elif kind == mujoco.mjtEq.mjEQ_TENDON:
                self._note("without the equality of tendons", model.equality(k).name)
        for k in range(model.ntendon):
            self._note("without the tendon", model.tendon(k).name or f"{k}")
        for body in np.flatnonzero(model.body_gravcomp):
            self._note("its weight is not compensated here", self._name(body))


def _turn(quat: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion w x y z, (3, 3)."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, float))
    return matrix.reshape(3, 3)


def _text(values: np.ndarray) -> str:
    return " ".join(f"{v + 0.0:.9g}" for v in values)
