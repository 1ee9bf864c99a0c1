# SPDX-License-Identifier: Apache-2.0
"""The simulated plant, with the role of a robot's hardware driver.

Every control period it receives a motion command and a trunk torque, holds them
while physics and the joint impedance loop run at their faster rate, and returns
the sensor readings:

    sim = Simulation(SimParams())
    state = sim.reset()
    while sim.fallen is None:
        state = sim.step(command, trunk)
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError
from loco_control.types import GroundTruth, MotionCommand, RobotState, TrunkTorque

from ..drives.actuators import Actuators
from ..drives.damping import DampedDrives
from ..drives.stability import plan
from ..effects.base import ON_TORQUES, Effect, overrides, streams, windows
from ..effects.catalogue.friction import inherent
from ..params import SimParams
from ..robot import robot as robots
from ..robot.sensors import Sensors
from ..world.world import Base, make_world
from .compiled import Compiled, ordinary
from .orders import CommandSequence
from .sensing import BROKEN, FALL, fall_reason, ground_truth, readings, robot_state
from .stepwise import Stepwise, sensor_row

log = logging.getLogger(__name__)


class Simulation:
    """Simulation of one robot with drives, sensors and the effects of an experiment.

    Attributes:
        robot: The robot simulated.
        dt: Control period [s].
        physics_dt: Physics step, sub-steps included [s].
        fallen: Reason why the robot counts as fallen, else None; retained until reset.
        rejected: Number of commands since reset that were refused because they were not finite.
    """

    def __init__(
        self,
        params: SimParams | None = None,
        effects: Sequence[Effect] = (),
        seed: int = 0,
        dt: float | None = None,
        robot: str | robots.Robot = "hyq",
        standing: np.ndarray | None = None,
    ):
        """Prepare a simulation, which begins with `reset`.

        Args:
            params: Physics and sensors; default the robot's.
            effects: Departures from the ideal plant; the order matters.
            seed: Seed of the random streams of the effects.
            dt: Control period [s], a whole multiple of the physics step; default the
                robot's.
            robot: Name, path or `Robot`.
            standing: Joint positions at the start [rad], (n,); default the robot's.

        Raises:
            ParameterError: The robot has neither drives nor springs; `dt` does not fit the
                physics rate; or damping needs more sub-steps than `params.max_substeps`.
        """
        self.robot = robot if isinstance(robot, robots.Robot) else robots.load(robot)
        params = self.robot.sim if params is None else params
        dt = 1.0 / self.robot.control_rate if dt is None else dt
        self.dt, self._params = dt, params
        self._effects, self._seed = [*effects, *inherent(self.robot)], seed
        self._standing = np.array(self.robot.standing if standing is None else standing, float)
        if not self.robot.equipped:
            raise ParameterError(
                f"robot {self.robot.name!r} has neither drives nor springs: list them in its "
                "robot.yaml"
            )
        self._steps = periods(dt, params.physics_rate)
        self._world = make_world(self.robot, params, dt / self._steps)
        self._refine()
        self.physics_dt = self._world.dt
        self._drive = Actuators(self.robot, self.physics_dt)
        self._damped: DampedDrives | None = None
        sensors, joints = self.robot.sensors, self.robot.joints
        self._sensors = sensors and Sensors(sensors, self.robot.hall, joints, dt)
        self._no_trunk = TrunkTorque(
            tick=0,
            t=0.0,
            tau=np.zeros(len(self.robot.joints)),
            wrench=np.zeros(6),
            stance=np.ones(len(self.robot.feet), dtype=bool),
        )
        # Reason why the compiled loop cannot be used; "" if it can.
        self._slow_reason = self._world.damped and "damping is solved" or ordinary(self._effects)
        if self._slow_reason and params.engine == "mujoco":
            log.info("physics steps go through Python: %s", self._slow_reason)
        self.reset()

    @property
    def robot_description(self) -> str:
        """URDF of the simulated robot, payloads included."""
        return self._world.description.text()

    def _refine(self) -> None:
        """Choose sub-steps or implicit damping (`stability.plan`)."""
        world = self._world
        self._build()
        hooks = *ON_TORQUES, "on_motor", "on_brake"
        acting = [effect for effect in self._effects if not effect.absent()]
        solve = not any(overrides(effect, hook) for effect in acting for hook in hooks)
        try:
            inertia = world.joint_inertia(self._standing)
            count, world.damped = plan(
                self.robot, self._passive_damping(), inertia, world.dt, self._params, solve
            )
        except np.linalg.LinAlgError:
            raise ParameterError(
                f"robot {self.robot.name!r} has masses and inertias too far apart for its mass "
                "matrix to be inverted; correct them in its URDF"
            ) from None
        if count > 1:
            log.info("every physics step is divided by %d: the damping gains need it", count)
        if world.damped:
            log.info("damping is solved with the physics step: it is too large to be held over one")
        self._steps *= count
        world.dt = self.dt / self._steps
        self._is_built = count == 1 and not world.damped

    def _passive_damping(self) -> np.ndarray:
        """Damping of the joints themselves [N·m·s/rad], (n,)."""
        return np.array([self._world.description.damping(j) for j in self.robot.joints])

    def _build(self) -> None:
        self._world.rebuild(self._standing, self._functions("configure"), self.robot.height)

    def _rebuild(self) -> None:
        """Rebuild the world with the changes of the effects, unless it was just built with them."""
        if not self._is_built:
            self._build()
        self._is_built, self._is_new = False, True  # nothing has moved since
        if self._world.damped:
            self._damped = DampedDrives(self._drive, self._passive_damping())

    def _functions(self, hook: str) -> list[Any]:
        return [getattr(e, hook) for e in self._effects if overrides(e, hook)]

    def reset(self, seed: int | None = None) -> RobotState:
        """Rebuild the world with the robot standing at rest, and measure at tick 0.

        Args:
            seed: New seed of the effects; None for the previous one.
        """
        self._seed = self._seed if seed is None else seed
        self._rebuild()
        return self._start(self._standing)

    def _start(
        self,
        q: np.ndarray,
        dq: np.ndarray | None = None,
        tick: int = 0,
        integral: np.ndarray | float = 0.0,
    ) -> RobotState:
        """Reset effects, drives and sensors, and measure."""
        for effect, rng in zip(self._effects, streams(self._effects, self._seed), strict=True):
            effect.reset(rng)
        self._on_measurement = windows(self._effects, "on_measurement", self.physics_dt)
        self._tick, self._step, self.rejected = tick, tick * self._steps, 0
        self.fallen: str | None = None
        if dq is None:
            self._drive.reset(q, self._step)
        else:
            self._drive.start(q, dq, self._step, integral)
        if self._sensors:
            self._sensors.reset(self._seed)
        plant = self._world, self._drive, self._effects
        compiled = self._world.handles() is not None and not self._slow_reason
        self._loop = (
            Compiled(*plant, self._steps)
            if compiled
            else Stepwise(*plant, self._damped, self._steps)
        )
        no_load = [0.0] * (len(self.robot.joints) + 3 * len(self.robot.feet))
        row = sensor_row(self._world, *self._world.joint_states(), no_load)
        return self._measure(np.array((row, row)))

    def place(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        base: Base | None = None,
        tick: int = 0,
        integral: np.ndarray | float = 0.0,
    ) -> RobotState:
        """Set an initial state, and measure.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            base: State of the base; None for that of a reset.
            tick: Number of the first tick, which determines the time windows of effects.
            integral: Torques of the integrators of the drives [N·m], (n,).
        """
        if not self._world.restore() and not self._is_new:
            self._rebuild()
        self._is_new = False
        self._world.put(q, dq, base)
        return self._start(np.array(q, dtype=float), np.array(dq, dtype=float), tick, integral)

    # ---- one control period ------------------------------------------------------

    def step(self, command: MotionCommand, trunk: TrunkTorque | None = None) -> RobotState:
        """Simulate one control period with the command held, then measure.

        Args:
            command: Joint references.
            trunk: Feed-forward torque and the legs that use stance gains; None for no
                torque and all legs in stance.

        Raises:
            DivergedError: The state is no longer finite; or the command is not, and
                `SimParams.safety` is off.
        """
        if self.robot.followers and len(command.q) == len(command.dq) == len(self.robot.joints):
            q, dq = self.robot.coupled(command.q, command.dq)
            command = MotionCommand(command.tick, command.t, q, dq)
        if not self._drive.accept(command, trunk or self._no_trunk):
            self._reject()
        self._is_new = False
        rows = self._loop.period(self._row, self._step)
        self._tick, self._step = self._tick + 1, self._step + self._steps
        return self._measure(rows)

    def follow(self, sequence: CommandSequence) -> Iterator[RobotState]:
        """Simulate a precomputed command sequence; yields the readings before each command.

        Equivalent to calls of `step`, but one compiled call if the loop is compiled: then
        readings, `true_q`, `ground_truth` and `fallen` are those of the row, energies those of
        the end. After leaving the iteration early, call `reset`.

        Args:
            sequence: Commands, a row for each control period.

        Raises:
            DivergedError: The state is no longer finite after the last yielded row.
        """
        loop = self._loop
        if isinstance(loop, Stepwise) or not all(np.isfinite(part).all() for part in sequence[:3]):
            yield from self._stepped(sequence.held())
            return
        power = self._drive.supply, self._drive.on
        q, dq = self.robot.coupled(sequence.q, sequence.dq)
        commands = sequence._replace(q=q, dq=dq).table(self.robot, self._steps, power)
        rows, done, memory_rows = loop.run(*commands, self._step)
        values, touches, verdicts = self._readings(rows)
        for k, verdict in enumerate(verdicts):
            yield self._state
            self._tick, self._step = self._tick + 1, self._step + self._steps
            if k >= done:
                raise DivergedError(f"the physics diverged by t = {self._tick * self.dt:.3f} s")
            loop.restore_memory(memory_rows, k + 1)
            self._row = rows[k + 1]
            self._sense(values[k], touches[k], verdict)

    @property
    def loop(self) -> Compiled | Stepwise:
        """The loop of the physics steps, valid until the next reset."""
        return self._loop

    def _stepped(self, inputs: CommandSequence) -> Iterator[RobotState]:
        """As `follow`, by calls of `step`."""
        for k, (q, dq, tau) in enumerate(zip(*inputs[:3], strict=True)):
            yield self._state
            if inputs.power is not None:
                self.power(*inputs.power[k])
            head = self._tick, self._tick * self.dt
            self.step(
                MotionCommand(*head, q, dq), TrunkTorque(*head, tau, np.zeros(6), inputs.stance[k])
            )

    def power(self, supply: float = 1.0, on: float = 1.0) -> None:
        """Set supply and switch of the drives until the next reset.

        Args:
            supply: Voltage of the servos / nominal voltage [-].
            on: 1, or 0 to switch all drives off.
        """
        self._drive.supply, self._drive.on = supply, on

    def limit(self, effort: np.ndarray) -> None:
        """Set the torque limits of the drives [N·m], (n,); 0 releases a joint."""
        self._drive.limit(effort)

    def _reject(self) -> None:
        t = self._tick * self.dt
        if not self._params.safety:
            raise DivergedError(f"the command at t = {t:.3f} s is not finite")
        self.rejected += 1
        log.warning("command at t = %.3f s is not finite: the last good one is kept", t)

    def _readings(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[int]]:
        """Result of `sensing.readings` for this robot."""
        fall, params = self.robot.fall, self._params
        limits = fall.height, fall.roll, fall.pitch
        gravity, n = self._world.gravity, len(self.robot.joints)
        values, touches, verdicts = readings(
            rows, n, self.dt, tuple(gravity), params.contact_threshold, limits
        )
        return values, touches, verdicts.tolist()

    def _sense(self, values: np.ndarray, touches: np.ndarray, verdict: int) -> RobotState:
        """Sensor readings at the current tick, from exact readings; also stores them."""
        t = self._tick * self.dt
        if verdict == BROKEN:
            raise DivergedError(
                f"the simulated state is not finite at t = {t:.3f} s: gains too large for the "
                "physics rate, or an effect out of proportion"
            )
        if verdict == FALL and self.fallen is None:
            self.fallen = fall_reason(values, self.robot.fall)
        self._exact, state = values, robot_state(self._tick, t, values, touches)
        if self._sensors:
            state = self._sensors.measure(state)
        for start, stop, change in self._on_measurement:
            if start <= self._step < stop:
                state = change(state)
        self._state = state
        return state

    def _measure(self, rows: np.ndarray) -> RobotState:
        """Store the second of two states (rows of `sensing.readings`), and measure it."""
        self._row = rows[1]
        values, touches, verdicts = self._readings(rows)
        return self._sense(values[0], touches[0], verdicts[0])

    # ---- not measured by sensors---------------------------------------------------

    @property
    def true_q(self) -> np.ndarray:
        """True joint positions [rad], (n,), without sensor errors."""
        return self._row[: len(self.robot.joints)].copy()

    @property
    def true_dq(self) -> np.ndarray:
        """True joint velocities [rad/s], (n,), without sensor errors."""
        n = len(self.robot.joints)
        return self._row[n : 2 * n].copy()

    def ground_truth(self) -> GroundTruth:
        """True state of the base at the current tick."""
        return ground_truth(self._tick, self._tick * self.dt, self._exact)

    def potential_energy(self) -> float:
        """Energy in gravity (0 at the world's origin), springs and gears [J].

        Energy in compliant contacts is not included.
        """
        return self._world.energy()[0] + self._drive.energy(self.true_q)[0]

    def kinetic_energy(self) -> float:
        """Energy of links and rotors in motion [J]."""
        return self._world.energy()[1] + self._drive.energy(self.true_q)[1]

    def adc(self) -> np.ndarray:
        """Last counts of the Hall sensors, (k,), in the order of the joints that have one."""
        return np.array(self._sensors.adc if self._sensors else [], dtype=int)

    def close(self) -> None:
        """Free the physics engine; calling again does nothing."""
        self._world.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def periods(dt: float, rate: float) -> int:
    """Physics steps per control period.

    Raises:
        ParameterError: The ratio is not a whole number of at least one.
    """
    steps = dt * rate
    if dt <= 0.0 or round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise ParameterError(
            f"the control period ({dt:g} s) must be a whole multiple of the physics step "
            f"({1.0 / rate:g} s)"
        )
    return round(steps)


def end_text(t: float, distance: float | None) -> str:
    """Message at the end of a run of t [s] over a distance [m]; distance None for a bench."""
    if distance is None:
        return f"{t:.1f} s simulated"
    return f"{t:.1f} s simulated, {distance:.2f} m forward, no fall"
