# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate --live` and `loco gap --live`: mend a model of a running robot, and record both.

The measured robot (namespace ``/measured``) and its model (``/model``) run in separate
processes with the same excitation; the calibrator listens to the first and updates the
second.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.parameter_client import AsyncParameterClient

from loco_control.exceptions import GraphError, ParameterError
from loco_control.params import Params, parameter, to_dict
from loco_control.reading import FOLDERS
from loco_control.ros.messages.calibration_topics import CALIBRATION_TOPICS, CALIBRATOR
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_learning.runs import experiment as experiments
from loco_learning.runs.experiment import Experiment
from loco_msgs.action import Calibrate, FindGap
from loco_sim.robot.robot import is_name

from ..client import GraphClient
from ..graph.run import Helper, run_robots
from ..graph.watch import Outcome
from ..graph.watch import Progress as RunProgress
from ..report.live_log import MEASURED, MODEL

FOREVER = 1e5  # simulated duration of robots that are stopped by the client [s]
RESULT = "model.yaml"
RESULT_TIMEOUT = 30.0  # wall time for a busy calibrator to publish the last gaps [s]


@dataclass(frozen=True)
class LiveParams(Params):
    """Schedule of a live calibration; times in periods of the excitation."""

    skip: float = parameter(1.5, "start of the run that is not used", "period", 0.0, 100.0)
    listen: float = parameter(5.0, "what is fitted", "period", 2.0, 1000.0)
    hold: float = parameter(2.1, "least stay of a model before the next", "period", 0.0, 100.0)
    after: int = parameter(3, "whole periods of the last model", "period", 1, 1000)
    speed: float = parameter(1.0, "at most this many times real time, 0 for no limit", "x", 0.0)


class GapRow(NamedTuple):
    """One message of the topic `gap`."""

    t: float  # [s]
    gap: float  # [rad]
    model: int
    mixed: bool


@dataclass
class LiveProgress:
    """Values displayed in the progress line."""

    phase: str = "starting"
    sim_time: float = 0.0
    generation: int = 0
    best: float = float("nan")
    eta: float = float("nan")
    share: float = 0.0  # done share of a search for a gap
    found: str = ""  # name of the best candidate of such a search so far
    gaps: list[GapRow] = field(default_factory=list)


@dataclass
class LiveOutcome:
    """Result of a live calibration.

    Attributes:
        run: Outcome of the robots' run.
        status: ``done``, ``cancelled`` or ``failed``; empty if interrupted.
        result: Result of the action; None if interrupted.
    """

    run: Outcome
    status: str = ""
    result: Any = None

    @property
    def folder(self) -> Path:
        """Folder of the bag."""
        return self.run.folder

    @property
    def exit_code(self) -> int:
        """0 if done, 1 if the calibration failed, 130 if interrupted."""
        return 130 if self.run.interrupted else 0 if self.status in ("done", "cancelled") else 1


OnProgress = Callable[[LiveProgress], Any]  # a true return value cancels the calibration


def run_live(
    kind: type[Client],
    measured: Experiment,
    robot: str,
    folder: Path,
    options: Any,
    live: LiveParams | None = None,
    on_progress: OnProgress = lambda progress: None,
) -> LiveOutcome:
    """Mend a model of a running robot, and record both in one bag.

    Args:
        kind: `Calibration` or `GapSearch`.
        measured: Experiment of the measured robot; the model gets the same excitation.
        robot: Initial model: a robot's name, robot.yaml or model.yaml.
        folder: New folder of the bag.
        options: `CalibrationParams`, or the values of `GapParams` that differ from their defaults.
        live: Schedule of the live run.
        on_progress: Called about ten times per second; a true return value cancels the action.

    Raises:
        GraphError: A node died or never got ready.
        ParameterError: The excitation has no period, or `folder` holds a bag.
    """
    live, period = live or LiveParams(), period_of(measured)
    robots = {
        MEASURED: replace(measured, duration=FOREVER),
        MODEL: model_of(measured, robot),
    }
    cls = "loco_bringup.live.calibrator:CalibratorNode"
    with kind(options, period, robot, live, on_progress) as action:
        helper = Helper("calibrator", cls, action.parameters() | folders_of(robot), "calibration")
        outcome = run_robots(
            robots, folder, speed=live.speed, on_progress=action.step, helpers=[helper],
            stop_on_fall=False,
        )  # fmt: skip
    return action.outcome(outcome)


