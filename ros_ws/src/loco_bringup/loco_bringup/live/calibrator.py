# SPDX-License-Identifier: Apache-2.0
"""Node `calibrator`: actions ``calibrate`` and ``find_gap`` on a measured robot, or on bags.

It listens to the measured robot, fits the model in a separate process, sends each better
model to the model robot (`model`), and publishes the difference of the two once per period
(`gap`), also after the action has ended. ``find_gap`` does the same with `loco gap`: it
publishes the effect that the model lacks (`gap_search`) and sends the extended model.

It is part of this package and not of loco_learning because it reads bags.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from loco_control.exceptions import GraphError, LocoError, ParameterError
from loco_control.params import Params, parameter
from loco_control.reading import FOLDERS, allowed
from loco_control.ros.executor import entry
from loco_control.ros.messages.calibration_topics import CALIBRATION_TOPICS, CALIBRATOR
from loco_control.ros.messages.topics import to_stamp
from loco_control.ros.node import LocoNode
from loco_control.ros.parameters import declare
from loco_learning.calibration.live import GapMeter
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import compared
from loco_learning.calibration.worker import Maker, make_calibration
from loco_msgs.msg import CalibrationState, Gap, GapSearch
from loco_sim.robot.robot import Robot, is_name

from .calibration_goal import CalibrationGoal
from .gap_goal import Find, GapGoal, find
from .goal import Goal
from .robot import STATES, LiveRobot, check_namespace, robots, topic

LONGEST = 1e4  # longest simulated listening time of a goal [s]
_POLL = 0.05  # polling period, wall time [s]


@dataclass(frozen=True)
class ListenParams(Params):
    """Settings of the calibrator for listening to running robots."""

    duration: float = parameter(30.0, "simulated time to listen before fitting", "s", 0.1, LONGEST)
    skip: float = parameter(5.0, "start of a run that is not used", "s", 0.0, 1e4)
    hold: float = parameter(8.0, "simulated time that the model robot keeps a model", "s", 0.0, 1e4)
    patience: float = parameter(
        20.0, "wall time that a robot may be missing or silent", "s", 0.1, 600.0
    )


class CalibratorNode(LocoNode):
    """Two action servers; one calibration or search at a time.

    Args:
        make: Function that creates a calibration in the worker process.
        find: Function that searches for the cause of a gap in the worker process.
    """

    table = CALIBRATION_TOPICS

    def __init__(self, make: Maker = make_calibration, find: Find = find) -> None:
        super().__init__(CALIBRATOR)
        self.make, self.find = make, find
        self.listen = declare(self, ListenParams(), "listen.")
        self._folders = self.declare_parameter("folders", list(FOLDERS)).value
        self.options = declare(self, CalibrationParams(), "calibration.")
        outputs = map(self.output, ("calibration", "gap", "gap_search"))
        self._state, self._gap, self._search = outputs
        self.state, self.search = CalibrationState(phase="idle"), GapSearch(phase="idle")
        self.measured: LiveRobot | None = None
        self.model: LiveRobot | None = None
        self._meter: GapMeter | None = None
        self._awaited: Future | None = None  # done at the next check
        self._job: Goal | None = None
        # An ActionServer works in the EventsExecutor of rclpy 7.1: a goal is accepted within
        # 2 ms, a cancel request within 2 ms, also while `execute` waits for a future. Blocking
        # calls must not run in it, since the executor has one thread.
        self._servers = [
            ActionServer(
                self, kind.ACTION, kind.NAME, partial(self._run, kind),
                cancel_callback=lambda h: CancelResponse.ACCEPT,
            )
            for kind in (CalibrationGoal, GapGoal)
        ]  # fmt: skip
        self.create_timer(_POLL, self._look)
        self.announce_ready()

    # ---- the action

    async def _run(self, kind: type[Goal], handle: Any) -> Any:
        """Run a goal; the result reports its end, including an error in the goal."""
        if self._job:
            handle.abort()
            return kind.ACTION.Result(message=f"{self._job.WHAT} is running; cancel it first")
        self._job = job = kind(self, handle)
        self.state = CalibrationState(phase="listening")
        self.search = GapSearch(phase="listening")
        try:
            result = await job.run()
        except Exception as error:  # goals come from other processes: no error may end the node
            if not isinstance(error, LocoError):
                self.get_logger().error(traceback.format_exc())
            text = str(error) if isinstance(error, LocoError) else "the goal cannot be run"
            result = kind.ACTION.Result(message=text)
            job.publish("failed", text)
            handle.abort()
        else:
            cancelled = handle.is_cancel_requested
            job.publish("cancelled" if cancelled else "done", result.message)
            (handle.canceled if cancelled else handle.succeed)()
        finally:
            job.close()
            self._job = None
        return result

    def allowed(self, path: str, what: str) -> str:
        """Path in a goal, if the operator permits goals to read there.

        Args:
            path: File or folder.
            what: Kind of file, for error messages.

        Raises:
            ParameterError: The path is not below a folder in the node's parameter `folders`.
        """
        return str(allowed(path, self._folders, what))

    def robot_of(self, goal: Any) -> str:
        """Name or path of the robot or model in a goal.

        Raises:
            ParameterError: The path is not below a folder in the node's parameter `folders`.
        """
        name = goal.robot or "tigrillo"
        return name if is_name(name) else self.allowed(name, "robot")

    def duration_of(self, goal: Any) -> float:
        """Simulated listening time of a goal [s].

        Raises:
            ParameterError: The time is not in (0, 10000] s.
        """
        if goal.duration and not 0.0 < goal.duration <= LONGEST:
            raise ParameterError(f"duration must be in (0, {LONGEST:g}] s, got {goal.duration}")
        return goal.duration or self.listen.duration

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds; the goal checks it 20 times per second."""
        waiting = True
        while waiting:
            self._awaited = Future(executor=self.executor)
            await self._awaited
            waiting = not condition()

    def _look(self) -> None:
        if self._meter:
            self._measure_gap()
        if self._awaited:
            future, self._awaited = self._awaited, None
            future.set_result(None)

    def publish(self, state: Any, phase: str, text: str) -> None:
        """Publish `state` (of the calibration) or `search` (for the cause of a gap)."""
        state.phase, state.text = phase, text
        state.stamp = to_stamp(max(0.0, self.measured.signals.now) if self.measured else 0.0)
        (self._state if state is self.state else self._search).publish(state)

    # ---- the robots

    async def connect(self, measured: str, model: str, robot: Robot, span: float) -> None:
        """Subscribe to robots in namespaces; an empty namespace means no robot.

        Args:
            measured: Namespace of the measured robot.
            model: Namespace of the robot that receives the models.
            robot: Description of both robots.
            span: Simulated time for which signals are retained [s].

        Raises:
            GraphError: There is no publisher of joint states in a namespace.
            ParameterError: A name is no valid namespace.
        """
        self._disconnect()
        for namespace in filter(None, (measured, model)):
            check_namespace(namespace)
            await self._wait_for(namespace)
        if measured:
            self.measured = LiveRobot(self, measured, robot, span, self.listen.skip)
        if model:
            self.model = LiveRobot(self, model, robot, span, self.listen.skip)
        if measured and model:
            signals = self.measured.signals, self.model.signals
            rate, window = robot.control_rate, self.options.window
            self._meter = GapMeter(*signals, compared(robot), rate, window)

    async def _wait_for(self, namespace: str) -> None:
        name, deadline = topic(namespace, STATES), time.monotonic() + self.listen.patience
        await self.until(lambda: self.count_publishers(name) > 0 or time.monotonic() > deadline)
        if not self.count_publishers(name):
            namespaces = ", ".join(robots(self)) or "no namespace"
            raise GraphError(f"nobody publishes {name}; there are robots in {namespaces}")

    def _disconnect(self) -> None:
        for robot in filter(None, (self.measured, self.model)):
            robot.close()
        self.measured = self.model = self._meter = None

    def _measure_gap(self) -> None:
        gap = self._meter.update()
        if gap:
            message = Gap(stamp=to_stamp(gap.t), tick=gap.number, gap=gap.gap)
            message.model = self.model.model_at(gap.since)
            message.mixed = message.model != self.model.model_at(gap.since + gap.period)
            message.names, message.joints = list(self._meter.passive), gap.joints.tolist()
            self._gap.publish(message)

    def diagnose(self) -> dict[str, Any]:
        """Values for diagnostics: phase, generation, best loss, progress of a search."""
        s, g = self.state, self.search
        values = {"phase": s.phase, "generation": s.tick, "best": s.best}
        return values if g.phase == "idle" else {**values, "search": g.phase, "share": g.fraction}

    def close(self) -> None:
        """Stop the worker process and destroy the action servers."""
        if self._job:
            self._job.close()
        self._disconnect()
        for server in self._servers:
            server.destroy()


main = entry(CalibratorNode)  # ``ros2 run loco_bringup calibrator``

if __name__ == "__main__":
    main()
