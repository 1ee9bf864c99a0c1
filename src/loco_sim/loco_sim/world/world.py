# SPDX-License-Identifier: Apache-2.0
"""The face of a physics engine: one robot on flat ground, stepped and asked about.

A `World` speaks in joints, feet and links by name and order of the `Robot`; it knows nothing
of controllers, sensors or effects. Numbers go in and out as plain lists, because for a dozen
joints that is several times faster than arrays. Two engines stand behind it: `bullet` and
`mujoco`, each imported when a world of it is made.
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
from . import hinges
from .terrain import Terrain

MODULES = {"pybullet": ".bullet", "mujoco": ".mujoco"}  # each has a `World`


def make_world(robot: Robot, params: SimParams, dt: float) -> World:
    """World of a robot in the engine that `params` name; empty before `World.rebuild`.

    Args:
        robot: The robot.
        params: Engine, gravity, friction and softness of the ground.
        dt: Physics step [s].

    Raises:
        ParameterError: The engine is not installed, or does not survive a mesh of the robot.
    """
    require(params.engine)
    if "<mesh" in robot.urdf:
        importlib.import_module("..meshes.trial", __package__).check(robot, params.engine)
    return importlib.import_module(MODULES[params.engine], __package__).World(robot, params, dt)


class Base(NamedTuple):
    """State of the root link's frame, in the world."""

    position: Triple  # [m]
    orientation: tuple[float, float, float, float]  # x y z w
    velocity: Triple  # of the frame's origin [m/s]
    angular_velocity: Triple  # [rad/s]


class Handles(NamedTuple):
    """An engine's state in place, and its C functions, for a compiled loop that steps it.

    Of v velocities, b links and g shapes, with n joints of the robot and h sprung hinges.
    """

    step: int  # address of the function that takes model and data one step on
    look: int  # of the one that finds the frames of all links
    model: int
    data: int
    q: np.ndarray  # all positions
    dq: np.ndarray  # all velocities, (v,)
    tau: np.ndarray  # torques to be applied, (v,)
    held: np.ndarray  # stopping torques, (v,)
    wrench: np.ndarray  # forces and moments from outside about the centres of mass, (b, 6)
    friction: np.ndarray  # of shapes, in the first column, (g, 3)
    feet: np.ndarray  # force of the ground on each foot in the last step, (3 m,)
    place: np.ndarray  # origin of each link [m], (b, 3)
    turn: np.ndarray  # rotation of each link, by rows, (b, 9)
    centre: np.ndarray  # centre of mass of each link [m], (b, 3)
    q_at: np.ndarray  # place of each joint among the positions, (n,)
    dq_at: np.ndarray  # and among the velocities, (n,)
    hinge_q_at: np.ndarray  # the same of the hinges, (h,)
    hinge_dq_at: np.ndarray  # (h,)
    fixed: np.ndarray  # state of a base that is fixed, (13,); empty if it moves
    warned: np.ndarray  # count of steps that were not finite, (1,)
    quiet: int  # that count while all is well
    fastest: float  # velocities are clipped at this
    mean: bool  # forces on feet are a mean over steps, not those of the last


