# SPDX-License-Identifier: Apache-2.0
"""Interface of the physics engines: one robot on the ground.

A `World` identifies joints, feet and links by name and order of the `Robot`; it is independent of
controllers, sensors and effects. Numbers are passed as plain lists, because for a dozen joints
that is several times faster than arrays. It is implemented by two engines, `bullet` and `mujoco`,
each imported when it is first used.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..engines import require
from ..geometry import Triple
from ..params import SimParams
from ..robot.description import Description
from ..robot.robot import Robot, joint_index
from ..terrain import Terrain
from . import hinges

MODULES = {"pybullet": ".bullet", "mujoco": ".mujoco"}  # each defines a `World`


def make_world(robot: Robot, params: SimParams, dt: float) -> World:
    """World of a robot in the engine named in `params`; empty before `World.rebuild`.

    Args:
        robot: The robot.
        params: Engine, gravity, friction and compliance of the ground.
        dt: Physics step [s].

    Raises:
        ParameterError: The engine is not installed, or crashes on a mesh of the robot.
    """
    require(params.engine)
    if "<mesh" in robot.urdf:
        importlib.import_module(".mesh_trial", __package__).check(robot, params.engine)
    return importlib.import_module(MODULES[params.engine], __package__).World(robot, params, dt)


class Base(NamedTuple):
    """State of the root link's frame, in the world."""

    position: Triple  # origin of the frame [m]
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)  # x y z w
    velocity: Triple = (0.0, 0.0, 0.0)  # velocity of the origin [m/s]
    angular_velocity: Triple = (0.0, 0.0, 0.0)  # [rad/s]


class Handles(NamedTuple):
    """Views of an engine's state, and addresses of its C functions, for compiled loops.

    Dimensions: v velocities, b links, g shapes, n joints, m feet, h sprung hinges.
    """

    step: int  # address of the function that advances model and data by one step
    look: int  # address of the function that computes the frames of all links
    model: int
    data: int
    q: np.ndarray  # all positions
    dq: np.ndarray  # all velocities, (v,)
    tau: np.ndarray  # torques to apply, (v,)
    held: np.ndarray  # braking torques, (v,)
    wrench: np.ndarray  # external forces and moments about the centres of mass, (b, 6)
    friction: np.ndarray  # friction of shapes in the first column, (g, 3)
    feet: np.ndarray  # ground force on each foot in the last step, (3 m,)
    place: np.ndarray  # origin of each link [m], (b, 3)
    turn: np.ndarray  # rotation matrix of each link, row by row, (b, 9)
    centre: np.ndarray  # centre of mass of each link [m], (b, 3)
    q_at: np.ndarray  # index of each joint in `q`, (n,)
    dq_at: np.ndarray  # index of each joint in `dq`, (n,)
    hinge_q_at: np.ndarray  # index of each hinge in `q`, (h,)
    hinge_dq_at: np.ndarray  # index of each hinge in `dq`, (h,)
    fixed: np.ndarray  # state of a fixed base, (13,); empty if it moves
    warned: np.ndarray  # number of steps with non-finite values, (1,)
    quiet: int  # value of `warned` without errors
    fastest: float  # limit of velocities
    mean: bool  # whether forces on feet are a mean over steps, not of the last step


