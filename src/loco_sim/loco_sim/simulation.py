# SPDX-License-Identifier: Apache-2.0
"""The plant: what stands where a robot's hardware driver would.

Every control period it takes a motion command and a trunk torque, holds them
while physics and the joint impedance loop run at their faster rate, and gives
back what the sensors measured:

    sim = Simulation(SimParams(), ImpedanceParams())
    state = sim.reset()
    while sim.fallen is None:
        state = sim.step(command, trunk)
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError
from loco_control.impedance import ImpedanceParams
from loco_control.types import GroundTruth, MotionCommand, RobotState, TrunkTorque

from . import robot as robots
from .actuators import Actuators
from .drive import Drive, GainsOf, substeps
from .effects.base import Effect, overrides, streams, windows
from .geometry import rotation_matrix
from .params import SimParams
from .sensing import check_finite, fall_reason, ground_truth, robot_state, specific_force
from .sensors import Sensors
from .world import Base, World

log = logging.getLogger(__name__)


class Simulation:
    """One robot, its drives, its sensors and the effects that an experiment lists.

    Attributes:
        robot: The robot simulated.
        dt: Control period [s].
        physics_dt: Physics step, sub-steps included [s].
        fallen: Why the robot counts as fallen, None while it does not; stays until reset.
        rejected: Commands since reset that were not finite and so were not used.
    """

    def __init__(
        self,
        params: SimParams | None = None,
        impedance: ImpedanceParams | GainsOf | None = None,
        effects: Sequence[Effect] = (),
        seed: int = 0,
        dt: float | None = None,
        robot: str | robots.Robot = "hyq",
        standing: np.ndarray | None = None,
    ):
        """Build the world; nothing moves before `reset`.

        Args:
            params: Physics and sensors; default the robot's.
            impedance: Gains of the joint impedance, or a function from stance flags (m,)
                to kp and kd (n,) for robots with other legs than HyQ's, or none. Robots
                whose drives are in ``robot.yaml`` need none.
            effects: Departures from the ideal plant; the order matters.
            seed: Of the random streams of the effects.
            dt: Control period [s], a whole multiple of the physics step; default the
                robot's.
            robot: Name, path or `Robot`.
            standing: Joint positions at the start [rad], (n,); default the robot's.

        Raises:
            ParameterError: `dt` does not fit the physics rate, or the damping gains
                need more sub-steps than `params.max_substeps`.
        """
        self.robot = robot if isinstance(robot, robots.Robot) else robots.load(robot)
        params = self.robot.sim if params is None else params
        dt = 1.0 / self.robot.control_rate if dt is None else dt
        self.dt, self._params, self._impedance = dt, params, impedance
        self._effects, self._seed = list(effects), seed
        self._standing = np.array(self.robot.standing if standing is None else standing, float)
        if impedance is None and not self.robot.equipped:
            raise ParameterError(
                f"robot {self.robot.name!r} needs gains of a joint impedance: its robot.yaml "
                "lists no drives"
            )
        self._steps = periods(dt, params.physics_rate)
        self._world = World(self.robot, params, dt / self._steps)
        self._refine()
        self.physics_dt = self._world.dt
        if self.robot.equipped:
            self._drive = Actuators(self.robot, self.physics_dt)
        else:
            self._drive = Drive(impedance, self.robot.effort, len(self.robot.feet))
        sensors, joints = self.robot.sensors, self.robot.joints
        self._sensors = sensors and Sensors(sensors, self.robot.hall, joints, dt)
        self._no_trunk = TrunkTorque(
            tick=0,
            t=0.0,
            tau=np.zeros(len(self.robot.joints)),
            wrench=np.zeros(6),
            stance=np.ones(len(self.robot.feet), dtype=bool),
        )
        self._force_count, self._mean_grf = 3 * len(self.robot.feet), params.grf == "mean"
        self.reset()

    @property
    def robot_description(self) -> str:
        """URDF of the robot as it is simulated, payloads included."""
        return self._world.description.text()

    def _refine(self) -> None:
        """Sub-step physics until explicit damping is harmless (`drive.substeps`)."""
        world, joints = self._world, self.robot.joints
        world.rebuild(self._standing, self._functions("configure"), self.robot.height)
        inertia = world.joint_inertia(self._standing)
        damping = np.array([world.description.damping(joint) for joint in joints])
        legs, dt = len(self.robot.feet), world.dt
        gains = self.robot.damping if self.robot.equipped else self._impedance
        count = substeps(gains, inertia, damping, legs, dt, self._params)
        if count > 1:
            log.info("every physics step is divided by %d: the damping gains need it", count)
        self._steps *= count
        world.dt = self.dt / self._steps

    def _functions(self, hook: str) -> list[Any]:
        return [getattr(e, hook) for e in self._effects if overrides(e, hook)]

    def reset(self, seed: int | None = None) -> RobotState:
        """Build the world anew, the robot standing at rest, and measure at tick 0.

        Args:
            seed: New seed of the effects; None keeps the one before.
        """
        self._seed = self._seed if seed is None else seed
        self._world.rebuild(self._standing, self._functions("configure"), self.robot.height)
        return self._begin(self._standing)

    def _begin(self, q: np.ndarray, dq: np.ndarray | None = None) -> RobotState:
        """Tick 0: effects, drives and sensors forget everything; measure."""
        for effect, rng in zip(self._effects, streams(self._effects, self._seed), strict=True):
            effect.reset(rng)
        (
            self._on_command,
            self._on_motor,
            self._on_torque,
            self._on_brake,
            self._on_step,
            self._on_measurement,
        ) = (
            windows(self._effects, hook, self.physics_dt)
            for hook in (
                "on_command", "on_motor", "on_torque", "on_brake", "on_step", "on_measurement"
            )
        )  # fmt: skip
        self._affected = bool(
            self._on_command or self._on_torque or self._on_brake or self._on_step
        )
        self._tick = self._step = self.rejected = 0
        self.fallen: str | None = None
        if dq is None:
            self._drive.reset(q)
        else:
            self._drive.start(q, dq)
        if self._sensors:
            self._sensors.reset(self._seed)
        self._joints, self._base = self._world.joint_states(), self._world.base()
        no_tau, no_force = [0.0] * len(self.robot.joints), [0.0] * self._force_count
        return self._sense(no_tau, no_force, self._base.velocity)

    def place(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        base: Base | None = None,
        rebuild: bool = True,
    ) -> RobotState:
        """Start from another state than standing, and measure at tick 0.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            base: State of the base; None is that of a reset.
            rebuild: Build the world anew. Without it the world keeps what it remembers of
                contacts; a robot that touches nothing has the same future either way.

        Raises:
            ParameterError: The robot has no drives or springs in its robot.yaml.
        """
        if not self.robot.equipped:
            raise ParameterError(f"robot {self.robot.name!r} lists no drives: it starts standing")
        if rebuild:
            self._world.rebuild(self._standing, self._functions("configure"), self.robot.height)
        self._world.put(q, dq, *(base or ()))
        return self._begin(np.array(q, dtype=float), np.array(dq, dtype=float))

    # ---- one control period ------------------------------------------------------

    def step(self, command: MotionCommand, trunk: TrunkTorque | None = None) -> RobotState:
        """Run one control period with the command held, then measure.

        Args:
            command: Joint references.
            trunk: Feed-forward torque and the legs that use stance gains; None is no
                torque and all legs in stance.

        Raises:
            DivergedError: The state is no longer finite; or the command is not, and
                `SimParams.safety` is off.
        """
        if not self._drive.accept(command, trunk or self._no_trunk):
            self._reject()
        world, before = self._world, self._base.velocity
        taus, grf = [], [0.0] * self._force_count
        torque = self._affected_torque if self._affected else self._drive.torque
        for left in range(self._steps, 0, -1):
            tau = torque(self._joints)
            world.step(tau)
            taus.append(tau)
            self._joints = world.joint_states()
            self._step += 1
            if self._mean_grf or left == 1:
                world.add_ground_forces(grf)
        self._tick += 1
        if self._mean_grf:
            grf = [force / self._steps for force in grf]
        tau = [sum(steps) / self._steps for steps in zip(*taus, strict=True)]
        self._base = world.base()
        return self._sense(tau, grf, before)

    def power(self, supply: float = 1.0, on: float = 1.0) -> None:
        """Change what feeds the drives of a robot that lists drives, until the next reset.

        Args:
            supply: Voltage of the servos over the nominal one.
            on: 1, or 0 to switch all drives off.
        """
        self._drive.supply, self._drive.on = supply, on

    def _reject(self) -> None:
        t = self._tick * self.dt
        if not self._params.safety:
            raise DivergedError(f"the command at t = {t:.3f} s is not finite")
        self.rejected += 1
        log.warning("command at t = %.3f s is not finite: the last good one is kept", t)

    def _affected_torque(self, joints: tuple) -> list[float]:
        """Joint torques of this physics step with every effect that is on."""
        step, t, drive = self._step, self._step * self.physics_dt, self._drive
        if self._on_command:
            q, dq = drive.q, drive.dq
            for start, stop, change in self._on_command:
                if start <= step < stop:
                    q, dq = change(q, dq, t)
            drive.follow(q, dq)
        if self._on_motor and self.robot.equipped:
            tau = drive.torque(joints, self._motors)
        else:
            tau = drive.torque(joints)
        if self._on_torque or self._on_brake:
            tau = self._changed(tau, joints, t)
        for start, stop, act in self._on_step:
            if start <= step < stop:
                act(self._world, t)
        return tau

    def _motors(self, rows: np.ndarray, asked: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """What the motors are in this physics step, with every effect that is on."""
        step, dt = self._step, self.physics_dt
        for start, stop, change in self._on_motor:
            if start <= step < stop:
                rows = change(rows, asked, speed, dt, step * dt)
        return rows

    def _changed(self, tau: list[float], joints: tuple, t: float) -> list[float]:
        """Torques after the effects that change them; brakes the joints."""
        step, now, dt = self._step, np.array(tau), self.physics_dt
        q, dq, _, _ = zip(*joints, strict=True)
        q, dq = np.array(q), np.array(dq)
        for start, stop, change in self._on_torque:
            if start <= step < stop:
                now = change(now, q, dq, dt, t)
        if self._on_brake:
            budget = np.zeros(len(now))
            for start, stop, brake in self._on_brake:
                if start <= step < stop:
                    budget = brake(budget, now, q, dq, dt, t)
            self._world.brake(budget, dq)
        return now.tolist()

    def _sense(self, tau: list[float], grf: list[float], before: tuple) -> RobotState:
        base, t = self._base, self._tick * self.dt
        q, dq, _, _ = zip(*self._joints, strict=True)
        self._q, self._dq = q, dq
        check_finite(t, q, dq, base.position, base.velocity, tau)
        rotation = rotation_matrix(base.orientation)
        if self.fallen is None:
            self.fallen = fall_reason(base, rotation, self.robot.fall)
        force = specific_force(rotation, before, base.velocity, self.dt, self._world.gravity)
        threshold = self._params.contact_threshold
        state = robot_state(self._tick, t, (q, dq), tau, grf, base, force, rotation, threshold)
        if self._sensors:
            state = self._sensors.measure(state)
        for start, stop, change in self._on_measurement:
            if start <= self._step < stop:
                state = change(state)
        return state

    # ---- beside the sensors ------------------------------------------------------

    @property
    def true_q(self) -> np.ndarray:
        """Joint positions [rad], (n,), whatever the sensors say."""
        return np.array(self._q)

    @property
    def true_dq(self) -> np.ndarray:
        """Joint velocities [rad/s], (n,), whatever the sensors say."""
        return np.array(self._dq)

    def ground_truth(self) -> GroundTruth:
        """What only the simulator knows, at the current tick."""
        return ground_truth(self._tick, self._tick * self.dt, self._base)

    def potential_energy(self) -> float:
        """Energy in gravity (0 at the world's origin), springs and gears [J].

        What bent contacts hold is not in it.
        """
        springs = self._drive.energy(self.true_q)[0] if self.robot.equipped else 0.0
        return self._world.energy()[0] + springs

    def kinetic_energy(self) -> float:
        """Energy of links and rotors in motion [J]."""
        rotors = self._drive.energy(self.true_q)[1] if self.robot.equipped else 0.0
        return self._world.energy()[1] + rotors

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
        ParameterError: Not a whole number of at least one.
    """
    steps = dt * rate
    if dt <= 0.0 or round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise ParameterError(
            f"the control period ({dt:g} s) must be a whole multiple of the physics step "
            f"({1.0 / rate:g} s)"
        )
    return round(steps)