class Setting:
    """The plant that effects may change before a run.

    Attributes:
        friction: Friction of single links; others have the world's.
        contact: Contact stiffness [N/m] and damping [N·s/m] of single links; others
            have the world's.
        gravity: Acceleration of gravity [m/s²], (3,); a slope is gravity turned.
        carried: Share of the robot's weight that its drives carry by themselves.
        terrain: Heights of the ground; None is a plane.
        armature: Inertia of rotor and gear [kg·m²] that a joint feels, and none before it.
        hinges: Stiffness [N·m/rad] and damping [N·m·s/rad] of the joint that moves a
            link, where that joint is not one of the robot's.
        dt: Physics step [s].
    """

    def __init__(self, robot: Robot, params: SimParams, dt: float):
        self.robot, self.params, self.dt = robot, params, dt
        self._clear()

    def _clear(self) -> None:
        """The plant as the robot's files have it, before effects change it."""
        self._description: Description | None = None
        self.friction: dict[str, float] = dict(self.robot.friction)
        self.contact: dict[str, tuple[float, float]] = dict(self.robot.contact)
        self.gravity: Triple = (0.0, 0.0, -self.params.gravity)
        self.carried = 0.0
        self.terrain: Terrain | None = None
        self.hinges: dict[str, tuple[float, float]] = {}
        self.armature: dict[str, float] = {}

    @property
    def pull(self) -> Triple:
        """Acceleration with which weight pulls on what drives do not carry [m/s²], (3,)."""
        if not self.carried:
            return self.gravity
        x, y, z = ((1.0 - self.carried) * part for part in self.gravity)
        return x, y, z

    @property
    def description(self) -> Description:
        """The URDF; read when somebody asks for it, and from then on perhaps changed.

        Raises:
            ParameterError: The text is not XML or not a robot.
        """
        if self._description is None:
            self._description = Description(self.robot.urdf)
        return self._description

    @property
    def described(self) -> bool:
        """Whether somebody asked for the URDF, so that it may be changed."""
        return self._description is not None

    def joint_index(self, pattern: str) -> np.ndarray:
        """Indices of the robot's joints that a name or fnmatch pattern names.

        Raises:
            NameUnknownError: The name is of no joint.
        """
        return joint_index(self.robot.joints, pattern)

    def softness(self, link: str) -> tuple[float, float]:
        """Contact stiffness [N/m], 0 for rigid, and damping [N·s/m] of a link as it was built."""
        default = self.params.contact_stiffness, self.params.contact_damping
        return self.contact.get(link, default)