class Setting:
    """Properties of the plant that effects may change before a run.

    Attributes:
        friction: Friction coefficients by link; other links have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] by link; other links have
            the world's.
        gravity: Acceleration of gravity [m/s²], (3,); rotated on a slope.
        carried: Share of the robot's weight that its drives compensate by themselves.
        terrain: Heights of the ground; None for a plane.
        armature: Inertia of rotor and gear by joint, which acts on that joint alone [kg·m²].
        hinges: Stiffness [N·m/rad] and damping [N·m·s/rad], by moved link, of additional
            hinges that are not joints of the robot.
        dt: Physics step [s].
    """

    def __init__(self, robot: Robot, params: SimParams, dt: float):
        self.robot, self.params, self.dt = robot, params, dt
        self._clear()

    def _clear(self) -> None:
        """Reset to the properties in the robot's files."""
        self._description: Description | None = None
        self.friction: dict[str, float] = dict(self.robot.friction)
        self.contact: dict[str, tuple[float, float]] = dict(self.robot.contact)
        self.gravity: Triple = (0.0, 0.0, -self.params.gravity)
        self.compensated = 0.0
        self.terrain: Terrain | None = None
        self.hinges: dict[str, tuple[float, float]] = {}
        self.armature: dict[str, float] = dict(self.robot.armature)

    @property
    def pull(self) -> Triple:
        """Effective gravity, reduced by the share that drives compensate [m/s²], (3,)."""
        if not self.compensated:
            return self.gravity
        x, y, z = ((1.0 - self.compensated) * part for part in self.gravity)
        return x, y, z

    @property
    def description(self) -> Description:
        """Editable URDF, created at first use.

        Raises:
            ParameterError: The text is not XML or not a robot.
        """
        if self._description is None:
            self._description = Description(self.robot.urdf)
        return self._description

    @property
    def described(self) -> bool:
        """Whether `description` was used, so that the URDF may have been changed."""
        return self._description is not None

    def joint_index(self, pattern: str) -> np.ndarray:
        """Indices of the robot's joints that match a name or fnmatch pattern.

        Raises:
            NameUnknownError: No joint matches.
        """
        return joint_index(self.robot.joints, pattern)

    def softness(self, link: str) -> tuple[float, float]:
        """Initial contact stiffness [N/m], 0 for rigid, and damping [N·s/m] of a link."""
        default = self.params.contact_stiffness, self.params.contact_damping
        return self.contact.get(link, default)


MassMatrix = tuple[np.ndarray, list[int], list[int], list[int]]


