# SPDX-License-Identifier: Apache-2.0
"""The error of a body: the difference between a recording and the model's replay of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import LocoError, ParameterError
from loco_sim.plant.joint_commands import JointCommands
from loco_sim.plant.model import Model
from loco_sim.plant.orders import CommandSequence
from loco_sim.plant.simulation import Simulation
from loco_sim.robot.robot import Robot

from . import mawe, segments
from .parameters import SETS, parameter_set
from .params import CalibrationParams
from .recording import Commands, Recording, compared

REST = 0.2  # shortest settling time of a model [periods]


@dataclass(frozen=True)
class Evaluation:
    """Comparison of one body with a recording.

    Attributes:
        error: Windowed error by the name of the loss.
        lag: Delay of the robot behind the model [s].
        robot: Periods of the robot.
        model: Periods of the model.
        fall: Reason why the model fell; empty if it did not.
    """

    error: dict[str, float]
    lag: float
    robot: segments.Segments
    model: segments.Segments
    fall: str


class Reference:
    """A recording divided into periods, with which models are compared.

    Attributes:
        joints: Names of the compared joints, columns of the signals.
        robot: Periods of the robot.

    Raises:
        ParameterError: The recording does not fit the robot, or has too few periods.
    """

    def __init__(self, recording: Recording, base: Model, options: CalibrationParams):
        robot = base.make_robot()
        self.base, self.options, self.name = base, options, recording.name
        self.joints = compared(robot)
        commands, sensors = recording.commands_of(robot), recording.sensors_of(robot)
        command = commands.q
        used = recording.t >= recording.t[0] + options.skip
        if not used.any():
            raise ParameterError(
                f"{recording.name} lasts {recording.t[-1] - recording.t[0]:.1f} s, and its first "
                f"{options.skip:g} s are not used, since the robot settles there: record longer"
            )
        min_periods = max(2, options.periods)
        moving = segments.leading(command[used])
        at = segments.crossings(recording.t[used], command[used, moving], min_periods)
        self.robot = segments.cut(recording.t[used], sensors[used], at)
        self._at = at[: (options.periods or len(at)) + 1]
        posture = robot.standing[robot.driven]
        start = _start(recording.t, np.abs(command - posture).max(axis=1), self, options.settle)
        end = self._at[-1] + 2.0 * recording.dt
        inside = (recording.t >= start) & (recording.t <= end)
        self._commands = commands.part(inside)

    @property
    def first(self) -> float:
        """Start of the first compared period [s]."""
        return float(self._at[0])

    @property
    def simulated(self) -> float:
        """Length of one replay [s]."""
        return float(self._commands.t[-1] - self._commands.t[0])

    def compare(self, model: Model) -> Evaluation:
        """Replay the recorded commands on a model and compare the sensors.

        Raises:
            ParameterError: The body cannot be built.
            DivergedError: The simulation diverged.
        """
        done = replay(model, self._commands, self.options.seed)
        cut = segments.cut(done.t, done.q, self._at)
        errors, lag = {}, 0.0
        for name, loss in mawe.LOSSES.items():
            error, shift = loss(self.robot.mean, cut.mean, cut.period, self.options.window)
            errors[name] = error
            lag = shift if name == self.options.loss else lag
        return Evaluation(errors, lag, self.robot, cut, done.fall)

    def with_body(self, values: Mapping[str, float]) -> Model:
        """Base model with the values of the calibrated parameters."""
        changes = parameter_set(self.options.parameters).overrides(values)
        return Model(self.base.robot, {**self.base.overrides, **changes}, self.base.effects)

    def check(self) -> None:
        """Build the base model with the default body.

        Raises:
            ParameterError: The parameters belong to another robot.
        """
        name = self.options.parameters
        try:
            self.with_body(parameter_set(name).default).make_robot()
        except LocoError as error:
            alternatives = ", ".join(key for key in SETS if key != name)
            raise ParameterError(
                f"the parameters {name!r} do not fit robot {self.base.robot!r} ({error}); choose "
                f"others with --parameters: {alternatives}"
            ) from None

    def evaluate(self, values: Mapping[str, float]) -> Evaluation:
        """Compare the base model with the values of the calibrated parameters."""
        return self.compare(self.with_body(values))


def _start(t: np.ndarray, jump: np.ndarray, reference: Reference, settle: float) -> float:
    """Start time of a replay [s]: up to `settle` periods before the first compared one.

    Within the first of these periods it is the time at which the command is closest to the
    standing pose, so that the model settles quickly and without a jump.

    Args:
        t: Times of the recording [s], (T,).
        jump: Largest distance of the commands from the standing pose [rad], (T,).
        reference: Reference with its borders and robot.
        settle: Largest settling time [periods].
    """
    first, period = reference.first, reference.robot.period
    earliest = first - settle * period
    latest = min(earliest + period, first - REST * period)
    rows = np.flatnonzero((t >= earliest) & (t <= latest))
    if earliest <= t[0] or not len(rows):
        return max(float(t[0]), earliest - 1e-9)
    return float(t[rows[np.argmin(jump[rows])]])


@dataclass(frozen=True)
class Replay:
    """The motion of a model.

    Attributes:
        t: Times on the recording's clock [s], (T,).
        q: Angles of the compared joints [rad], (T, J).
        fall: Reason why the model counts as fallen; empty if it does not.
        distance: Displacement of the base along x [m].
    """

    t: np.ndarray
    q: np.ndarray
    fall: str
    distance: float


def replay(model: Model, commands: Commands, seed: int = 0) -> Replay:
    """Simulate a model from standing with recorded commands.

    A fall does not end the replay, since the sensors of a fallen model show that it is wrong.

    Args:
        model: Robot, overrides and effects.
        commands: Commands of the driven joints.
        seed: Seed of the effects.

    Raises:
        ParameterError: The body cannot be built, or the rate does not fit the physics.
        DivergedError: The simulation diverged.
    """
    robot, t = model.make_robot(), commands.t
    dt = 1.0 / round(1.0 / float(t[1] - t[0]), 3)  # time stamps are rounded, rates are not
    command_arrays = _make_commands(robot, commands)
    listened = [robot.joints.index(j) for j in compared(robot)]
    q = np.empty((len(t), len(listened)))
    with Simulation(None, model.make_effects(), seed, dt, robot) as sim:
        for row, state in enumerate(sim.follow(command_arrays)):
            q[row] = state.q[listened]
        return Replay(t, q, sim.fallen or "", float(sim.ground_truth().position[0]))


def _make_commands(robot: Robot, commands: Commands) -> CommandSequence:
    """Commands of all joints."""
    targets = JointCommands(robot).sequence(commands.q, commands.dq)
    if commands.torque is not None:
        targets = targets._replace(tau=np.asarray(commands.torque, dtype=float))
    if commands.stance is not None:
        targets = targets._replace(stance=np.asarray(commands.stance, dtype=bool))
    return targets