class World(Setting, ABC):
    """One robot on the ground, that is stepped and asked about.

    Attributes:
        damped: The engine is given no damping of the robot's joints, since every step is a
            `damped_step`; counts from the next `rebuild` on.
    """

    def __init__(self, robot: Robot, params: SimParams, dt: float):
        super().__init__(robot, params, dt)
        self.damped = False

    def rebuild(
        self,
        q: Sequence[float],
        configure: Iterable[Callable[[World], None]] = (),
        height: float | None = None,
    ) -> None:
        """Build the world anew, with the robot at rest.

        Args:
            q: Joint positions [rad], (n,).
            configure: Functions that get this world before the robot is loaded and may edit
                `description`, `friction`, `contact`, `gravity`, `terrain`, `hinges` and
                `armature`.
            height: Height of the base [m]; None puts the lowest foot on the ground.

        Raises:
            ParameterError: The engine cannot build such a robot.
        """
        self._clear()
        for function in configure:
            function(self)
        self._load(0.0 if height is None else height)
        self._place(q)
        if height is None and self.robot.feet:
            self._raise(self.base().position[2] - self._lowest_foot())
            self._place(q)
        if self.hinges:
            mass, _, _, bent = self._mass_matrix(q)
            self._hung = hinges.inertia(mass, bent)

    def _raise(self, height: float) -> None:
        """Put the base at another height right after `_load` [m]."""
        self._load(height)

    def forget(self) -> bool:
        """Be as `rebuild` left it; False where only building anew does that."""
        return False

    def joint_inertia(self, q: Sequence[float]) -> np.ndarray:
        """Inertia that the joints feel [kg·m²], (n, n), base and hinges free unless fixed.

        M_qq - M_qb M_bb^-1 M_bq of the joint-space mass matrix: what is left when
        the base follows without being held.

        Args:
            q: Joint positions [rad], (n,).
        """
        mass, own, base, bent = self._mass_matrix(q)
        return hinges.felt(mass, own, [*base, *bent])

    def _given(self) -> Description:
        """The robot as the engine is given it."""
        return self.description

    def _text(self) -> str:
        """URDF for the engine."""
        if not self.damped:
            return self._given().text(self.robot.folder, drawn=False)
        undamped = Description(self._given().text())
        for joint in self.robot.joints:
            undamped.set_damping(joint, 0.0)
        return undamped.text(self.robot.folder, drawn=False)

    def close(self) -> None:  # noqa: B027  (an engine may have nothing to free)
        """Free what the engine holds; calling again does nothing."""

    def sprung(self) -> list[tuple[tuple[float, float], float]]:
        """Stiffness and damping of each hinge, and the inertia that it feels [kg·m²]."""
        return list(zip(self.hinges.values(), self._hung, strict=True)) if self.hinges else []

    def handles(self) -> Handles | None:
        """State and functions for a compiled loop; None if the engine cannot be stepped by one."""
        return None

    def frames(self) -> dict[str | None, tuple[int, np.ndarray, np.ndarray]]:
        """Frame of each link in itself, with its number in `handles`; None is the root link."""
        return {}

    def shapes(self, link: str) -> list[int]:
        """Numbers in `handles` of the shapes of a link."""
        return []

    def moved(self) -> None:  # noqa: B027  (an engine may remember nothing)
        """Hear that a compiled loop has moved the state."""

    # ---- what an engine does -----------------------------------------------------

    @abstractmethod
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
            position: Position of the base frame [m]; None leaves the base where it is.
            orientation: Orientation of the base, x y z w.
            velocity: Velocity of the base frame's origin, in world [m/s].
            spin: Angular velocity of the base, in world [rad/s].
        """

    @abstractmethod
    def step(self, tau: Sequence[float]) -> None:
        """Apply joint torques [N·m], (n,), and advance one physics step."""

    @abstractmethod
    def damped_step(self, tau: Sequence[float], law: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Advance one physics step with torques that depend on the speed v after it.

        The torque on a joint is tau + clip(wanted - gain v, +-limit) - passive v, however
        large gain and passive are: it is solved together with contacts, and takes energy only.

        Args:
            tau: Torques that are held over the step [N·m], (n,).
            law: Rows wanted [N·m], gain [N·m·s/rad], limit [N·m] and passive [N·m·s/rad],
                (4, n).

        Returns:
            Torques of the second term that acted [N·m], and the speeds that damping was taken
            at [rad/s], (n,) each.
        """

    @abstractmethod
    def brake(self, budget: np.ndarray, dq: np.ndarray) -> None:
        """Let each joint be stopped by up to this torque from now on, beside that of `step`.

        Args:
            budget: Largest stopping torque [N·m], (n,), >= 0.
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
            link: Name of the link; None is the root link.
            point: Point where it acts, in the frame of the link [m].
            at: The same point in world [m], when it is known.
        """

    @abstractmethod
    def set_friction(self, link: str, friction: float) -> None:
        """Change the friction of a link from now on."""

    @abstractmethod
    def set_softness(self, link: str, stiffness: float, damping: float) -> None:
        """Change how contacts of a link give way from now on.

        Args:
            link: Name of the link.
            stiffness: Stiffness [N/m]; 0 is rigid.
            damping: Damping [N·s/m].
        """

    @abstractmethod
    def joint_states(self) -> tuple[Sequence[float], Sequence[float]]:
        """Joint positions [rad] and velocities [rad/s], (n,) each."""

    @abstractmethod
    def add_ground_forces(self, total: list[float]) -> None:
        """Add the last step's force of the ground on each foot [N], world frame.

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
            link: Name of the link; None is the root link.
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
        """Put the joints somewhere, at rest."""

    @abstractmethod
    def _lowest_foot(self) -> float:
        """Height of the lowest foot's underside [m]."""

    @abstractmethod
    def _mass_matrix(
        self, q: Sequence[float]
    ) -> tuple[np.ndarray, list[int], list[int], list[int]]:
        """Joint-space mass matrix, and its rows of joints, base and hinges."""