def period_of(measured: Experiment) -> float:
    """Period of an excitation [s].

    Raises:
        ParameterError: The excitation has no frequency.
    """
    if measured.target.frequency <= 0.0:
        raise ParameterError("the excitation of a calibration needs a frequency above 0 Hz")
    return 1.0 / measured.target.frequency


def model_of(measured: Experiment, robot: str) -> Experiment:
    """Experiment of the model with the excitation of the measured robot."""
    return Experiment(
        name=f"{measured.name}_model",
        description=f"model {robot} of {measured.name}",
        robot=robot,
        seed=measured.seed,
        control_rate=measured.control_rate,
        duration=FOREVER,
        target=measured.target,
    )


def named(robot: str) -> str:
    """Robot in a goal: its name, or its absolute path, since working folders differ."""
    return robot if is_name(robot) else str(Path(robot).resolve())


def folders_of(robot: str) -> dict[str, list[str]]:
    """Parameter `folders` of the calibrator that permits goals with the robot of this run.

    Args:
        robot: Name, robot.yaml or model.yaml.
    """
    return {} if is_name(robot) else {"folders": [*FOLDERS, str(Path(robot).resolve().parent)]}


class Client(GraphClient):
    """Action client that is polled in the monitoring loop of the run.

    A subclass has `goal`, the goal without the fields that all actions have, and `on_feedback`.
    """

    ACTION: Any  # type of the action
    NAME = ""  # name of the action

    def __init__(
        self, options: Any, period: float, robot: str, live: LiveParams, on_progress: OnProgress
    ):
        super().__init__("live_calibration")
        self._options, self._period, self._robot = options, period, robot
        self._live, self._tell = live, on_progress
        self.progress = LiveProgress()
        self.status, self.result = "", None
        self._ping: Any = None
        self._pinged = 0.0
        self._sent: Any = None
        self._handle: Any = None
        self._answer: Any = None
        self._cancelled = False
        self._told, self._until = 0, float("inf")  # gaps at the end, time-out [s]
        self._patient_until = 0.0  # earliest wall time of the time-out [s]
        self._models = 0  # number of models that the model robot received
        self._client = ActionClient(self.node, self.ACTION, self.NAME)
        self._parameters = AsyncParameterClient(self.node, CALIBRATOR)  # after the client
        row = CALIBRATION_TOPICS["gap"]
        self.node.create_subscription(row.type, row.name, self._on_gap, row.qos.reader(100))
        row, name = JOINT_TOPICS["events"], f"/{MODEL}/events"
        self.node.create_subscription(row.type, name, self._on_event, row.qos.reader(100))

    def close(self) -> None:
        """Leave the graph."""
        self._client.destroy()
        super().close()

    def parameters(self) -> dict[str, Any]:
        """Parameters of the calibrator."""
        return {"listen.skip": self._live.skip * self._period}

    def step(self, run: RunProgress) -> bool:
        """Handle arrived messages; returns whether the run is over."""
        self.spin(0.01)
        self.progress.sim_time = run.sim_time
        if self._sent is None and run.sim_time > 0.0 and self._on_message():
            self._send()
        if self._handle is None and self._sent is not None and self._sent.done():
            self._accepted()
        if not self.status and self._answer is not None and self._answer.done():
            self._on_result(self._answer.result())
        if self._tell(self.progress) and self._handle is not None and not self._cancelled:
            self._cancelled = True
            self._handle.cancel_goal_async()
        return self._over()

    def _over(self) -> bool:
        """Whether the action has ended and enough gaps of the last model have been measured."""
        if self.status != "done":
            return bool(self.status)
        rows = self.progress.gaps[self._told :]
        count = sum(1 for row in rows if row.model == self._models and not row.mixed)
        late = self.progress.sim_time >= self._until and time.monotonic() >= self._patient_until
        return count >= self._live.after or late

    def _on_message(self) -> bool:
        """Whether answers of the calibrator reach this client.

        A server that has not yet discovered the client drops its answer, so the answer to a goal
        would be lost. Endpoints are discovered in the order of their creation: once a parameter
        request is answered, the older action client is known too.
        """
        if self._ping is not None and self._ping.done():
            return self._client.server_is_ready()
        if time.monotonic() - self._pinged > 1.0 and self._parameters.services_are_ready():
            self._ping = self._parameters.get_parameters(["recorded"])
            self._pinged = time.monotonic()
        return False

    def _send(self) -> None:
        self.progress.phase = "listening"
        goal = self.goal()
        goal.measured, goal.model, goal.robot = f"/{MEASURED}", f"/{MODEL}", named(self._robot)
        goal.duration = self._live.listen * self._period
        self._sent = self._client.send_goal_async(goal, lambda m: self.on_feedback(m.feedback))

    def _accepted(self) -> None:
        self._handle = self._sent.result()
        if not self._handle.accepted:
            raise GraphError("the calibrator refused the goal")
        self._answer = self._handle.get_result_async()

    def _on_gap(self, message: Any) -> None:
        t = message.stamp.sec + message.stamp.nanosec / 1e9
        self.progress.gaps.append(GapRow(t, message.gap, message.model, message.mixed))

    def _on_event(self, event: Any) -> None:
        self._models += event.kind == "model loaded"

    def _on_result(self, answer: Any) -> None:
        names = {GoalStatus.STATUS_SUCCEEDED: "done", GoalStatus.STATUS_CANCELED: "cancelled"}
        self.status, self.result = names.get(answer.status, "failed"), answer.result
        self.progress.phase = self.status
        self._told = len(self.progress.gaps)
        self._until = self.progress.sim_time + (3 * self._live.after + 5) * self._period
        self._patient_until = time.monotonic() + RESULT_TIMEOUT

    def outcome(self, run: Outcome) -> LiveOutcome:
        """Outcome of the calibration; writes the calibrated model beside the bag."""
        run.text = self.result.message if self.result else run.text
        if self.result and self.result.model_yaml:
            (run.folder / RESULT).write_text(self.result.model_yaml, encoding="utf-8")
        return LiveOutcome(run, self.status, self.result)


