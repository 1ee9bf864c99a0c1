# SPDX-License-Identifier: Apache-2.0
"""`loco replay --verify`: feed a bag's sensor topics to live controllers, compare commands.

This is the regression test of every controller: the nodes run as in `loco run`, but the
bag replaces the plant. Each tick is sent when the previous one is answered.
"""

from __future__ import annotations

import tempfile
from bisect import bisect_right
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import BagError, GraphError, NameUnknownError, ParameterError
from loco_control.ros.join import loco_tick
from loco_control.ros.messages.joint_codec import stamp_ns
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import Topic
from loco_learning.runs.experiment import from_values, override

from ..bag.reader import Bag
from ..graph import node_set
from ..graph.processes import Guard, Process, start_nodes, stop_all
from ..graph.run import LAYOUTS, _domain_lock
from ..graph.start import StartLimits, StartMonitor
from .compare import Comparison, Verdict
from .feed import Feed, Step

PLANT = "robot_sim"
_NOT_FED = ("events", "/diagnostics", "recorder_status")


def verify(
    path: str | Path,
    layout: str = "composed",
    nodes: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    tolerance: float = 0.0,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Verdict:
    """Feed a recorded run to live controllers and compare their answers with the bag.

    Args:
        path: Bag of a run that includes its first tick.
        layout: ``composed`` (controllers in one process) or ``processes`` (one per node).
        nodes: Name or path of the node set; default that of the experiment.
        overrides: Values of the experiment to change, by dotted name.
        tolerance: Largest difference at which two numbers count as equal; 0 requires equal bytes.
        on_progress: Called periodically with the completed share.

    Raises:
        BagError: The bag is no run, or ticks are missing.
        GraphError: A controller died or never got ready.
        ParameterError: `layout`, `tolerance` or an override is invalid.
    """
    if layout not in LAYOUTS:
        raise ParameterError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
    if not tolerance >= 0.0:
        raise ParameterError(f"tolerance must be 0 or more, got {tolerance}")
    bag = Bag(path)
    experiment = _experiment(bag)
    if overrides:
        experiment = override(experiment, overrides)
    plan = _Plan(bag, experiment, nodes or experiment.node_set)
    comparison = Comparison({row.name: row.type for row in plan.heard}, tolerance)
    with _domain_lock([""]), tempfile.TemporaryDirectory(prefix="loco-verify-") as folder:
        feed = Feed(plan.steps, plan.said, plan.heard, plan.key_of, comparison)
        feed.hear_events(plan.table["events"])
        processes = plan.start(Path(folder), layout, guard := Guard())
        try:
            start = StartMonitor(StartLimits(), lambda: [p.pid for p in processes])
            feed.run(
                {spec.name for spec in plan.specs}, lambda: _check(processes), on_progress, start
            )
        finally:
            stop_all(processes, guard)
            feed.close()
    return comparison.verdict


def _experiment(bag: Bag) -> Any:
    if "experiment.yaml" not in bag.attachments():
        raise BagError(f"{bag.path} has no experiment inside; it is no run of loco")
    values = bag.yaml("experiment.yaml")
    if not isinstance(values, dict):
        raise BagError(f"{bag.path}: the experiment inside is no mapping")
    return from_values(values)


def _check(processes: list[Process]) -> None:
    for process in processes:
        if process.code is not None:
            raise GraphError(
                f"{process.name} died with exit code {process.code}; its last lines:\n"
                f"{process.tail()}"
            )


class _Plan:
    """The controllers, the messages they receive and the expected answers."""

    def __init__(self, bag: Bag, experiment: Any, nodes: str):
        self._bag, self._experiment = bag, experiment
        name = node_set.table_of(nodes)
        self.table: dict[str, Topic] = TABLES[name]
        self.key_of: Callable[[bytes], int] = loco_tick if name == "hyq" else stamp_ns
        self.specs = [spec for spec in node_set.load(nodes) if spec.name != PLANT]
        names = {spec.name for spec in self.specs}
        rows = [row for row in self.table.values() if row.name not in _NOT_FED]
        self.heard = [row for row in rows if row.rate and row.writer in names]
        sensors = [
            row for row in rows if row.rate and row.writer == PLANT and names & set(row.readers)
        ]
        user_topics = [row for row in rows if row.writer == "any" and names & set(row.readers)
                       and self._has(row)]  # fmt: skip
        self.said = [*sensors, *user_topics]
        self.steps = self._steps(sensors, user_topics)

    def _has(self, row: Topic) -> bool:
        try:
            return self._bag.topics[self._bag.resolve(row.name)].count > 0
        except NameUnknownError:
            matches = [n for n in self._bag.topics if n.endswith("/" + row.name)]
            if len(matches) > 1:
                raise BagError(
                    f"{self._bag.path} holds several robots ({', '.join(matches)}); "
                    "verify wants one"
                ) from None
            return False

    def _steps(self, sensors: list[Topic], user_topics: list[Topic]) -> list[Step]:
        missing = [row.name for row in sensors if not self._has(row)]
        if missing:
            raise BagError(f"{self._bag.path} has no {', '.join(missing)}, which controllers need")
        outputs = {row.name: self._by_key(row) for row in self.heard if self._has(row)}
        if not outputs:
            expected = ", ".join(row.name for row in self.heard)
            raise BagError(f"{self._bag.path} has no answers to compare: none of {expected}")
        inputs = {row.name: self._by_key(row) for row in sensors}
        keys = sorted(set.intersection(*(set(rows) for rows in inputs.values())))
        self._refuse_gaps(keys)
        steps = []
        for tick, key in enumerate(keys):
            said = {name: rows[key] for name, rows in inputs.items()}
            if answers := {name: rows[key] for name, rows in outputs.items() if key in rows}:
                steps.append(Step(tick, key, said, answers))
        for row in user_topics:
            self._put(row, steps)
        return steps

    def _by_key(self, row: Topic) -> dict[int, bytes]:
        return {self.key_of(data): data for data in self._bag.raw(row.name)[1]}

    def _refuse_gaps(self, keys: list[int]) -> None:
        """Raise an error for missing ticks: controllers have state and need every tick."""
        ticks = keys
        if self.key_of is not loco_tick:
            ticks = [round(key * self._experiment.control_rate / 1e9) for key in keys]
        for expected, tick in enumerate(ticks):
            if tick != expected:
                raise BagError(
                    f"{self._bag.path}: tick {expected} is missing; controllers have memory, so "
                    "verify wants every tick from the first"
                )

    def _put(self, row: Topic, steps: list[Step]) -> None:
        """Assign operator messages to the tick at which they first took effect.

        The controller's event ``heard`` gives this tick and the message, since the controller can
        miss the first messages during discovery. In a bag without such events it is the tick after
        the newest one at the time of recording.
        """
        times, data = self._bag.raw(row.name)
        received = self._events_heard(row.name)
        if received:
            messages = {}
            for message, raw in zip(self._bag.messages(row.name), data, strict=True):
                messages |= dict.fromkeys(_event_texts(message), raw)
            pairs = [(tick, messages.get(value)) for tick, value in received]
        else:
            starts = [round(step.tick * 1e9 / self._experiment.control_rate) for step in steps]
            pairs = [
                (bisect_right(starts, int(t) + 1), m) for t, m in zip(times, data, strict=True)
            ]
        for tick, message in pairs:
            if message is None:
                raise BagError(
                    f"{self._bag.path}: the controller heard a message on {row.name} at tick "
                    f"{tick} that the recorder missed, so it cannot be said again"
                )
            if tick < len(steps):
                steps[tick].before.append((row.name, message))

    def _events_heard(self, name: str) -> list[tuple[int, str]]:
        """Ticks at which values of a topic took effect, with the values, by the reader's events."""
        events = self._bag.messages("events") if self._has(self.table["events"]) else []
        start = f"{name} "
        received = [e for e in events if e.kind == "heard" and e.text.startswith(start)]
        return [(e.tick, e.text.removeprefix(start)) for e in received]

    def start(self, folder: Path, layout: str, guard: Guard) -> list[Process]:
        """Start the controllers."""
        run = {"recorded": False, "weights": str(folder / "weights.npz")}
        content = node_set.parameter_file(self.specs, self._experiment, {}, run)
        params = folder / "params.yaml"
        params.write_text(yaml.safe_dump(content, sort_keys=False))
        return [
            start_nodes(
                name, [s.cls for s in group], params, folder / "logs" / f"{name}.log", guard
            )
            for name, group in node_set.grouped(self.specs, layout).items()
        ]


def _event_texts(message: Any) -> tuple[str, ...]:
    """Possible texts of the event ``heard`` for an operator message.

    For a twist, controllers of earlier versions reported only the speed.
    """
    if hasattr(message, "data"):
        return (str(message.data),)
    linear, angular = message.twist.linear, message.twist.angular
    return str(linear.x), f"{linear.x} {linear.y} {angular.z}"
