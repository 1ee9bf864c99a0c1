# SPDX-License-Identifier: Apache-2.0
"""Simulation of a fixed-base robot without contacts for a command sequence known in advance.

Same results as `Simulation`, many times faster: no engine, one compiled loop. For predictions;
robots that walk, and experiments with a controller in the loop, need the engine.

    plant = Bolted(robot, effects)
    run = plant.run(q_wanted, dq_wanted)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import ParameterError

from ..drives.actuators import Actuators
from ..drives.stability import plan_passive
from ..effects.base import ON_TORQUES, Effect, overrides, span, streams
from ..effects.catalogue.friction import inherent
from ..effects.chain import Chain
from ..effects.pulls import laid_out
from ..effects.pulls import of as pulls
from ..effects.readings import Layout, Measuring
from ..effects.rows import NO_LAWS, Laws
from ..multibody import dynamics as kernels
from ..multibody import tree
from ..plant.orders import ramped
from ..plant.simulation import periods
from ..plant.timetable import behind_springs, commanding, received
from ..robot.clearance import clearance
from ..robot.description import Description
from ..robot.robot import Robot
from ..world import braking
from ..world.world import Setting
from . import kernels as loop
from . import limbs


class Run(NamedTuple):
    """Sensor readings before each command; NaN from the row where the state is not finite."""

    q: np.ndarray  # positions [rad or m], (T, n)
    dq: np.ndarray  # velocities, (T, n)
    tau: np.ndarray  # torques, mean over the previous period [N·m or N], (T, n)


class Segments(NamedTuple):
    """Sections of a run, each with its own initial state."""

    rows: np.ndarray  # first row of each piece and the row after its last, (w, 2) integers
    # Initial positions, velocities, torques of integrators, and torques that the initial motion
    # needs, (w, 4, n); without the last, or where they are NaN, hysteresis begins unloaded.
    starts: np.ndarray


class Bolted:
    """A fixed-base robot with its drives, sensors and effects.

    Attributes:
        robot: The robot simulated.
        dt: Control period [s].
        physics_dt: Physics step [s].
    """

    def __init__(
        self,
        robot: Robot,
        effects: Sequence[Effect] = (),
        seed: int = 0,
        dt: float | None = None,
    ):
        """Prepare a simulation; arguments as in `Simulation`.

        Without `dt` it is the control period, or the closest period that fits the physics.

        Raises:
            ParameterError: The robot or an effect needs the engine: see `needs_engine`; or
                `dt` does not fit the physics.
        """
        if reason := needs_engine(robot, effects):
            raise ParameterError(f"robot {robot.name!r} needs the engine: {reason}")
        self.robot, self._effects, self._seed = robot, [*effects, *inherent(robot)], seed
        rate = robot.sim.physics_rate
        self.dt = 1.0 / robot.control_rate if dt is None else dt
        if dt is None and abs(self.dt * rate - round(self.dt * rate)) > 1e-6:
            self.dt = max(1, round(self.dt * rate)) / rate
        self._steps = periods(self.dt, rate)
        self._configure()
        inertia, step = self.inertia(robot.standing), self.dt / self._steps
        count, implicit = plan_passive(robot, self._damping, inertia, step)
        if count > 1:
            self._steps *= count
            self._configure()
        self._implicit = implicit * self._damping  # [N·m·s/rad], (n,)
        if implicit:
            self._tree = tree.damped(self._tree)
        self.physics_dt = self.dt / self._steps

    def _configure(self) -> None:
        urdf, joints = self.robot.urdf, self.robot.joints
        setting = Setting(self.robot, self.robot.sim, self.dt / self._steps)
        for effect in self._effects:
            if overrides(effect, "configure"):
                effect.configure(setting)
        described = _read(setting.description, joints) if setting.described else _file(urdf, joints)
        self._tree, self._order, self._frames, self._damping = described
        if setting.armature:
            self._tree = tree.geared(self._tree, self._order, joints, setting.armature)
        self._gravity, self._pull = np.array(setting.gravity), np.array(setting.pull)
        self._limb_indices = limbs.limb_indices(self._tree.kin)

    def inertia(self, q: np.ndarray) -> np.ndarray:
        """Joint-space inertia matrix [kg·m²], (n, n), in the robot's order."""
        n = len(q)
        matrix, bias = np.zeros((n, n)), np.empty(n)
        at = np.asarray(q, dtype=float)[self._order]
        links = kernels.workshop(n)[0]
        kernels.dynamics(self._tree, self._pull, at, np.zeros(n), links, matrix, bias)
        back = np.argsort(self._order)
        return matrix[np.ix_(back, back)]

    def needed(
        self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Inverse dynamics, without damping and friction, in the robot's order.

        Args:
            q: Positions [rad or m], (T, n).
            dq: Velocities, (T, n).
            ddq: Accelerations, (T, n).

        Returns:
            Torques of the motion without weight [N·m or N], (T, n), and torques that hold the
            weight per component of gravity [N·m per m/s²], (T, n, 3).
        """
        rows, n = q.shape
        moved, held = np.empty((rows, n)), np.empty((rows, n, 3))
        links, matrix = kernels.workshop(n)[:2]
        motion = (np.ascontiguousarray(x[:, self._order], dtype=float) for x in (q, dq, ddq))
        kernels.needed(self._tree, *motion, links, matrix, moved, held)
        back = np.argsort(self._order)
        return moved[:, back], held[:, back]

    @property
    def gravity(self) -> np.ndarray:
        """Acceleration of gravity in the world, turned by effects [m/s²], (3,)."""
        return self._pull

    def run(
        self,
        q_wanted: np.ndarray,
        dq_wanted: np.ndarray | None = None,
        tau_wanted: np.ndarray | None = None,
        start: tuple[np.ndarray, np.ndarray] | None = None,
        power: np.ndarray | None = None,
        segments: Segments | None = None,
        ramps: tuple[bool, bool, bool] = (False, False, False),
        swinging: np.ndarray | None = None,
    ) -> Run:
        """Simulate a command sequence, each command held for a control period.

        Args:
            q_wanted: Desired positions of all joints [rad], (T, n).
            dq_wanted: Desired velocities [rad/s], (T, n); None for zero.
            tau_wanted: Feed-forward torques [N·m], (T, n); None for zero.
            start: Initial positions and velocities, (n,) each; None for the standing pose at rest.
            power: Supply and switch of the drives (`Simulation.power`), (T, 2); None for on.
            segments: Sections with their own initial states, in place of `start`. Time and commands
                continue, so effects start and stop as in one run; their memory is reset.
            ramps: Whether desired positions, velocities, torques are interpolated linearly from
                row to row instead of being held.
            swinging: Above 0 where the leg of a joint swings, which may change its gains,
                (T, n); None for nowhere.
        """
        rows, n = q_wanted.shape
        none = np.zeros((rows, n))
        if self.robot.followers:
            q_wanted, dq_wanted = self.robot.coupled(
                q_wanted, none if dq_wanted is None else dq_wanted
            )
        targets = [none if w is None else w for w in (q_wanted, dq_wanted, tau_wanted, swinging)]
        for effect, rng in zip(self._effects, streams(self._effects, self._seed), strict=True):
            effect.reset(rng)
        table, which = self._received(
            *ramped(np.stack(targets, axis=1).astype(float), self._steps, ramps)
        )
        change, brakes = self._chain(*ON_TORQUES), self._chain("on_brake")
        forces = laid_out(self._effects, self._frames, self.robot.height, self.physics_dt)
        if segments is None:
            q, dq = (self.robot.standing, none[0]) if start is None else start
            segments = Segments(np.array([[0, rows]]), np.array([[q, dq, none[0]]], dtype=float))
        if segments.starts.shape[1] < 4:
            unknown = np.full((len(segments.rows), 1, n), np.nan)
            segments = segments._replace(starts=np.hstack([segments.starts, unknown]))
        stop_speed = np.zeros((len(segments.rows), n))
        for row, q in enumerate(segments.starts[:, 0] if len(brakes.plan) else ()):
            inertia = self.inertia(q) + self.physics_dt * np.diag(self._implicit)
            stop_speed[row] = braking.stopped_per_torque(inertia, self.physics_dt)
        measures = [
            (*span(effect, self.physics_dt), effect)
            for effect in self._effects
            if isinstance(effect, Measuring)
            and not effect.absent()
            and not set(Run._fields).isdisjoint(effect.identity.touches)
        ]
        needs_memory = any(effect.remembers for *_, effect in measures)
        out = np.full((rows, 3, n), np.nan)
        memory_rows = np.zeros((rows if needs_memory else 0, *change.memory.shape))
        power = np.ones((rows, 2)) if power is None else np.array(power, dtype=float)
        drive = Actuators(self.robot, self.physics_dt)
        inputs = limbs.RunInputs(
            self._tree, self._order, self._pull, *segments, table, which, power, *drive.rows(),
            change, brakes, forces, stop_speed, self.robot.motor_torque, self.physics_dt,
        )  # fmt: skip
        if needs_memory or self._couples_limbs(brakes):
            loop.run(inputs, out, memory_rows)
        else:
            limbs.CACHE.run(inputs, self._limb_indices, out)
        return self._measured(out, segments.rows, measures, memory_rows)

    def _couples_limbs(self, brakes: Laws) -> bool:
        """Whether limbs are simulated together: one limb, a shared effect, or several braked.

        The sweeps of `dynamics.stop` end only when the brakes of all limbs have converged.
        """
        if len(self._limb_indices) < 2 or any(e.shared and not e.absent() for e in self._effects):
            return True
        has_brake = (np.isin(brakes.joint, self._order[limb]).any() for limb in self._limb_indices)
        return sum(has_brake) > 1

    def _chain(self, *hooks: str) -> Laws:
        """Laws of the effects that override one of the given hooks."""
        present = [e for e in self._effects if not e.absent()]
        acting = [e for e in present if any(overrides(e, hook) for hook in hooks)]
        return Chain(acting, self.physics_dt).laws() if acting else NO_LAWS

    def _received(self, targets: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Commands received by the drives, (k, COMMANDS, n), and their index at each physics step.

        The deflection of a series spring is applied in the loop.
        """
        changes, end = [], len(which)
        for first, last, change in commanding(self._effects, self.physics_dt):
            on_sequence = getattr(change.__self__, "on_sequence", None)
            if changes or not on_sequence or first > 0 or last < end:
                changes.append((first, last, change))
            else:
                targets, which = on_sequence(targets, which)
        if not changes:
            return targets, which
        motions = [(target[0], target[1]) for target in targets]
        return received(changes, motions, which, targets[:, 2:], 0, self.physics_dt)

    def _measured(
        self, out: np.ndarray, segments: np.ndarray, measures: list, log: np.ndarray
    ) -> Run:
        """Sensor readings of a simulated motion `out`, (T, 3, n)."""
        q, dq, tau = (np.ascontiguousarray(out[:, i]) for i in range(3))
        for first, stop in segments if self.robot.sensors else ():
            q[first:stop], dq[first:stop] = self._sensed(q[first:stop])
        if not measures:
            return Run(q, dq, tau)
        at = Layout(len(self._order), len(self.robot.feet))
        values = np.zeros((len(q), at.size))
        values[:, at["orientation"]] = 0.0, 0.0, 0.0, 1.0
        values[:, at["linear_acceleration"]] = -self._gravity
        for name, column in (("q", q), ("dq", dq), ("tau", tau)):
            values[:, at[name]] = column
        live = np.flatnonzero(np.all(np.isfinite(out), axis=(1, 2)))
        for first, last, effect in measures:
            samples = live[(first <= live * self._steps) & (live * self._steps < last)]
            readings, memory = values[samples], log[samples] if len(log) else log
            effect.measure_run(readings, at, samples * self.dt, memory)
            values[samples] = readings
        return Run(*(values[:, at[name]] for name in ("q", "dq", "tau")))

    def _sensed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions and velocities as measured by noise-free `Sensors`, (T, n) each."""
        sensors, q = self.robot.sensors, q.copy()
        for i, joint in enumerate(self.robot.joints):
            if joint in self.robot.hall:
                q[:, i] = self.robot.hall[joint].reached(q[:, i])
        every = max(1, round(1.0 / (sensors.rate * self.dt))) if sensors.rate > 0.0 else 1
        rows = np.arange(len(q)) // every * every
        dq = (q[rows] - q[np.maximum(rows - every, 0)]) / (every * self.dt)
        return q[rows], dq


def needs_engine(robot: Robot, effects: Sequence[Effect] = ()) -> str:
    """Reason why a robot with effects needs the engine; "" if it does not."""
    if not robot.fixed_base or not robot.equipped or robot.height is None:
        return "it has no drives in its robot.yaml, or is not bolted at a height"
    if robot.sensors and not robot.sensors.exact:
        return "its sensors round and have noise"
    acting = [effect for effect in effects if not effect.absent()]
    for effect, pull in pulls(acting):
        if pull is None:
            return f"{effect.name} acts on the world"
    if reason := behind_springs(acting):
        return reason
    return _touches(robot.urdf, robot.joints, robot.height, robot.folder)


def _read(description: Description, joints: tuple[str, ...]) -> tuple[Any, ...]:
    """Tree, order and frames of a robot (`tree.build`), and joint damping [N·m·s/rad], (n,)."""
    damping = np.array([description.damping(joint) for joint in joints])
    return *tree.build(description, joints), damping


@lru_cache(maxsize=64)
def _file(urdf: str, joints: tuple[str, ...]) -> tuple[Any, ...]:
    """Tree, order, frames and damping of an unmodified URDF; cached and therefore read-only."""
    return _read(Description(urdf), joints)


@lru_cache(maxsize=64)
def _touches(urdf: str, joints: tuple[str, ...], height: float, folder: Path) -> str:
    description = Description(urdf)
    try:
        tree.build(description, joints)
    except ParameterError as error:
        return str(error)
    low = clearance(description, height, folder)
    return "" if low > 0.0 else f"it may touch the ground ({low:.3g} m)"
