# SPDX-License-Identifier: Apache-2.0
"""Node `calibrator`: actions ``calibrate`` and ``find_gap`` on a measured robot, or on bags.

It listens to the measured robot, fits the model in a process of its own, gives each
better model to the model robot (`model`), and says once per period how far the two
are apart (`gap`). The gap goes on being told after the action has ended. ``find_gap`` does the
same with `loco gap`: it names what the model lacks (`gap_search`) and hands that model on.

It stands here and not in loco_learning because it reads bags.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from loco_control.exceptions import GraphError, LocoError
from loco_control.params import Params, parameter
from loco_control.ros.calibration_topics import CALIBRATION_TOPICS, CALIBRATOR
from loco_control.ros.node import LocoNode
from loco_control.ros.parameters import declare
from loco_control.ros.spin import run_nodes
from loco_control.ros.topics import to_stamp
from loco_learning.calibration.live import GapMeter
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import passive
from loco_learning.calibration.worker import Maker, make_calibration
from loco_msgs.action import Calibrate, FindGap
from loco_msgs.msg import CalibrationState, Gap, GapSearch
from loco_sim.robot import Robot

from .calibrator_job import Job
from .gap_job import Find, GapSearchJob, find
from .live_robot import STATES, LiveRobot, robots, topic

_POLL = 0.05  # wall time between two looks at what has changed [s]


@dataclass(frozen=True)
class ListenParams(Params):
    """How the calibrator listens to robots that run."""

    duration: float = parameter(30.0, "simulated time to listen before fitting", "s", 0.1, 1e4)
    skip: float = parameter(5.0, "start of a run that is not used", "s", 0.0, 1e4)
    hold: float = parameter(8.0, "simulated time that the model robot keeps a model", "s", 0.0, 1e4)
    patience: float = parameter(
        5.0, "wall time that a robot may be missing or silent", "s", 0.1, 600.0
    )


class CalibratorNode(LocoNode):
    """Two action servers; one calibration or search at a time.

    Args:
        make: Makes a calibration in the worker process.
        find: Searches for the cause of a gap in the worker process.
    """

    table = CALIBRATION_TOPICS

    def __init__(self, make: Maker = make_calibration, find: Find = find) -> None:
        super().__init__(CALIBRATOR)
        self.make, self.find = make, find
        self.listen = declare(self, ListenParams(), "listen.")
        self.options = declare(self, CalibrationParams(), "calibration.")
        self._state, self._gap = self.output("calibration"), self.output("gap")
        self._search = self.output("gap_search")
        self.state, self.search = CalibrationState(phase="idle"), GapSearch(phase="idle")
        self.measured: LiveRobot | None = None
        self.model: LiveRobot | None = None
        self._meter: GapMeter | None = None
        self._awaited: tuple[Callable[[], bool], Future] | None = None
        self._job: Job | GapSearchJob | None = None
        # An ActionServer works in the EventsExecutor of rclpy 7.1: a goal is accepted 2 ms
        # after it was sent, a cancel 2 ms, also while `execute` waits for a future. What
        # blocks must not run in it: the executor has one thread.
        self._server = ActionServer(
            self,
            Calibrate,
            "calibrate",
            execute_callback=self._execute,
            goal_callback=lambda goal: GoalResponse.ACCEPT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        self._gap_server = ActionServer(
            self,
            FindGap,
            "find_gap",
            execute_callback=self._execute_search,
            goal_callback=lambda goal: GoalResponse.ACCEPT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        self.create_timer(_POLL, self._look)
        self.announce_ready()

    # ---- the action

    async def _execute(self, handle: Any) -> Calibrate.Result:
        """Run a goal of ``calibrate``."""
        return await self._run(handle, Job, Calibrate.Result, self.tell)

    async def _execute_search(self, handle: Any) -> FindGap.Result:
        """Run a goal of ``find_gap``."""
        return await self._run(handle, GapSearchJob, FindGap.Result, self.tell_search)

    async def _run(self, handle: Any, kind: type, answer: type, tell: Callable) -> Any:
        """Run a goal. Its end is told by the result, a mistake in the goal included."""
        if self._job:
            handle.abort()
            return answer(message=f"{self._job.WHAT} is running; cancel it first")
        self._job = kind(self, handle)
        self.state = CalibrationState(phase="listening")
        self.search = GapSearch(phase="listening")
        try:
            result = await self._job.run()
        except LocoError as error:
            result = answer(message=str(error))
            tell("failed", result.message)
            handle.abort()
        else:
            cancelled = handle.is_cancel_requested
            tell("cancelled" if cancelled else "done", result.message)
            (handle.canceled if cancelled else handle.succeed)()
        finally:
            self._job.close()
            self._job = None
        return result

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait for a condition, which is looked at 20 times a second."""
        future = Future(executor=self.executor)
        self._awaited = condition, future
        await future

    def _look(self) -> None:
        if self._meter:
            self._measure_gap()
        if self._awaited and self._awaited[0]():
            future, self._awaited = self._awaited[1], None
            future.set_result(None)

    def tell(self, phase: str, text: str = "") -> None:
        """Publish the state of the calibration."""
        self.state.phase, self.state.text = phase, text
        self.state.stamp = to_stamp(max(0.0, self.measured.signals.now) if self.measured else 0.0)
        self._state.publish(self.state)

    def tell_search(self, phase: str, text: str = "") -> None:
        """Publish the state of the search for the cause of a gap."""
        self.search.phase, self.search.text = phase, text
        self.search.tick += 1
        self.search.stamp = to_stamp(max(0.0, self.measured.signals.now) if self.measured else 0.0)
        self._search.publish(self.search)

    # ---- the robots

    async def connect(self, measured: str, model: str, robot: Robot, span: float) -> None:
        """Listen to robots by their namespaces; an empty name stands for none.

        Args:
            measured: Namespace of the measured robot.
            model: Namespace of the robot that gets the models.
            robot: What both are.
            span: Simulated time to keep of what they say [s].

        Raises:
            GraphError: Nobody publishes joint states there.
        """
        self._disconnect()
        for namespace in filter(None, (measured, model)):
            await self._wait_for(namespace)
        skip = self.listen.skip
        if measured:
            self.measured = LiveRobot(self, measured, robot, span, skip)
        if model:
            self.model = LiveRobot(self, model, robot, span, skip)
        if measured and model:
            signals = self.measured.signals, self.model.signals
            rate, window = robot.control_rate, self.options.window
            self._meter = GapMeter(*signals, passive(robot) or robot.joints, rate, window)

    async def _wait_for(self, namespace: str) -> None:
        name, deadline = topic(namespace, STATES), time.monotonic() + self.listen.patience
        await self.until(lambda: self.count_publishers(name) > 0 or time.monotonic() > deadline)
        if not self.count_publishers(name):
            found = ", ".join(robots(self)) or "no namespace"
            raise GraphError(f"nobody publishes {name}; there are robots in {found}")

    def _disconnect(self) -> None:
        for robot in (self.measured, self.model):
            if robot:
                robot.close()
        self.measured = self.model = self._meter = None

    def _measure_gap(self) -> None:
        found = self._meter.update()
        if found:
            message = Gap(stamp=to_stamp(found.t), tick=found.number, gap=found.gap)
            message.model = self.model.model_at(found.since)
            message.mixed = message.model != self.model.model_at(found.since + found.period)
            message.names, message.joints = list(self._meter.passive), found.joints.tolist()
            self._gap.publish(message)

    def diagnose(self) -> dict[str, Any]:
        """Phase, generation and best loss; how far a search is."""
        s, g = self.state, self.search
        found = {"phase": s.phase, "generation": s.tick, "best": s.best}
        return found if g.phase == "idle" else {**found, "search": g.phase, "share": g.fraction}

    def close(self) -> None:
        """End the worker, and what the node does not end by itself."""
        if self._job:
            self._job.close()
        self._disconnect()
        self._server.destroy()
        self._gap_server.destroy()


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_bringup calibrator``."""
    sys.exit(run_nodes([CalibratorNode], args))


if __name__ == "__main__":
    main()