class World(Setting, ABC):
    """Simulated world with one robot on the ground.

    Attributes:
        damped: Whether joint damping is omitted from the engine's model, since every step is a
            `damped_step`; takes effect at the next `rebuild`.
    """

    def __init__(self, robot: Robot, params: SimParams, dt: float):
        super().__init__(robot, params, dt)
        self.damped = False
        self._heights: dict[tuple, float] = {}  # of bases on their feet, by URDF and pose

    def rebuild(
        self,
        q: Sequence[float],
        configure: Iterable[Callable[[World], None]] = (),
        height: float | None = None,
    ) -> None:
        """Rebuild the world, with the robot at rest.

        Args:
            q: Joint positions [rad], (n,).
            configure: Functions called with this world before the robot is loaded, which may edit
                `description`, `friction`, `contact`, `gravity`, `terrain`, `hinges` and
                `armature`.
            height: Height of the base [m]; None to put the lowest foot on the ground.

        Raises:
            ParameterError: The engine cannot build such a robot.
        """
        self._clear()
        for function in configure:
            function(self)
        self._urdf = self._text()
        on_feet = self._heights.get((self._urdf, *q))
        self._load((on_feet or 0.0) if height is None else height)
        self._place(q)
        if height is None and self.robot.feet and on_feet is None:
            on_feet = self.base().position[2] - self._lowest_foot()
            self._heights[self._urdf, *q] = on_feet
            self._raise(on_feet)
            self._place(q)
        if self.hinges:
            mass, _, _, hinge_rows = self._mass_matrix(q)
            self._hinged = hinges.inertia(mass, hinge_rows)

    def _raise(self, height: float) -> None:
        """Change the height of the base right after `_load` [m]."""
        self._load(height)

    def restore(self) -> bool:
        """Restore the state that the last `rebuild` left; False if the engine cannot."""
        return False

    def joint_inertia(self, q: Sequence[float]) -> np.ndarray:
        """Effective inertia at the joints [kg·m²], (n, n), with free hinges and, if movable, base.

        M_qq - M_qb M_bb^-1 M_bq of the joint-space mass matrix, for a base that moves
        freely.

        Args:
            q: Joint positions [rad], (n,).
        """
        mass, joint_rows, base, hinge_rows = self._mass_matrix(q)
        return hinges.felt(mass, joint_rows, [*base, *hinge_rows])

    def _engine_description(self) -> Description:
        """The robot description for the engine."""
        return self.description

    def _text(self) -> str:
        """URDF for the engine."""
        if not self.damped:
            return self._engine_description().text(self.robot.folder, drawn=False)
        undamped = Description(self._engine_description().text())
        for joint in self.robot.joints:
            undamped.set_damping(joint, 0.0)
        return undamped.text(self.robot.folder, drawn=False)

    def close(self) -> None:  # noqa: B027  (an engine may have nothing to free)
        """Release the engine's resources; calling again does nothing."""

    def sprung(self) -> list[tuple[tuple[float, float], float]]:
        """Stiffness and damping of each hinge, and its effective inertia [kg·m²]."""
        return list(zip(self.hinges.values(), self._hinged, strict=True)) if self.hinges else []

    def handles(self) -> Handles | None:
        """State and functions for a compiled loop; None if the engine does not support it."""
        return None

    def frames(self) -> dict[str | None, tuple[int, np.ndarray, np.ndarray]]:
        """Index in `handles`, position and rotation of each link's frame; None is the root link."""
        return {}

    def shapes(self, link: str) -> list[int]:
        """Indices in `handles` of the shapes of a link."""
        return []

    def moved(self) -> None:  # noqa: B027  (an engine may remember nothing)
        """Notification that a compiled loop has changed the state."""

    # ---- implemented by engines--------------------------------------------------

    @abstractmethod
    def put(self, q: Sequence[float], dq: Sequence[float], base: Base | None = None) -> None:
        """Set the state of the robot.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            base: State of the base; None to leave it unchanged.
        """

    @abstractmethod
    def step(self, tau: Sequence[float]) -> None:
        """Apply joint torques [N·m], (n,), and advance one physics step."""

    @abstractmethod
    def damped_step(self, tau: Sequence[float], law: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance one physics step with torques that depend on the speed v after it.

        The torque on a joint is tau + clip(wanted - gain v, +-limit) - passive v. It is
        solved implicitly together with contacts, which is stable for any gain and passive.

        Args:
            tau: Torques held over the step [N·m], (n,).
            law: Rows wanted [N·m], gain [N·m·s/rad], limit [N·m] and passive [N·m·s/rad],
                (4, n).

        Returns:
            Applied torques of the second term [N·m], and the speeds v used for damping
            [rad/s], (n,) each.
        """

    @abstractmethod
    def brake(self, budget: np.ndarray, dq: np.ndarray) -> None:
        """Brake each joint by up to this torque from now on, in addition to the torque of `step`.

        Args:
            budget: Largest braking torque [N·m], (n,), >= 0.
            dq: Joint velocities [rad/s], (n,).
        """

    @abstractmethod
    def push(
        self,
        force: Sequence[float],
        link: str | None = None,
        point: Sequence[float] = (0.0, 0.0, 0.0),
        at: Triple | None = None,
    ) -> None:
        """Apply a force for the next step.

        Args:
            force: Force in the world frame [N], (3,).
            link: Name of the link; None for the root link.
            point: Point of application, in the frame of the link [m].
            at: The same point in the world frame [m], if already known.
        """

    @abstractmethod
    def set_friction(self, link: str, friction: float) -> None:
        """Set the friction coefficient of a link from now on."""

    @abstractmethod
    def set_softness(self, link: str, stiffness: float, damping: float) -> None:
        """Set the contact compliance of a link from now on.

        Args:
            link: Name of the link.
            stiffness: Stiffness [N/m]; 0 for rigid.
            damping: Damping [N·s/m].
        """

    @abstractmethod
    def joint_states(self) -> tuple[Sequence[float], Sequence[float]]:
        """Joint positions [rad] and velocities [rad/s], (n,) each."""

    @abstractmethod
    def add_ground_forces(self, total: list[float]) -> None:
        """Add the ground force on each foot in the last step [N], world frame, to `total`.

        Args:
            total: x y z of each foot in turn, (3 m,); changed in place.
        """

    @abstractmethod
    def base(self) -> Base:
        """State of the root link's frame (its origin, not its centre of mass)."""

    @abstractmethod
    def place(self, link: str | None, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Triple:
        """Position in the world of a point fixed to a link [m].

        Args:
            link: Name of the link; None for the root link.
            offset: The point, in the frame of the link [m].
        """

    @abstractmethod
    def energy(self) -> tuple[float, float]:
        """Potential energy in gravity (0 at the world's origin) and kinetic energy [J]."""

    @abstractmethod
    def _load(self, height: float) -> None:
        """Load ground and robot, its base at a height [m]."""

    @abstractmethod
    def _place(self, q: Sequence[float]) -> None:
        """Set the joint positions, at rest."""

    @abstractmethod
    def _lowest_foot(self) -> float:
        """Height of the lowest foot's underside [m]."""

    @abstractmethod
    def _mass_matrix(self, q: Sequence[float]) -> MassMatrix:
        """Joint-space mass matrix, and the row indices of joints, base and hinges."""
