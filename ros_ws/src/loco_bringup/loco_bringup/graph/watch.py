# SPDX-License-Identifier: Apache-2.0
"""Monitor the processes of a run by their events and diagnostics, and stop them."""

from __future__ import annotations

import contextlib
import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from loco_control.exceptions import GraphError
from loco_control.ros.endpoints import ANOTHER, own_host, strangers
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import topic

from ..client import GraphClient
from ..outcome import LIMIT, Outcome, Progress
from .processes import Guard, Process, stop_all
from .start import StartLimits, StartMonitor

_TIMING = (
    "lateness_p50_ms", "lateness_p99_ms", "lateness_max_ms", "missed_ticks", "dropped_ticks",
    "late_ticks",
)  # fmt: skip
_REPORTED = ("recording stopped", "weights not saved")  # events to report to the user
_PLANT = "robot_sim"  # node whose events and diagnostics give the progress of a graph
_ROUNDING = 1e-5  # relative rounding error of times in diagnostics
_MISTAKE = "loco_control.ros.executor: "  # prefix of a user error in the log of a process
STALL_TIMEOUT = 30.0  # wall time without a tick after which a run is aborted [s]


class _End(NamedTuple):
    """Announced end of a run: last tick, simulated time [s] and text."""

    tick: int
    time: float
    text: str


@dataclass
class _Graph:
    """State of the robot in one namespace."""

    table: str  # key of the topic table
    started: bool = False
    alone: bool = False  # no other process wrote its topics at the start
    ends: deque[_End] = field(default_factory=lambda: deque(maxlen=LIMIT))  # also of others
    sim_time: float = 0.0
    recorder_tick: int = -1

    @property
    def end(self) -> _End | None:
        """The end announced for the time of the plant's diagnostics, if any.

        Other processes may announce ends, too.
        """
        t = self.sim_time
        confirmed = (e for e in self.ends if abs(e.time - t) <= _ROUNDING * max(1.0, t))
        return next(confirmed, None)

    @property
    def done(self) -> bool:
        """Whether it has ended, its last diagnostics have arrived, and the bag is complete."""
        return self.end is not None and self.recorder_tick >= self.end.tick


