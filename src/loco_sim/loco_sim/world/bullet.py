# SPDX-License-Identifier: Apache-2.0
"""The plant's world in PyBullet; no other module uses PyBullet.

Peculiarities of PyBullet that this module hides:
    * the base pose it reports is that of the centre of mass, along principal axes;
    * torques and external forces are reset after each step;
    * torque limits of the URDF are not enforced (the caller clips);
    * a world is bit-reproducible when rebuilt, but not when its state is reset.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import weakref
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError

from ..geometry import Rotation, Triple, multiply, rotate, rotate_back, rotation_matrix
from ..meshes.read import rewritten
from ..params import SimParams
from ..robot.description import Description
from ..robot.robot import Robot
from ..terrain import CELL
from . import braking, hinges, world
from .ahead import Ahead, Contact
from .world import Base


def _import_pybullet():
    """The module `pybullet`, imported without its build banner."""
    saved = [(stream, os.dup(stream)) for stream in (1, 2)]
    with open(os.devnull, "wb") as sink:
        try:
            for stream, _ in saved:
                os.dup2(sink.fileno(), stream)
            import pybullet

            ctypes.CDLL(None).fflush(None)  # the banner may be in C's buffer
        finally:
            for stream, copy in saved:
                os.dup2(copy, stream)
                os.close(copy)
    return pybullet


pybullet = _import_pybullet()

MAX_DISTANCE = 1e4  # search distance for the ground [m]
DEPTH_SHARE = 0.0  # share of the penetration of a rigid contact that is corrected per step
HARD = 1e12  # damping that makes a compliant contact rigid again [N·s/m]
GROUND_FRICTION = 1.0  # PyBullet multiplies it with the robot's


class _Client:
    """The functions of PyBullet, bound to one client with its own world."""

    def __init__(self) -> None:
        self.number = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        function = partial(getattr(pybullet, name), physicsClientId=self.number)
        setattr(self, name, function)  # cached as an attribute
        return function


class World(world.World):
    """A world in a separate PyBullet client."""

    def __init__(self, robot: Robot, params: SimParams, dt: float):
        super().__init__(robot, params, dt)
        # Without visual shapes, which `figure` draws, loading takes half the time.
        self._flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_IGNORE_VISUAL_SHAPES
        self._client = _Client()
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self._client.number)
        self._body = self._ground = -1
        self._frames: dict[int, tuple[Triple, Rotation]] = {}  # of links, cached within a step

    def close(self) -> None:
        """Free the client; calling again does nothing."""
        self._disconnect()

    # ---- building ----------------------------------------------------------------

    def _lowest_foot(self) -> float:
        heights, other_feet = [], []
        for foot in self.robot.feet:
            shapes = self._client.getCollisionShapeData(self._body, self._links[foot])
            balls = self.description.balls(foot)
            if len(balls) == len(shapes):  # only spheres, or no shape
                bottoms = [self.place(foot, centre)[2] - radius for centre, radius in balls]
                heights.append(min(bottoms, default=self.place(foot)[2]))
            else:
                other_feet.append(foot)
        if other_feet:
            points = self.lowest_points()
            heights += [points[foot][2] for foot in other_feet]
        return min(heights)

    def _load(self, height: float) -> None:
        c, p = self._client, self.params
        self._stop_ratio: np.ndarray | None = None  # until a joint is braked
        self._drag: list[float] | None = None
        self._motor = self._zeros = [0.0] * len(self.robot.joints)
        self._ahead: Ahead | None = None
        c.resetSimulation()
        c.setTimeStep(self.dt)
        c.setGravity(*self.pull)
        c.setPhysicsEngineParameter(
            numSolverIterations=p.solver_iterations,
            deterministicOverlappingPairs=1,
            enableFileCaching=0,
        )
        self._ground = self._make_ground()
        c.changeDynamics(self._ground, -1, lateralFriction=GROUND_FRICTION, restitution=1.0)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(_with_own_meshes(self._urdf, Path(folder)), encoding="utf-8")
            try:
                self._body = c.loadURDF(
                    str(file), [0.0, 0.0, height],
                    useFixedBase=self.robot.fixed_base, flags=self._flags,
                )  # fmt: skip
            except pybullet.error as error:
                raise ParameterError(
                    f"PyBullet cannot build robot {self.robot.name!r}: {error}"
                ) from None
        self._index()
        self._set_contacts()

    def _engine_description(self) -> Description:
        """The robot with rotor inertias added to the driven links, as PyBullet has no armature."""
        if not self.armature:
            return self.description
        variant = Description(self.description.text())
        for joint, inertia in self.armature.items():
            variant.add_armature(joint, inertia)
        return variant

    def _make_ground(self) -> int:
        """Plane or terrain; PyBullet centres the range of heights at the origin of the terrain."""
        c, terrain = self._client, self.terrain
        if terrain is None:
            return self._make_plane()
        heights = terrain.heights
        shape = c.createCollisionShape(
            pybullet.GEOM_HEIGHTFIELD, meshScale=[CELL, CELL, 1.0],
            heightfieldData=heights.ravel().tolist(), numHeightfieldRows=heights.shape[1],
            numHeightfieldColumns=heights.shape[0],
        )  # fmt: skip
        middle = 0.5 * float(heights.min() + heights.max())
        return c.createMultiBody(0, shape, basePosition=[*terrain.centre, middle])

    def _make_plane(self) -> int:
        return self._client.createMultiBody(
            0, self._client.createCollisionShape(pybullet.GEOM_PLANE)
        )

    def _index(self) -> None:
        """Look up joints and links by name; switch PyBullet's own joint motors off."""
        c, body = self._client, self._body
        count = c.getNumJoints(body)
        info = [c.getJointInfo(body, i) for i in range(count)]
        joint = {i[1].decode(): i[0] for i in info}
        self._name = {index: name for name, index in joint.items()}
        self._links = {i[12].decode(): i[0] for i in info}
        self._links[self.description.root_link()] = -1
        self._links_by_index = {index: link for link, index in self._links.items()}
        self._joints = [joint[name] for name in self.robot.joints]
        self._read = self._joints + [self._links[link] for link in self.hinges]
        self._moving = [i[0] for i in info if i[2] != pybullet.JOINT_FIXED]
        self._foot_slot = {self._links[foot]: 3 * k for k, foot in enumerate(self.robot.feet)}
        c.setJointMotorControlArray(
            body, self._moving, pybullet.VELOCITY_CONTROL, forces=[0.0] * len(self._moving)
        )
        try:
            c.getJointStates(body, self._read)
        except pybullet.error as error:
            raise ParameterError(
                f"PyBullet cannot tell the joints of robot {self.robot.name!r}, which has {count} "
                f"links: {error} MuJoCo takes it (--engine mujoco)"
            ) from None
        inertial = c.getDynamicsInfo(body, -1)
        x, y, z, w = inertial[4]
        self._com, self._com_turn_back = inertial[3], (-x, -y, -z, w)

    def _set_contacts(self) -> None:
        """Set friction and compliance of every link; disable air damping and sleeping.

        PyBullet ignores friction if damping or activation are set in the same call.
        """
        c, body, p = self._client, self._body, self.params
        c.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0)
        fastest = self.description.fastest()
        if fastest > 100.0:
            c.changeDynamics(body, -1, maxJointVelocity=fastest)
        awake = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING
        c.changeDynamics(body, -1, activationState=awake)
        for name, link in self._links.items():
            values = {"restitution": p.restitution}
            friction = self.friction.get(name, p.friction)
            soft = self.softness(name)
            if soft[0] > 0.0:
                values["contactStiffness"], values["contactDamping"] = soft
            c.changeDynamics(body, link, lateralFriction=friction, **values)

    def _place(self, q: Sequence[float]) -> None:
        self._frames.clear()
        for joint, value in zip(self._joints, q, strict=True):
            self._client.resetJointState(self._body, joint, float(value))

    def pose(self, position: Triple, orientation: Sequence[float], q: Sequence[float]) -> None:
        """Set the pose: base position [m], orientation x y z w, and joint positions [rad], (n,)."""
        x, y, z, w = self._com_turn_back
        offset = rotate(rotation_matrix(orientation), self._com)
        com = [float(p + a) for p, a in zip(position, offset, strict=True)]
        turn = multiply(orientation, (-x, -y, -z, w))
        self._client.resetBasePositionAndOrientation(self._body, com, [float(v) for v in turn])
        self._place(q)

    def put(self, q: Sequence[float], dq: Sequence[float], base: Base | None = None) -> None:
        if base:
            position, orientation, velocity, spin = base
            self.pose(position, orientation, q)
            (ax, ay, az), (wx, wy, wz) = rotate(rotation_matrix(orientation), self._com), spin
            vx, vy, vz = velocity
            com = (vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax)
            self._client.resetBaseVelocity(self._body, com, spin)
        self._frames.clear()
        for joint, angle, rate in zip(self._joints, q, dq, strict=True):
            self._client.resetJointState(self._body, joint, float(angle), float(rate))

    # ---- one physics step --------------------------------------------------------

    def step(self, tau: Sequence[float]) -> None:
        if self._drag:
            tau = [a + b for a, b in zip(tau, self._drag, strict=True)]
        self._advance([*tau, *self._bending()])

    def _bending(self) -> list[float]:
        """Torques of the springs of hinges [N·m]."""
        if not self.hinges:
            return []
        springs = zip(self.hinges.values(), self._flex_states, self._hinged, strict=True)
        return [hinges.torque(*each, self.dt) for each in springs]

    def _advance(self, tau: list[float]) -> None:
        self._client.setJointMotorControlArray(
            self._body, self._read, pybullet.TORQUE_CONTROL, forces=tau
        )
        self._client.stepSimulation()
        if self._frames:
            self._frames.clear()

    def damped_step(self, tau: Sequence[float], law: np.ndarray) -> tuple:
        """As `world.World.damped_step`.

        PyBullet has no implicit damping, so the speed after the step is predicted (`ahead`), and
        the corresponding torque is applied.
        """
        n, (torque, gain, _, passive) = len(tau), law
        if self._ahead is None:
            names = tuple(self._name[j] for j in self._read)
            self._ahead = Ahead(self._engine_description(), names, self.robot.fixed_base, self.pull)
        motion = self.joint_states()
        hinge_tau = self._bending()
        laws, held = np.zeros((4, n + len(hinge_tau))), np.array([*tau, *hinge_tau])
        laws[:, :n] = law
        if hinge_tau:
            angles, rates = zip(*self._flex_states, strict=True)
            motion = (*motion[0], *angles), (*motion[1], *rates)
        after, caps = self._ahead.after(motion, self.base(), held, laws, self._touching(), self.dt)
        speed, caps = after[:n], caps[:n]
        drive = np.where(np.isnan(caps), torque - gain * speed, caps)
        self._advance([*(tau + drive - passive * speed).tolist(), *hinge_tau])
        return drive, speed

    def _touching(self) -> list[Contact]:
        """Contacts of the robot with the ground, including those expected in this step."""
        contacts, dt, p = [], self.dt, self.params
        for contact in self._client.getContactPoints(self._body, self._ground):
            link, distance = self._links_by_index[contact[3]], contact[8]
            k, d = self.softness(link)
            give, share = 0.0, DEPTH_SHARE
            if k > 0.0:
                give, share = 1.0 / (dt * (dt * k + d)), dt * k / (dt * k + d)
            speed = -distance / dt * (1.0 if distance > 0.0 else share)
            slip = self.friction.get(link, p.friction)
            contacts.append(Contact(link, contact[5], contact[7], speed, give, slip))
        return contacts

    def brake(self, budget: np.ndarray, dq: np.ndarray) -> None:
        """Brake each joint by up to this torque from now on.

        The engine solves it with the contacts, as a constraint of zero velocity with the
        budget as torque limit. A joint that is too fast to be stopped in one step gets the
        full budget as a torque, which is equivalent (`braking`).
        """
        if self._stop_ratio is None:
            if not budget.any():
                return
            inertia = self.joint_inertia(self.joint_states()[0])
            self._stop_ratio = braking.stopped_per_torque(inertia, self.dt)
            # Otherwise iterations end early and braked joints creep.
            self._client.setPhysicsEngineParameter(solverResidualThreshold=1e-10)
        both = np.empty((2, len(budget)))
        braking.split(budget, dq, self._stop_ratio, both)
        motor, self._drag = both.tolist()
        if motor != self._motor:
            self._motor = motor
            self._client.setJointMotorControlArray(
                self._body,
                self._joints,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=self._zeros,
                forces=motor,
            )

    def set_friction(self, link: str, friction: float) -> None:
        self.friction[link] = friction
        self._client.changeDynamics(self._body, self._links[link], lateralFriction=friction)

    def set_softness(self, link: str, stiffness: float, damping: float) -> None:
        self.contact[link] = stiffness, damping
        if stiffness <= 0.0:  # PyBullet cannot remove the spring
            stiffness, damping = 1.0, HARD
        self._client.changeDynamics(
            self._body, self._links[link], contactStiffness=stiffness, contactDamping=damping
        )

    def joint_states(self) -> tuple[Sequence[float], Sequence[float]]:
        states = self._client.getJointStates(self._body, self._read)
        q, dq, _, _ = zip(*states, strict=True)
        if not self.hinges:
            return q, dq
        n = len(self._joints)
        self._flex_states = list(zip(q[n:], dq[n:], strict=True))
        return q[:n], dq[:n]

    def add_ground_forces(self, total: list[float]) -> None:
        slots = self._foot_slot
        contacts = self._client.getContactPoints(self._body, self._ground)
        for _, _, _, link, _, _, _, normal, _, press, along, slide, across, side in contacts:
            if link in slots:
                slot = slots[link]
                total[slot] += press * normal[0] + along * slide[0] + across * side[0]
                total[slot + 1] += press * normal[1] + along * slide[1] + across * side[1]
                total[slot + 2] += press * normal[2] + along * slide[2] + across * side[2]

    def base(self) -> Base:
        com, turn = self._client.getBasePositionAndOrientation(self._body)
        (vx, vy, vz), omega = self._client.getBaseVelocity(self._body)
        orientation = multiply(turn, self._com_turn_back)
        ax, ay, az = rotate(rotation_matrix(orientation), self._com)  # origin to com, world
        wx, wy, wz = omega
        velocity = (vx - wy * az + wz * ay, vy - wz * ax + wx * az, vz - wx * ay + wy * ax)
        return Base((com[0] - ax, com[1] - ay, com[2] - az), orientation, velocity, omega)

    def push(
        self,
        force: Sequence[float],
        link: str | None = None,
        point: Sequence[float] = (0, 0, 0),
        at: Triple | None = None,
    ) -> None:
        index = -1 if link is None else self._links[link]
        at = self.place(link, point) if at is None else at
        self._client.applyExternalForce(self._body, index, force, at, pybullet.WORLD_FRAME)

    def place(self, link: str | None, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Triple:
        (x, y, z), matrix = self._frame(-1 if link is None else self._links[link])
        ox, oy, oz = rotate(matrix, offset)
        return x + ox, y + oy, z + oz

    def _frame(self, link: int) -> tuple[Triple, Rotation]:
        """Origin and rotation of a link's frame in the world, cached within a step."""
        if link in self._frames:
            return self._frames[link]
        if link < 0:
            com, turn = self._client.getBasePositionAndOrientation(self._body)
            local, back = self._com, self._com_turn_back
        else:
            # PyBullet returns the link's frame itself in single precision only.
            com, turn, local, (x, y, z, w) = self._client.getLinkState(
                self._body, link, computeForwardKinematics=1
            )[:4]
            back = -x, -y, -z, w
        matrix = rotation_matrix(multiply(turn, back))
        (cx, cy, cz), (lx, ly, lz) = com, rotate(matrix, local)
        self._frames[link] = (cx - lx, cy - ly, cz - lz), matrix
        return self._frames[link]

    # ---- rarely used-----------------------------------------------

    def lowest_points(self) -> dict[str, Triple]:
        """Lowest point of each collision link, world frame [m]; of convex hulls for meshes."""
        c = self._client
        names = {index: name for name, index in self._links.items()}
        lowest: dict[str, Triple] = {}
        # The point nearest to a height field is not the lowest, and the search is slow.
        plane = self._ground if self.terrain is None else self._make_plane()
        for closest in c.getClosestPoints(self._body, plane, MAX_DISTANCE):
            name, point = names[closest[3]], closest[5]
            if name not in lowest or point[2] < lowest[name][2]:
                lowest[name] = point
        if plane != self._ground:
            c.removeBody(plane)
        return lowest

    def energy(self) -> tuple[float, float]:
        c, body = self._client, self._body
        potential = kinetic = 0.0
        for link in self._links.values():
            mass, _, moments = c.getDynamicsInfo(body, link)[:3]
            if link < 0:
                at, turn = c.getBasePositionAndOrientation(body)
                velocity, spin = c.getBaseVelocity(body)
            else:
                state = c.getLinkState(
                    body, link, computeLinkVelocity=1, computeForwardKinematics=1
                )
                at, turn, velocity, spin = state[0], state[1], state[6], state[7]
            principal_spin = rotate_back(rotation_matrix(turn), spin)  # along principal axes
            potential -= mass * float(np.dot(self.pull, at))
            kinetic += 0.5 * mass * float(np.dot(velocity, velocity))
            kinetic += 0.5 * float(np.dot(moments, np.square(principal_spin)))
        return potential, kinetic

    def _mass_matrix(self, q: Sequence[float]) -> world.MassMatrix:
        position = dict(zip(self._joints, map(float, q), strict=True))
        moving = [position.get(j, 0.0) for j in self._moving]
        base = 0 if self.robot.fixed_base else 6
        row = {j: base + k for k, j in enumerate(self._moving)}
        try:
            mass = self._client.calculateMassMatrix(self._body, moving)
        except SystemError:
            text = "its inertias are too large for PyBullet; MuJoCo takes them"
            raise ParameterError(text) from None
        hinge_rows = [row[self._links[link]] for link in self.hinges]
        return np.array(mass), [row[j] for j in self._joints], list(range(base)), hinge_rows


def _with_own_meshes(text: str, folder: Path) -> str:
    """The URDF without visual shapes, with meshes validated and rewritten to a folder."""
    if "<mesh" not in text:
        return text
    root = ET.fromstring(text)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    written: dict[str, Path] = {}
    for mesh in root.iter("mesh"):
        name = mesh.get("filename", "")
        if name not in written:
            end, content = rewritten(Path(name))
            written[name] = folder / f"{len(written)}{end}"
            written[name].write_bytes(content)
        mesh.set("filename", str(written[name]))
    return ET.tostring(root, encoding="unicode")
