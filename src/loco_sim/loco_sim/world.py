# SPDX-License-Identifier: Apache-2.0
"""The plant's world: how the robot moves on the ground, step by step.

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

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from . import braking
from .description import Description
from .engine import Engine, pybullet
from .geometry import Rotation, Triple, multiply, rotate, rotate_back, rotation_matrix
from .robot import joint_index


class Base(NamedTuple):
    """State of the root link's frame, in the world."""

    position: Triple  # [m]
    orientation: tuple[float, float, float, float]  # x y z w
    velocity: Triple  # of the frame's origin [m/s]
    angular_velocity: Triple  # [rad/s]


class World(Engine):
    """One robot on the ground, that is stepped and asked about."""

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
        self.hinges = {}
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
        self._hung = self._hinge_inertia(q) if self.hinges else []

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
        if self.hinges:
            tau = [*tau, *map(self._hinge_torque, self.hinges.values(), self._bent, self._hung)]
        pybullet.setJointMotorControlArray(
            self._body,
            self._read,
            pybullet.TORQUE_CONTROL,
            forces=tau,
            physicsClientId=self._client,
        )
        pybullet.stepSimulation(self._client)
        if self._frames:
            self._frames.clear()

    def _hinge_torque(self, spring: tuple[float, float], state: tuple, inertia: float) -> float:
        """Spring and damper of a hinge, implicit: stable however stiff [N·m].

        Args:
            spring: Stiffness and damping.
            state: Angle, velocity and two things of no use here.
            inertia: What the hinge feels at least [kg·m²].
        """
        (k, d), (angle, rate) = spring, state[:2]
        held = k * (angle + self.dt * rate) + d * rate
        return -held / (1.0 + self.dt * (d + self.dt * k) / inertia)

    def _hinge_inertia(self, q: Sequence[float]) -> list[float]:
        """Inertia that each hinge feels when all else is free to move [kg·m²]."""
        mass, order = self._mass_matrix(q)
        free = np.diag(np.linalg.inv(mass))
        return [1.0 / float(free[order[self._links[link]]]) for link in self.hinges]

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

    def joint_states(self) -> tuple[tuple[float, float, tuple, float], ...]:
        """Per joint: position [rad], velocity [rad/s], and two things of no use here."""
        states = pybullet.getJointStates(self._body, self._read, self._client)
        if not self.hinges:
            return states
        self._bent = states[len(self._joints) :]
        return states[: len(self._joints)]

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
        (x, y, z), matrix = self._frame(-1 if link is None else self._links[link])
        ox, oy, oz = rotate(matrix, offset)
        return x + ox, y + oy, z + oz

    def _frame(self, link: int) -> tuple[Triple, Rotation]:
        """Origin and rotation of a link's frame in the world; the same within a step."""
        if link in self._frames:
            return self._frames[link]
        if link < 0:
            com, turn = pybullet.getBasePositionAndOrientation(self._body, self._client)
            local, back = self._com, self._com_turn_back
        else:
            # The link's frame itself is given in single precision only.
            com, turn, local, (x, y, z, w) = pybullet.getLinkState(
                self._body, link, computeForwardKinematics=1, physicsClientId=self._client
            )[:4]
            back = -x, -y, -z, w
        matrix = rotation_matrix(multiply(turn, back))
        (cx, cy, cz), (lx, ly, lz) = com, rotate(matrix, local)
        self._frames[link] = (cx - lx, cy - ly, cz - lz), matrix
        return self._frames[link]

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
        """Inertia that the joints feel [kg·m²], (n, n), base and hinges free unless fixed.

        M_qq - M_qb M_bb^-1 M_bq of the joint-space mass matrix: what is left when
        the base follows without being held.
        """
        mass, order = self._mass_matrix(q)
        hinges = [self._links[link] for link in self.hinges]
        free = [*range(order[-1]), *(order[j] for j in hinges)]
        own = [order[j] for j in self._joints]
        joints, cross = mass[np.ix_(own, own)], mass[np.ix_(own, free)]
        if not free:
            return joints
        return joints - cross @ np.linalg.solve(mass[np.ix_(free, free)], cross.T)

    def _mass_matrix(self, q: Sequence[float]) -> tuple[np.ndarray, dict[int, int]]:
        """Mass matrix and the row of each moving joint; that of -1 is the first after the base."""
        position = dict(zip(self._joints, map(float, q), strict=True))
        moving = [position.get(j, 0.0) for j in self._moving]
        base = 0 if self.robot.fixed_base else 6
        rows = {j: base + k for k, j in enumerate(self._moving)}
        mass = pybullet.calculateMassMatrix(self._body, moving, physicsClientId=self._client)
        return np.array(mass), rows | {-1: base}
