# SPDX-License-Identifier: Apache-2.0
"""The physics engine behind one door: the only module that imports PyBullet.

An `Engine` builds a robot on flat ground in a PyBullet client of its own, puts it
somewhere and draws it; `world.World` steps it and asks about it.
"""

from __future__ import annotations

import ctypes
import os
import tempfile
import weakref
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .description import Description
from .geometry import Rotation, Triple, multiply, rotate, rotation_matrix
from .params import SimParams
from .robot import Robot


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

GROUND_FRICTION = 1.0  # PyBullet multiplies the two; so the robot's is the contact's


class Engine:
    """One robot on the ground, as PyBullet has it.

    Attributes:
        description: The URDF, which `configure` functions may edit.
        friction: Friction of single links; others have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] of single links; others
            have the world's.
        gravity: Acceleration of gravity [m/s²], (3,); a slope is gravity turned.
        hinges: Stiffness [N·m/rad] and damping [N·m·s/rad] of the joint that moves a
            link, where that joint is not one of the robot's.
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
        self.hinges: dict[str, tuple[float, float]] = {}
        self._frames: dict[int, tuple[Triple, Rotation]] = {}  # of links, in this step

    def close(self) -> None:
        """Free the client; calling again does nothing."""
        self._disconnect()

    # ---- building ----------------------------------------------------------------

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
        self._read = self._joints + [self._links[link] for link in self.hinges]
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
        fastest = self.description.fastest()
        if fastest > 100.0:
            pybullet.changeDynamics(body, -1, maxJointVelocity=fastest, physicsClientId=c)
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
        self._frames.clear()
        for joint, value in zip(self._joints, q, strict=True):
            pybullet.resetJointState(self._body, joint, float(value), physicsClientId=self._client)

    def put(
        self,
        q: Sequence[float],
        dq: Sequence[float],
        position: Triple | None = None,
        orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        velocity: Triple = (0.0, 0.0, 0.0),
        spin: Triple = (0.0, 0.0, 0.0),
    ) -> None:
        """Put the robot into a state.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            position: Of the base frame [m]; None leaves the base where it is.
            orientation: Of the base, x y z w.
            velocity: Of the base frame's origin, in world [m/s].
            spin: Angular velocity of the base, in world [rad/s].
        """
        if position is not None:
            self.pose(position, orientation, q)
            (ax, ay, az), (wx, wy, wz) = rotate(rotation_matrix(orientation), self._com), spin
            vx, vy, vz = velocity
            com = (vx + wy * az - wz * ay, vy + wz * ax - wx * az, vz + wx * ay - wy * ax)
            pybullet.resetBaseVelocity(self._body, com, spin, physicsClientId=self._client)
        self._frames.clear()
        for joint, angle, rate in zip(self._joints, q, dq, strict=True):
            pybullet.resetJointState(
                self._body, joint, float(angle), float(rate), physicsClientId=self._client
            )

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