class Watch:
    """Monitor of events and diagnostics, which stops all processes at the end of the run.

    Args:
        processes: All processes of the run.
        folder: Folder of the bag.
        duration: Simulated duration of the run [s].
        on_progress: Called about ten times per second; a true return value ends the run.
        graphs: Topic table of each robot by its namespace, "" for no namespace.
        guard: Guard process, dismissed when all processes have ended.
        start: Limits on the time until all nodes are ready.
    """

    def __init__(
        self,
        processes: list[Process],
        folder: Path,
        duration: float,
        on_progress: Callable[[Progress], Any],
        graphs: Mapping[str, str],
        guard: Guard | None = None,
        start: StartLimits | None = None,
    ):
        self._processes, self._guard = processes, guard
        self._on_progress = on_progress
        self._progress = Progress(duration=duration)
        self.outcome = Outcome(folder)
        self._waiting: dict[str, str] = {}
        self._graphs = {namespace: _Graph(table) for namespace, table in graphs.items()}
        self._error = ""  # why the run ends
        self._stopped = False
        self._moved = time.monotonic()
        limits = start or StartLimits()
        self._start = StartMonitor(limits, lambda: [p.pid for p in processes])

    @property
    def started(self) -> bool:
        """True once every robot has begun its first tick."""
        return all(g.started for g in self._graphs.values())

    @property
    def began_alone(self) -> bool:
        """True once every robot has begun its first tick and no other process writes its topics."""
        return all(g.alone for g in self._graphs.values())

    def run(self) -> Outcome:
        """Monitor the run to its end; every exit path first stops all processes."""
        try:
            with _Listener(self, list(self._graphs)) as listener:
                while not self._stopped and not all(g.done for g in self._graphs.values()):
                    listener.spin(0.1)
                    self._look_for_strangers(listener)
                    self._check()
                    self._progress.pids = {p.name: p.pid for p in self._processes}
                    self._stopped = bool(self._on_progress(self._progress))
                for namespace, graph in self._graphs.items():
                    if graph.end:
                        self._report(namespace, graph.end.text)
        except KeyboardInterrupt:
            self.outcome.interrupted = True
            self.outcome.text = "interrupted"
        finally:
            self.outcome.exit_codes = stop_all(self._processes, self._guard)
            self.outcome.restarts = {p.name: len(p.restarts) for p in self._processes if p.restarts}
        return self.outcome

    def _look_for_strangers(self, listener: _Listener) -> None:
        """Raise an error if other processes write the topics of the graph at its start.

        The nodes check this too, but may not have discovered all other processes yet.
        """
        for namespace, graph in self._graphs.items():
            if graph.started and not graph.alone:
                names = [row.name for row in TABLES[graph.table].values() if row.paced]
                conflict = listener.strangers(_join(namespace, name) for name in names)
                graph.alone = not conflict
                self._error = self._error or (f"{conflict}; {ANOTHER}" if conflict else "")

    def _check(self) -> None:
        if self._error:
            raise GraphError(self._error)
        for process in self._processes:
            if process.code is not None and not process.revive():
                raise GraphError(_died(process))
        if not self.started:
            if failure := self._start.failure():
                waits = "; ".join(f"{n}: {w}" for n, w in sorted(self._waiting.items()))
                raise GraphError(
                    f"{failure}; {waits or 'no node spoke'} (loco run --start-timeout waits longer)"
                )
        elif time.monotonic() - self._moved > STALL_TIMEOUT:
            raise GraphError(self._stalled())

    def _stalled(self) -> str:
        graph = min(self._graphs.values(), key=lambda g: g.sim_time)
        return (
            f"nothing moved for {STALL_TIMEOUT:.0f} s at {graph.sim_time:.3f} s; "
            f"last tick {graph.ends[-1].tick if graph.ends else 'not reached'}, "
            f"recorder at tick {graph.recorder_tick}"
        )

    def on_event(self, namespace: str, event: Any) -> None:
        """Handle an event of a graph."""
        graph, self._moved = self._graphs[namespace], time.monotonic()
        self._start.advance()
        self._progress.events.append((self._moved, event))
        if event.kind in ("started", "fall", "finished") and event.node != _PLANT:
            return
        if event.kind == "started":
            graph.started = True
        elif event.kind == "phase":
            self._progress.phase = event.text
        elif event.kind == "fall":
            self.outcome.fallen = True
        elif event.kind == "finished":
            time_s = event.stamp.sec + event.stamp.nanosec / 1e9
            graph.ends.append(_End(event.tick, time_s, event.text))
        elif event.kind in _REPORTED:
            self._report(namespace, f"{event.kind}: {event.text}")

    def _report(self, namespace: str, text: str) -> None:
        """Add a line to the summary of the run."""
        text = f"{namespace}: {text}" if namespace else text
        self.outcome.text = "; ".join(filter(None, [self.outcome.text, text]))

    def on_diagnostics(self, array: Any) -> None:
        """Handle the diagnostics of a node of any graph."""
        for status in array.status:
            values = {v.key: v.value for v in status.values}
            waits = [values[key] for key in ("waiting for", "waiting for nodes") if values.get(key)]
            if waits and self._waiting.get(status.name) != waits[-1] and len(self._waiting) < LIMIT:
                self._waiting[status.name] = waits[-1]
                self._start.advance()
            granted = filter(None, values.get("realtime", "").split("; "))
            notes = self.outcome.granted
            notes += [line for line in granted if line not in notes]
            namespace, _, name = status.name.rpartition("/")
            if name == _PLANT and namespace in self._graphs and "sim_time" in values:
                with contextlib.suppress(ValueError, KeyError):  # from a foreign publisher
                    self._on_plant(self._graphs[namespace], values)

    def _on_plant(self, graph: _Graph, values: dict[str, str]) -> None:
        numbers = ("sim_time", "real_time_factor", *_TIMING)
        read = {key: float(values[key]) for key in numbers if key in values}
        t, factor = read["sim_time"], read["real_time_factor"]
        if not all(map(math.isfinite, read.values())):
            raise ValueError(read)
        if t != graph.sim_time:  # larger, or smaller after a value of a foreign publisher
            self._moved = time.monotonic()
        graph.sim_time = t
        self._progress.sim_time = min(g.sim_time for g in self._graphs.values())
        self._progress.real_time_factor = factor
        self.outcome.real_time_factor = self._progress.real_time_factor
        if "lateness_p50_ms" in values:
            self.outcome.timing = {key: read[key] for key in _TIMING}

    def on_recorder(self, namespace: str, status: Any) -> None:
        """Handle the recorder's progress with a graph."""
        self._graphs[namespace].recorder_tick = status.tick
        self.outcome.dropped = status.dropped


def _died(process: Process) -> str:
    """Reason for the death of a process; a user error is read from the log, not from a topic."""
    tail = process.tail()
    if process.code == 2 and _MISTAKE in tail:
        return f"{process.name}: {tail.rpartition(_MISTAKE)[2].splitlines()[0]}"
    times = len(process.restarts)
    restarts = f" after {times} restart{'s' * (times > 1)}" if times else ""
    return (
        f"{process.name} died with exit code {process.code}{restarts}; last lines of "
        f"{process.log}:\n{tail}"
    )


def _join(namespace: str, name: str) -> str:
    return f"{namespace}/{name}" if namespace else name


class _Listener(GraphClient):
    """Node of the supervisor, which subscribes to events, diagnostics and recorder status."""

    def __init__(self, watch: Watch, namespaces: list[str]):
        super().__init__("supervisor")
        self._subscribe("/diagnostics", "", watch.on_diagnostics)
        for namespace in namespaces:
            self._subscribe("events", namespace, partial(watch.on_event, namespace))
            self._subscribe("recorder_status", namespace, partial(watch.on_recorder, namespace))

    def _subscribe(self, name: str, namespace: str, callback: Callable[[Any], None]) -> None:
        row = topic(name)
        self.node.create_subscription(
            row.type, _join(namespace, row.name), callback, row.qos.reader(100)
        )

    def strangers(self, topics: Iterable[str]) -> str:
        """First of these topics with several writers, and the writers' names; "" for none."""
        host = own_host(self.node.get_publishers_info_by_topic("rosout"))
        results = (strangers(self.node, topic, host) for topic in topics)
        return next(filter(None, results), "")
