# SPDX-License-Identifier: Apache-2.0
"""The physics engine behind one door: the only module that imports PyBullet.

A `World` is one robot on flat ground in a PyBullet client of its own. It speaks
in joints, feet and links by name and order of the `Robot`; it knows nothing of
controllers, sensors or effects. Numbers go in and out as plain lists, because for
a dozen joints that is several times faster than arrays.

PyBullet's habits that this module hides:
    * the base pose it reports is that of the centre of mass, along principal axes;
    * torques and external forces last for one step and must be given again;
    * torque limits of the URDF are not enforced (the caller clips);
    * a world is bit-reproducible when it is rebuilt, not when it is set back.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import weakref
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import braking
from .description import Description
from .geometry import multiply, rotate, rotate_back, rotation_matrix
from .params import SimParams
from .robot import Robot, joint_index


def _import_pybullet():
    """PyBullet, without the build banner that it writes when it is loaded."""
    saved = [(stream, os.dup(stream)) for stream in (1, 2)]
    with open(os.devnull, "wb") as sink:
        try:
            for stream, _ in saved:
                os.dup2(sink.fileno(), stream)
            import pybullet

            ctypes.CDLL(None).fflush(None)  # the banner may wait in C's own buffer
        finally:
            for stream, copy in saved:
                os.dup2(copy, stream)
                os.close(copy)
    return pybullet


pybullet = _import_pybullet()

Triple = tuple[float, float, float]
GROUND_FRICTION = 1.0  # PyBullet multiplies the two; so the robot's is the contact's


class Base(NamedTuple):
    """State of the root link's frame, in the world."""

    position: Triple  # [m]
    orientation: tuple[float, float, float, float]  # x y z w
    velocity: Triple  # of the frame's origin [m/s]
    angular_velocity: Triple  # [rad/s]


