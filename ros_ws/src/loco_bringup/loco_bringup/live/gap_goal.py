# SPDX-License-Identifier: Apache-2.0
"""Execution of a goal of ``find_gap``: connect, listen or read, search, send the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from loco_control.exceptions import MissingFileError, ParameterError
from loco_learning.gap import workflow
from loco_learning.gap.importing.importing import NO_RECORDING
from loco_learning.gap.recordings.record import HELD_OUT, Record
from loco_learning.gap.worker import Done, Failed, Progress, Worker
from loco_msgs.action import FindGap
from loco_sim.plant import model as models
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import TorqueDrive

from ..gap import run as runner
from ..gap import text
from .goal import Goal

PARTS = 3  # records that the signals are split into; the last is held out
Find = Callable[..., Mapping[str, Any]]  # (job, records, tell) -> contents of gap.json


class GapGoal(Goal):
    """One goal: connect, listen or read, search, send the model to the model robot."""

    ACTION, NAME, WHAT = FindGap, "find_gap", "a search"

    def __init__(self, node: Any, handle: Any):
        super().__init__(node, handle)
        self._result: Mapping[str, Any] | None = None

    async def run(self) -> FindGap.Result:
        """Execute the goal.

        Raises:
            LocoError: The goal is wrong, or there is no result.
        """
        goal, node = self._goal, self._node
        self.duration, job = node.duration_of(goal), self._job()
        robot = models.load_any(job.robot).make_robot()
        live = "" if goal.bags else goal.measured
        await node.connect(live, goal.model, robot, self.duration + 1.0)
        records: list[Record] = []
        if live:
            self.publish("listening", f"{self.duration:g} s of {live}")
            signals = await self._listen(self._on_share)
            records = live_records(signals, robot) if signals else []
        if not self._cancelled():
            self._worker = Worker(partial(node.find, job, records))
            await self._searching()
        return self._answer()

    def _job(self) -> runner.Job:
        """Search request of a goal, checked as far as possible before listening."""
        goal = self._goal
        if not (goal.measured or goal.bags):
            raise ParameterError("a goal names the namespace of a measured robot, or bags")
        named = [self._node.allowed(path, "recording") for path in (*goal.bags, *goal.hold_out)]
        for path in named:
            if not Path(path).exists():
                raise MissingFileError(NO_RECORDING.format(path))
        mapping = self._node.allowed(goal.mapping, "mapping") if goal.mapping else ""
        options: dict[str, Any] = {"seed": int(goal.seed)}
        options |= {k: list(getattr(goal, k)) for k in ("effects", "free") if getattr(goal, k)}
        job = runner.Job(
            self._node.robot_of(goal), tuple(named[: len(goal.bags)]),
            tuple(named[len(goal.bags) :]), mapping, options, workers=1,
        )  # fmt: skip
        runner.options_of(job)
        return job

    def _on_share(self, share: float) -> None:
        self._report(Progress(0.1 * share, "listening", ""), "listening")

    def publish(self, phase: str, text: str = "") -> None:
        """Publish the state of the search."""
        self._node.search.tick += 1
        self._node.publish(self._node.search, phase, text)

    async def _searching(self) -> None:
        while self._result is None and not self._cancelled():
            await self._node.until(lambda: True)
            for news in self._worker.news():
                if isinstance(news, Failed):
                    raise ParameterError(news.text)
                if isinstance(news, Progress):
                    self._report(news, "searching")
                elif isinstance(news, Done):
                    self._result = news.result
        if self._result is not None and self._node.model and self._result["model"]["effects"]:
            self._node.model.send(runner.patched(self._result).dumps())

    def _report(self, news: Progress, phase: str) -> None:
        self._handle.publish_feedback(
            FindGap.Feedback(fraction=news.fraction, stage=news.stage, best=news.best)
        )
        search = self._node.search
        search.fraction, search.best = news.fraction, news.best
        self.publish(phase, news.stage)

    def _answer(self) -> FindGap.Result:
        """Result of the action, also published on the latched topic."""
        search, result = self._node.search, self._result
        if result is None:
            return FindGap.Result(message="cancelled before anything was found")
        search.fraction, search.verdict = 1.0, result["verdict"]
        search.names = [t["effect"] for t in result["terms"]]
        search.places = [text.place_of(t.get("place")) for t in result["terms"]]
        search.before, search.after = (
            float(result["gap"].get(k) or 0) for k in ("before", "after")
        )
        search.gap_json = runner.dumps(result)
        search.model_yaml = runner.patched(result).dumps()
        return FindGap.Result(
            verdict=search.verdict, names=search.names, places=search.places, before=search.before,
            after=search.after, gap_json=search.gap_json, model_yaml=search.model_yaml,
            message=" ".join([text.headline(result), text.gap_line(result)]).strip(),
        )  # fmt: skip


def find(job: runner.Job, records: list[Record], on_progress: runner.Report) -> Mapping[str, Any]:
    """Search in the worker process, with live records in place of bags."""
    if not records:
        model, fit, held = runner.read_records(job)
    else:
        model = models.load_any(job.robot)
        fit = [r for r in records if r.role != HELD_OUT]
        held = [r for r in records if r.role == HELD_OUT]
    return runner.plain(
        workflow.find(model, fit, held, runner.options_of(job), on_progress, job.workers)
    )


def live_records(signals: Any, robot: Robot) -> list[Record]:
    """Records of a robot's live signals, split into `PARTS`; the last is held out.

    Args:
        signals: `calibration.live.Signals` of the robot.
        robot: Description of the robot.
    """
    recording = signals.recording(robot.control_rate)
    drives = [robot.drives.get(robot.joints[i]) for i in robot.driven]
    kind = "torque" if any(isinstance(d, TorqueDrive) for d in drives) else "position"
    record = Record(
        signals.name.strip("/"), recording.t - recording.t[0], {kind: recording.command},
        tuple(robot.joints[i] for i in robot.driven), {"q": recording.q}, tuple(robot.joints),
    )  # fmt: skip
    edges = [round(i * len(record.t) / PARTS) for i in range(PARTS + 1)]
    parts = [
        record.rows(a, b, f"{record.name} {i + 1}")
        for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]
    return [*parts[:-1], replace(parts[-1], role=HELD_OUT)]
