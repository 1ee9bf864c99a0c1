# SPDX-License-Identifier: Apache-2.0
"""Execution of a goal of the action ``calibrate``: connect, listen, fit, send the models."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import Any

from loco_control.exceptions import ParameterError
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.worker import Done, Failed, Progress, Started, Worker
from loco_msgs.action import Calibrate
from loco_sim.plant import model as models

from ..calibrate.bag import read_recording
from .goal import Goal


class CalibrationGoal(Goal):
    """One goal: connect, listen, fit, send the models to the model robot."""

    ACTION, NAME, WHAT = Calibrate, "calibrate", "a calibration"

    def __init__(self, node: Any, handle: Any):
        super().__init__(node, handle)
        self._offered, self._swapped = "", -1e9  # model to be sent, time of the last swap [s]
        self._fit: Done | None = None
        self._model = ""

    async def run(self) -> Calibrate.Result:
        """Execute the goal.

        Raises:
            LocoError: The goal is wrong, or there is no result.
        """
        goal, node = self._goal, self._node
        if not (goal.measured or goal.bag):
            raise ParameterError("a goal names the namespace of a measured robot, or a bag")
        self.duration, options = node.duration_of(goal), self._options()
        bag = node.allowed(goal.bag, "bag") if goal.bag else ""
        name = node.robot_of(goal)
        robot = models.load_any(name).make_robot()
        live = "" if goal.bag else goal.measured
        await node.connect(live, goal.model, robot, self.duration + 1.0)
        if live:
            self.publish("listening", f"{self.duration:g} s of {live}")
            signals = await self._listen()
            source = signals.recording(robot.control_rate) if signals else None
        else:
            self.publish("listening", goal.bag)
            source = partial(read_recording, bag, robot.control_rate, robot, goal.measured)
        if not self._cancelled():
            self._worker = Worker(source, name, options, node.make)
            await self._fitting()
        return self._result()

    def _options(self) -> CalibrationParams:
        """Settings of the node, overridden by the values of the goal."""
        goal = self._goal
        requested = {"parameters": goal.parameter_set, "loss": goal.loss, "seed": int(goal.seed)}
        for name in ("generations", "evaluations", "population"):
            requested[name] = int(getattr(goal, name))
        changes = {name: value for name, value in requested.items() if value}
        if not goal.bag:
            changes["skip"] = 0.0  # the listener has already skipped the start
        return replace(self._node.options, **changes)

    def publish(self, phase: str, text: str = "") -> None:
        """Publish the state of the calibration."""
        self._node.publish(self._node.state, phase, text)

    async def _fitting(self) -> None:
        node, deadline = self._node, None
        while not self._fit:
            await node.until(lambda: True)
            for news in self._worker.news():
                self._on_news(news)
            self._hand_on()
            if self._cancelled() and deadline is None:
                self._worker.cancel()
                deadline = time.monotonic() + node.listen.patience
            if deadline and time.monotonic() > deadline:
                return  # the worker is slow to stop; the best result so far is known
        self._hand_on(at_once=not self._cancelled())

    def _on_news(self, news: Any) -> None:
        state = self._node.state
        if isinstance(news, Failed):
            raise ParameterError(news.text)
        if isinstance(news, Started):
            state.before = state.best = news.before
            self.publish("fitting", f"error before {news.before:.4g}")
        elif isinstance(news, Progress):
            self._on_generation(news)
        elif isinstance(news, Done):
            self._fit = news

    def _on_generation(self, news: Progress) -> None:
        g, state = news.generation, self._node.state
        state.tick, state.evaluations, state.sigma = g.index, g.evaluations, g.sigma
        if news.model:
            self._model = self._offered = news.model
            state.best, state.names, state.values = g.best, list(g.values), list(g.values.values())
        state.eta = g.eta
        self.publish("fitting", f"generation {g.index}: {g.best:.4g}")
        self._handle.publish_feedback(
            Calibrate.Feedback(
                generation=g.index, evaluations=g.evaluations, best=state.best, sigma=g.sigma,
                names=state.names, values=state.values, eta=state.eta,
            )
        )  # fmt: skip

    def _hand_on(self, at_once: bool = False) -> None:
        """Send the newest better model, once the gap of the previous one has been measured."""
        robot = self._node.model
        if not (robot and self._offered):
            return
        if at_once or robot.signals.now - self._swapped >= self._node.listen.hold:
            robot.send(self._offered)
            self._offered, self._swapped = "", robot.signals.now

    def _result(self) -> Calibrate.Result:
        state = self._node.state
        done = f"{state.tick} generations, {state.evaluations} rollouts"
        if self._cancelled():
            text = f"cancelled after {done}"
        else:
            text = f"{done}: error {state.before:.4g} to {state.best:.4g} ({self._fit.fit.ended})"
        return Calibrate.Result(
            names=state.names, values=state.values, loss_before=state.before,
            loss_after=state.best, model_yaml=self._model, message=text,
        )  # fmt: skip