class World:
    """One robot on the ground.

    Attributes:
        description: The URDF, which `configure` functions may edit.
        friction: Friction of single links; others have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] of single links; others
            have the world's.
        gravity: Acceleration of gravity [m/s²], (3,); a slope is gravity turned.
        dt: Physics step [s].
    """

    def __init__(self, robot: Robot, params: SimParams, dt: float, visible: bool = False):
        self.robot, self.params, self.dt = robot, params, dt
        self._flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        if not visible:  # then loading takes half the time, and `picture` is empty
            self._flags |= pybullet.URDF_IGNORE_VISUAL_SHAPES
        self._client = pybullet.connect(pybullet.DIRECT)
        self._disconnect = weakref.finalize(self, pybullet.disconnect, self._client)
        self._body = self._ground = -1
        self.description = Description(robot.urdf)
        self.friction: dict[str, float] = {}
        self.contact: dict[str, tuple[float, float]] = {}
        self.gravity: Triple = (0.0, 0.0, -params.gravity)

    @property
    def driven(self) -> np.ndarray:
        """Indices of the joints with a drive in the robot's joints, (m,)."""
        return self.robot.driven

    def joint_index(self, pattern: str) -> np.ndarray:
        """Indices of the robot's joints that a name or fnmatch pattern names.

        Raises:
            NameUnknownError: It names none.
        """
        return joint_index(self.robot.joints, pattern)

    def close(self) -> None:
        """Free the client; calling again does nothing."""
        self._disconnect()

    def rebuild(
        self,
        q: Sequence[float],
        configure: Iterable[Callable[[World], None]] = (),
        height: float | None = None,
    ) -> None:
        """Build the world anew, with the robot at rest.

        Args:
            q: Joint positions [rad], (n,).
            configure: Called with this world before the robot is loaded; may edit
                `description`, `friction`, `contact` and `gravity`.
            height: Of the base [m]; None puts the lowest foot on the ground.
        """
        self.description, self.friction = Description(self.robot.urdf), {}
        self.contact, self.gravity = {}, (0.0, 0.0, -self.params.gravity)
        self.friction.update(self.robot.friction)
        self.contact.update(self.robot.contact)
        self._slow: np.ndarray | None = None  # no joint has been braked yet
        self._drag: list[float] | None = None
        self._still = [0.0] * len(self.robot.joints)
        self._motor = self._still
        for function in configure:
            function(self)
        self._load(0.0 if height is None else height)
        self._place(q)
        if height is None and self.robot.feet:
            self._load(-self._lowest_foot())
            self._place(q)

    def _load(self, height: float) -> None:
        c, p = self._client, self.params
        pybullet.resetSimulation(physicsClientId=c)
        pybullet.setTimeStep(self.dt, physicsClientId=c)
        pybullet.setGravity(*self.gravity, physicsClientId=c)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=p.solver_iterations,
            deterministicOverlappingPairs=1,
            enableFileCaching=0,
            physicsClientId=c,
        )
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=c)
        self._ground = pybullet.createMultiBody(0, plane, physicsClientId=c)
        pybullet.changeDynamics(
            self._ground, -1, lateralFriction=GROUND_FRICTION, restitution=1.0, physicsClientId=c
        )
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "robot.urdf"
            file.write_text(self.description.text(self.robot.folder), encoding="utf-8")
            self._body = pybullet.loadURDF(
                str(file),
                [0.0, 0.0, height],
                useFixedBase=self.robot.fixed_base,
                flags=self._flags,
                physicsClientId=c,
            )
        self._index()
        self._set_contacts()

    def _index(self) -> None:
        """Look up joints and links by name; switch PyBullet's own joint motors off."""
        c, body = self._client, self._body
        count = pybullet.getNumJoints(body, physicsClientId=c)
        info = [pybullet.getJointInfo(body, i, physicsClientId=c) for i in range(count)]
        joint = {i[1].decode(): i[0] for i in info}
        self._links = {i[12].decode(): i[0] for i in info}
        self._links[self.description.root_link()] = -1
        self._joints = [joint[name] for name in self.robot.joints]
        self._moving = [i[0] for i in info if i[2] != pybullet.JOINT_FIXED]
        self._foot_slot = {self._links[foot]: 3 * k for k, foot in enumerate(self.robot.feet)}
        pybullet.setJointMotorControlArray(
            body,
            self._moving,
            pybullet.VELOCITY_CONTROL,
            forces=[0.0] * len(self._moving),
            physicsClientId=c,
        )
        inertial = pybullet.getDynamicsInfo(body, -1, physicsClientId=c)
        x, y, z, w = inertial[4]
        self._com, self._com_turn_back = inertial[3], (-x, -y, -z, w)

    def _set_contacts(self) -> None:
        """Friction and softness of every link; no damping by air, no falling asleep.

        Friction is ignored when damping or activation are in the same call.
        """
        c, body, p = self._client, self._body, self.params
        pybullet.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=c)
        awake = pybullet.ACTIVATION_STATE_DISABLE_SLEEPING
        pybullet.changeDynamics(body, -1, activationState=awake, physicsClientId=c)
        for name, link in self._links.items():
            values = {"restitution": p.restitution}
            friction = self.friction.get(name, p.friction)
            soft = self.contact.get(name, (p.contact_stiffness, p.contact_damping))
            if soft[0] > 0.0:
                values["contactStiffness"], values["contactDamping"] = soft
            pybullet.changeDynamics(
                body, link, lateralFriction=friction, **values, physicsClientId=c
            )

    def _place(self, q: Sequence[float]) -> None:
        for joint, value in zip(self._joints, q, strict=True):
            pybullet.resetJointState(self._body, joint, float(value), physicsClientId=self._client)

    def _lowest_foot(self) -> float:
        """Height of the lowest foot's underside over the base origin [m]."""
        lowest = []
        for foot in self.robot.feet:
            shape = pybullet.getCollisionShapeData(
                self._body, self._links[foot], physicsClientId=self._client
            )
            round_foot = shape and shape[0][2] == pybullet.GEOM_SPHERE
            radius = shape[0][3][0] if round_foot else 0.0
            lowest.append(self.link_position(foot)[2] - radius)
        return min(lowest) - self.base().position[2]

    # ---- one physics step --------------------------------------------------------

    def step(self, tau: Sequence[float]) -> None:
        """Apply joint torques [N·m], (n,), and advance one physics step."""
        if self._drag:
            tau = [a + b for a, b in zip(tau, self._drag, strict=True)]
        pybullet.setJointMotorControlArray(
            self._body,
            self._joints,
            pybullet.TORQUE_CONTROL,
            forces=tau,
            physicsClientId=self._client,
        )
        pybullet.stepSimulation(self._client)

    def brake(self, budget: np.ndarray, dq: np.ndarray) -> None:
        """Let each joint be stopped by up to this torque from now on.

        The engine solves it with the contacts: a constraint of zero velocity whose
        torque is at most the budget. A joint that is too fast to be stopped in one step
        gets all of it as a torque, which is the same (`braking`). It acts beside the
        torque given to `step`.

        Args:
            budget: Largest stopping torque [N·m], (n,), >= 0.
            dq: Joint velocities [rad/s], (n,).
        """
        if self._slow is None:
            if not budget.any():
                return
            inertia = self.joint_inertia([state[0] for state in self.joint_states()])
            self._slow = braking.stopped_per_torque(inertia, self.dt)
            # Else iterations end early and held joints creep.
            pybullet.setPhysicsEngineParameter(
                solverResidualThreshold=1e-10, physicsClientId=self._client
            )
        motor, drag = braking.split(budget, dq, self._slow)
        self._drag, motor = drag.tolist(), motor.tolist()
        if motor != self._motor:
            self._motor = motor
            pybullet.setJointMotorControlArray(
                self._body,
                self._joints,
                pybullet.VELOCITY_CONTROL,
                targetVelocities=self._still,
                forces=motor,
                physicsClientId=self._client,
            )

    def set_friction(self, link: str, friction: float) -> None:
        """Change the friction of a link from now on."""
        pybullet.changeDynamics(
            self._body, self._links[link], lateralFriction=friction, physicsClientId=self._client
        )

    def bend(self, link: str, stiffness: float, damping: float) -> None:
        """Spring and damper for the next step in a joint that is not the robot's own.

        Args:
            link: The link that the joint moves.
            stiffness: Of the joint [N·m/rad].
            damping: Of the joint [N·m·s/rad].
        """
        body, joint, c = self._body, self._links[link], self._client
        angle, rate = pybullet.getJointState(body, joint, c)[:2]
        tau = -stiffness * angle - damping * rate
        pybullet.setJointMotorControl2(
            body, joint, pybullet.TORQUE_CONTROL, force=tau, physicsClientId=c
        )

    def joint_states(self) -> tuple[tuple[float, float, tuple, float], ...]:
        """Per joint: position [rad], velocity [rad/s], and two things of no use here."""
        return pybullet.getJointStates(self._body, self._joints, self._client)

    def add_ground_forces(self, total: list[float]) -> None:
        """Add the last step's force of the ground on each foot [N], world frame.

        Args:
            total: x y z of each foot in turn, (3 m,); changed in place.
        """
        slots = self._foot_slot
        contacts = pybullet.getContactPoints(self._body, self._ground, physicsClientId=self._client)
        for _, _, _, link, _, _, _, normal, _, press, along, slide, across, side in contacts:
            if link in slots:
                slot = slots[link]
                total[slot] += press * normal[0] + along * slide[0] + across * side[0]
                total[slot + 1] += press * normal[1] + along * slide[1] + across * side[1]
                total[slot + 2] += press * normal[2] + along * slide[2] + across * side[2]

    def base(self) -> Base:
        """State of the root link's frame (its origin, not its centre of mass)."""
        com, turn = pybullet.getBasePositionAndOrientation(self._body, self._client)
        (vx, vy, vz), omega = pybullet.getBaseVelocity(self._body, self._client)
        orientation = multiply(turn, self._com_turn_back)
        ax, ay, az = rotate(rotation_matrix(orientation), self._com)  # origin to com, in world
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
        """Apply a force for the next step.

        Args:
            force: In the world frame [N], (3,).
            link: Name of the link; None is the root link.
            point: Where, in the frame of the link [m].
            at: The same point in world [m], when it is known.
        """
        index = -1 if link is None else self._links[link]
        at = self.place(link, point) if at is None else at
        pybullet.applyExternalForce(
            self._body, index, force, at, pybullet.WORLD_FRAME, self._client
        )

    def place(self, link: str | None, offset: Sequence[float]) -> Triple:
        """Where a point fixed to a link is in the world [m].

        Args:
            link: Name of the link; None is the root link.
            offset: The point, in the frame of the link [m].
        """
        index = -1 if link is None else self._links[link]
        if index < 0:
            com, turn = pybullet.getBasePositionAndOrientation(self._body, self._client)
            local, back = self._com, self._com_turn_back
        else:
            # The link's frame itself is given in single precision only.
            com, turn, local, (x, y, z, w) = pybullet.getLinkState(
                self._body, index, computeForwardKinematics=1, physicsClientId=self._client
            )[:4]
            back = -x, -y, -z, w
        matrix = rotation_matrix(multiply(turn, back))
        (cx, cy, cz), (lx, ly, lz) = com, rotate(matrix, local)
        ox, oy, oz = rotate(matrix, offset)
        return cx - lx + ox, cy - ly + oy, cz - lz + oz

    # ---- questions asked rarely --------------------------------------------------

    def link_position(self, link: str) -> Triple:
        """Position of a link's frame in the world [m]."""
        return self.place(link, (0.0, 0.0, 0.0))

    def point(self, link: str | None, offset: Sequence[float]) -> np.ndarray:
        """Where a point fixed to a link is in the world [m], (3,).

        Args:
            link: Name of the link; None is the root link.
            offset: The point, in the frame of the link [m].
        """
        return np.array(self.place(link, offset))

    def energy(self) -> tuple[float, float]:
        """Potential energy in gravity (0 at the world's origin) and kinetic energy [J]."""
        c, body = self._client, self._body
        potential = kinetic = 0.0
        for link in self._links.values():
            mass, _, moments = pybullet.getDynamicsInfo(body, link, physicsClientId=c)[:3]
            if link < 0:
                at, turn = pybullet.getBasePositionAndOrientation(body, c)
                velocity, spin = pybullet.getBaseVelocity(body, c)
            else:
                state = pybullet.getLinkState(
                    body,
                    link,
                    computeLinkVelocity=1,
                    computeForwardKinematics=1,
                    physicsClientId=c,
                )
                at, turn, velocity, spin = state[0], state[1], state[6], state[7]
            own = rotate_back(rotation_matrix(turn), spin)  # along the principal axes
            potential -= mass * float(np.dot(self.gravity, at))
            kinetic += 0.5 * mass * float(np.dot(velocity, velocity))
            kinetic += 0.5 * float(np.dot(moments, np.square(own)))
        return potential, kinetic

    def joint_inertia(self, q: Sequence[float]) -> np.ndarray:
        """Inertia that the joints feel [kg·m²], (n, n), base free to move unless fixed.

        M_qq - M_qb M_bb^-1 M_bq of the joint-space mass matrix: what is left when
        the base follows without being held.
        """
        position = dict(zip(self._joints, map(float, q), strict=True))
        moving = [position.get(j, 0.0) for j in self._moving]
        mass = np.array(
            pybullet.calculateMassMatrix(self._body, moving, physicsClientId=self._client)
        )
        base = 0 if self.robot.fixed_base else 6
        order = [base + self._moving.index(j) for j in self._joints]
        joints, cross = mass[np.ix_(order, order)], mass[np.ix_(order, range(base))]
        if not base:
            return joints
        return joints - cross @ np.linalg.solve(mass[:base, :base], cross.T)

    # ---- pictures ----------------------------------------------------------------

    def pose(self, position: Triple, orientation: Sequence[float], q: Sequence[float]) -> None:
        """Put the robot somewhere, for a picture: the base frame and the joints."""
        x, y, z, w = self._com_turn_back
        offset = rotate(rotation_matrix(orientation), self._com)
        com = [float(p + a) for p, a in zip(position, offset, strict=True)]
        turn = multiply(orientation, (-x, -y, -z, w))
        pybullet.resetBasePositionAndOrientation(
            self._body, com, [float(v) for v in turn], physicsClientId=self._client
        )
        self._place(q)

    def corners(self, margin: float = 0.08) -> np.ndarray:
        """Corners of a box around each link, in world [m], (8 * links, 3).

        Args:
            margin: Added on all sides, for what is seen but does not collide [m].
        """
        boxes = [
            pybullet.getAABB(self._body, link, physicsClientId=self._client)
            for link in self._links.values()
        ]
        sides = np.array(boxes) + [[-margin], [margin]]  # (links, 2, 3)
        pick = np.indices((2, 2, 2)).reshape(3, 8)
        return sides[:, pick, np.arange(3)[:, None]].transpose(0, 2, 1).reshape(-1, 3)

    def picture(
        self, view: np.ndarray, projection: np.ndarray, size: tuple[int, int], light: Triple
    ) -> tuple[np.ndarray, np.ndarray]:
        """The robot alone, drawn in software.

        Args:
            view: World to camera, OpenGL convention, (4, 4).
            projection: Camera to clip space, (4, 4).
            size: Width and height [pixel].
            light: Direction towards the light, world frame.

        Returns:
            Colours (height, width, 3) in [0, 1] and where the robot is (height, width) bool.
        """
        width, height = size
        _, _, colours, _, bodies = pybullet.getCameraImage(
            width,
            height,
            view.T.ravel().tolist(),
            projection.T.ravel().tolist(),
            lightDirection=light,
            lightAmbientCoeff=0.62,
            lightDiffuseCoeff=0.45,
            lightSpecularCoeff=0.10,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        rgb = np.reshape(colours, (height, width, 4))[:, :, :3] / 255.0
        return rgb, np.reshape(bodies, (height, width)) == self._body
