# SPDX-License-Identifier: Apache-2.0
"""Kinematics and dynamics of a robot as a tree of bodies: poses, weights and inertia."""

from __future__ import annotations

import numpy as np

from ..foreign.rotors import Rotors
from ..multibody import tree as trees
from ..robot.description import Description
from ..robot.equipment import GRAVITY
from ..robot.frames import origin_of
from ..robot.urdf_check import TENSOR, inertia_matrix

BASE = -1


class Body:
    """A robot as bodies, each behind one moving joint; body -1 is the base.

    Attributes:
        joints: Moving joints from the base outwards, (n,).
        above: Index of the parent of each joint, -1 for the base.
        slides: Whether each joint is prismatic, (n,) bool.
        low: Smallest position of each joint [rad or m], (n,); infinite without limits.
        high: Largest position of each joint [rad or m], (n,); infinite without limits.
        damping: Viscous damping of each joint [N·m·s/rad], (n,).
        friction: Dry friction of each joint [N·m or N], (n,).
        armature: Inertia of rotor and gear of each joint [kg·m²], (n,).
        stiffness: Stiffness of the spring of each joint [N·m/rad or N/m], (n,).
        rest: Rest position of that spring [rad or m], (n,).
        links: Names of the links of each body, by index of the body.
        mass: Mass of each body [kg], (n + 1,), the base last.
    """

    def __init__(self, description: Description, rotors: Rotors | None = None):
        """Build the tree from a description.

        Args:
            description: The robot.
            rotors: Rotors and springs of its joints, and gravity.

        Raises:
            ParameterError: The inertia behind a joint is physically impossible.
        """
        listed = tuple(description.joint_types())
        tree, order, frames = trees.build(description, listed)
        self.joints = tuple(listed[i] for i in order)
        rotors = rotors or Rotors()
        self._gravity = GRAVITY if rotors.gravity is None else rotors.gravity
        self.armature = np.array([rotors.armature.get(joint, 0.0) for joint in self.joints])
        springs = [rotors.springs.get(joint, (0.0, 0.0)) for joint in self.joints]
        self.stiffness, self.rest = np.array(springs).reshape(-1, 2).T
        n = len(self.joints)
        self.above, self.slides = tree.kin[:, 0].copy(), tree.kin[:, 1] > 0
        rows = tree.body
        self._place = rows[:, trees.PLACE : trees.PLACE + 3]
        self._turn = rows[:, trees.TURN : trees.TURN + 9].reshape(-1, 3, 3)
        self._axis = rows[:, trees.AXIS : trees.AXIS + 3]
        self.damping, self.low, self.high = (
            rows[:, trees.DAMPING],
            rows[:, trees.LOW],
            rows[:, trees.HIGH],
        )
        self.friction = np.array([description.friction(joint) for joint in self.joints])
        self._frames = frames
        x, y, z = self._axis.T
        zero = 0.0 * x
        self._cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
        self._square = self._cross @ self._cross
        self.links = {k: [] for k in range(-1, n)}
        for name, frame in frames.items():
            self.links[frame.body].append(name)
        mass, com, inertia = _base(description, frames)
        self.mass = np.append(rows[:, trees.MASS], mass)
        self._com = np.vstack([rows[:, trees.COM : trees.COM + 3].reshape(-1, 3), com])
        tensors = rows[:, trees.INERTIA : trees.INERTIA + 9].reshape(-1, 3, 3)
        self._inertia = np.concatenate([tensors, inertia[None]])
        self._path = [self._up(k) for k in range(n)]
        self._moved_by = np.zeros((n + 1, n), dtype=bool)  # body k moves with joint j; base last
        for k, path in enumerate(self._path):
            self._moved_by[k, path] = True

    def _up(self, k: int) -> list[int]:
        path = [k]
        while self.above[path[-1]] >= 0:
            path.append(int(self.above[path[-1]]))
        return path[::-1]

    def path(self, k: int) -> list[int]:
        """Joints from the base to body k, joint k last."""
        return self._path[k] if k >= 0 else []

    def frame(self, link: str) -> trees.Frame:
        """Position and rotation of a link in the frame of its body."""
        return self._frames[link]

    def leaf_bodies(self) -> list[int]:
        """Bodies without children."""
        return [k for k in range(len(self.joints)) if k not in self.above]

    def nominal(self) -> np.ndarray:
        """Nominal positions, (n,): zero, or the nearest position a tenth of the range inside."""
        span = np.where(np.isfinite(self.high - self.low), self.high - self.low, 0.0)
        low = np.where(np.isfinite(self.low), self.low, -np.inf)
        inside = (low <= 0.0) & (self.high >= 0.0)
        inner = np.clip(0.0, low + 0.1 * span, np.maximum(self.high - 0.1 * span, low + 0.1 * span))
        return np.where(inside, 0.0, inner)

    def forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation, (n + 1, 3, 3), and origin [m], (n + 1, 3), of each body in the base frame."""
        n = len(self.joints)
        turn, place = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        turn[BASE], place[BASE] = np.eye(3), 0.0
        s, c = np.sin(q)[:, None, None], 1.0 - np.cos(q)[:, None, None]
        rotation = self._turn @ (np.eye(3) + s * self._cross + c * self._square)  # Rodrigues
        for k in range(n):
            before, at = turn[self.above[k]], place[self.above[k]]
            place[k] = at + before @ self._place[k]
            if self.slides[k]:
                turn[k] = before @ self._turn[k]
                place[k] += turn[k] @ self._axis[k] * q[k]
            else:
                turn[k] = before @ rotation[k]
        return turn, place

    def axes(self, turn: np.ndarray) -> np.ndarray:
        """Direction of each joint's axis in the base frame, (n, 3); `turn` as in `forward`."""
        return np.einsum("kij,kj->ki", turn[:-1], self._axis)

    def centre(self, q: np.ndarray) -> np.ndarray:
        """Centre of mass in the base frame [m], (3,)."""
        return self.mass @ self._centres(self.forward(q)) / self.mass.sum()

    def jacobian(self, k: int, point: np.ndarray, frames: tuple) -> np.ndarray:
        """Velocity of a point of body k per joint velocity, the base at rest, (3, n).

        Args:
            k: The body.
            point: The point, in the base frame [m], (3,).
            frames: Result of `forward`.
        """
        return self._jacobians(np.array([k]), point[None], frames)[0]

    def _jacobians(self, bodies: np.ndarray, points: np.ndarray, frames: tuple) -> np.ndarray:
        """As `jacobian`, for one point on each of m bodies, (m, 3, n)."""
        turn, place = frames
        axes = self.axes(turn)
        swept = np.cross(axes, points[:, None] - place[:-1])
        moved = np.where(self.slides[:, None], axes, swept)
        return np.where(self._moved_by[bodies][:, :, None], moved, 0.0).transpose(0, 2, 1)

    def _centres(self, frames: tuple) -> np.ndarray:
        """Centre of mass of each body in the base frame [m], (n + 1, 3)."""
        turn, place = frames
        return place + np.einsum("kij,kj->ki", turn, self._com)

    def weight_torque(self, q: np.ndarray, feet: list[int], points: np.ndarray) -> np.ndarray:
        """Static torque of each joint for the robot at rest with a level base [N·m], (n,).

        It includes the torque that holds the spring of the joint.

        Vertical ground forces at `points` balance forces and moments in the sense of least
        squares; without feet the base is fixed.

        Args:
            q: Joint positions, (n,).
            feet: Bodies in ground contact, m.
            points: Points of contact in the base frame [m], (m, 3).
        """
        frames = self.forward(q)
        bodies = np.arange(len(self.joints))
        moved = self._jacobians(bodies, self._centres(frames)[:-1], frames)
        tau = self.stiffness * (q - self.rest) + self._gravity * self.mass[:-1] @ moved[:, 2]
        if len(feet):
            total, com = self.mass.sum() * self._gravity, self.centre(q)
            rows = np.vstack([np.ones(len(feet)), np.array(points)[:, :2].T])
            push = np.linalg.lstsq(rows, total * np.array([1.0, com[0], com[1]]), rcond=None)[0]
            for k, point, force in zip(feet, points, push.clip(0.0), strict=True):
                tau -= force * self.jacobian(k, np.asarray(point), frames)[2]
        return tau

    def inertia(self, q: np.ndarray, bolted: bool) -> np.ndarray:
        """Joint-space inertia [kg·m²], (n, n), with a free base unless it is bolted."""
        frames = self.forward(q)
        turn, n = frames[0], len(self.joints)
        at = self._centres(frames)
        linear, angular = np.zeros((2, n + 1, 3, 6 + n))
        linear[:, :, :3] = angular[:, :, 3:6] = np.eye(3)
        linear[:, :, 3:6] = np.cross(np.eye(3), at[:, None]).transpose(0, 2, 1)
        linear[:, :, 6:] = self._jacobians(np.arange(n + 1), at, frames)
        rotation_axes = np.where(self.slides, 0.0, self.axes(turn).T)
        angular[:, :, 6:] = np.where(self._moved_by[:, None], rotation_axes, 0.0)
        tensor = turn @ self._inertia @ turn.transpose(0, 2, 1)
        heavy = self.mass[:, None, None] * linear
        mass = np.einsum("kia,kib->ab", linear, heavy, optimize=True)
        mass += np.einsum("kia,kib->ab", angular, tensor @ angular, optimize=True)
        mass[6:, 6:] += np.diag(self.armature)
        if bolted:
            return mass[6:, 6:]
        cross = mass[6:, :6]
        return mass[6:, 6:] - cross @ np.linalg.solve(mass[:6, :6], cross.T)


def _base(description: Description, frames: dict) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia of the links fixed to the root."""
    mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for link in description.elements("link"):
        frame, inertial = frames[link.get("name")], link.find("inertial")
        if frame.body != BASE or inertial is None or inertial.find("mass") is None:
            continue
        link_mass = float(inertial.find("mass").get("value", 0.0))
        if link_mass <= 0.0:
            continue
        turn, offset = origin_of(inertial)
        at, facing = frame.place + frame.turn @ offset, frame.turn @ turn
        tensor = inertial.find("inertia")
        values = {} if tensor is None else tensor.attrib
        local = inertia_matrix([float(values.get(key, 0.0)) for key in TENSOR])
        if mass:
            mass, com, inertia = trees.add_point_mass(mass, com, inertia, link_mass, at)
        else:
            mass, com = link_mass, at
        inertia = inertia + facing @ local @ facing.T
    return mass, com, inertia