class Calibration(Client):
    """Client of the action ``calibrate``; its options are `CalibrationParams`."""

    ACTION, NAME = Calibrate, "calibrate"

    def parameters(self) -> dict[str, Any]:
        """Parameters of the calibrator."""
        options = {f"calibration.{k}": v for k, v in to_dict(self._options).items()}
        return super().parameters() | {"listen.hold": self._live.hold * self._period} | options

    def goal(self) -> Any:
        """Goal of the action."""
        o = self._options
        return Calibrate.Goal(
            parameter_set=o.parameters, loss=o.loss, generations=o.generations,
            evaluations=o.evaluations, population=o.population, seed=o.seed,
        )  # fmt: skip

    def on_feedback(self, feedback: Any) -> None:
        """Take the progress of the action."""
        p, f = self.progress, feedback
        p.phase, p.generation, p.best, p.eta = "fitting", f.generation, f.best, f.eta


class GapSearch(Client):
    """Client of the action ``find_gap``; its options are values of `GapParams`."""

    ACTION, NAME = FindGap, "find_gap"

    def goal(self) -> Any:
        """Goal of the action."""
        lists = {key: list(self._options.get(key, ())) for key in ("effects", "free")}
        return FindGap.Goal(seed=int(self._options.get("seed", 0)), **lists)

    def on_feedback(self, feedback: Any) -> None:
        """Take the progress of the action."""
        p = self.progress
        p.phase, p.share, p.found = feedback.stage, feedback.fraction, feedback.best


def measured_robot(name: str) -> Experiment:
    """Experiment of the surrogate for the real robot.

    Raises:
        ParameterError: The robot of the experiment is not driven by oscillators.
    """
    experiment = experiments.load(name)
    if experiment.node_set != "joint":
        raise ParameterError(
            f"{name} is an experiment of {experiment.robot} without a target of oscillators; both "
            "robots of a live run follow one"
        )
    return experiment
