# SPDX-License-Identifier: Apache-2.0
"""Signals for `loco chaos`: stop and kill processes of a real-time graph at random times.

The required behaviour is in ``docs/faults.md``. Here the graph survives: a process is stopped
and continued, or a killed controller is restarted. Signals that end a graph are in `rough`. If
the plant stops its robot permanently (after a fall with too fast a joint), the remaining
signals are sent to a new graph.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import time
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_bringup.graph import run
from loco_control.exceptions import GraphError
from loco_learning.runs import experiment

from .faults import SAFE_TICKS, undamped
from .rough import CONTROLLERS, EXPERIMENT, LONG, PATIENCE, REALTIME
from .traces import Traces, opened_by

STOP = [("SIGSTOP", name) for name in (*CONTROLLERS, "robot_sim", "recorder")]
KILL = [("SIGKILL", name) for name in CONTROLLERS]
_STOPPED = (0.2, 0.4)  # wall time for which a process is stopped [s]
_BETWEEN = (0.5, 1.0)  # wall time from the return of commands to the next signal [s]
_STANDS = 3.0  # simulated time until the robot walks [s]
_ECHO = 0.2  # wall time after SIGCONT in which time-outs are attributed to the signal [s]


def run_signal(how: str, who: str, repeats: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Send a signal to a process many times; returns one row.

    Args:
        how: SIGSTOP or SIGKILL.
        who: Name of the process.
        repeats: Number of repetitions.
        seed: Seed of the times.
        folder: New folder of the bags.
    """
    rng = np.random.default_rng([seed, *f"{how} {who}".encode()])
    row: dict[str, Any] = {"what": who, "how": how, "repeats": 0, "safe": 0, "worst": 0}
    row |= {"ridden": 0, "stalls": 0}
    traces = Traces()
    left, nodes = repeats, node_set(folder / "nodes.yaml")
    while left and not traces.notes:
        hits = Hits(how, who, left, rng)
        _run_on(hits, folder / f"run_{repeats - left:02d}", nodes, row, traces)
        if hits.left == left:
            traces.notes.append(f"no signal was sent: {hits.trouble}")
        left = hits.left
    if not traces.notes:
        shutil.rmtree(folder)
    row |= {"bags": traces.bags, "whole": traces.whole, "notes": traces.notes}
    row |= {"orphans": traces.orphans, "segments": traces.segments}
    passed = row["safe"] + row["ridden"]
    row["ok"] = passed == row["repeats"] == repeats and traces.clean
    return [row]


def node_set(path: Path) -> str:
    """Write a node set of HyQ whose controllers are restarted after a kill; returns its path."""
    source = resources.files("loco_bringup") / "node_sets" / "hyq.yaml"
    content = yaml.safe_load(source.read_text())
    for node in content["nodes"]:
        if node["name"] in CONTROLLERS:
            node |= {"restart": "on_failure", "restarts_per_minute": 60}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content))
    return str(path)


class Hits:
    """Callback that sends signals to one process of a surviving graph; called with its progress.

    Attributes:
        left: Number of remaining signals.
        times: Times of the signals, `time.monotonic` [s].
        opened: Shared-memory files of all processes.
        trouble: Reason for giving up; empty if there is none.
    """

    def __init__(self, how: str, who: str, repeats: int, rng: np.random.Generator):
        self._number = getattr(signal, how)
        self.who, self.left, self._rng = who, repeats, rng
        self.times: list[float] = []
        self._woken: list[float] = []
        self.events: Sequence[tuple[float, Any]] = ()
        self.opened: set[str] = set()
        self.trouble = ""
        self._due = self._wake = 0.0  # times of the next signal and of SIGCONT [s]; 0: not set
        self._pid = 0

    def __call__(self, progress: Any) -> bool:
        """Send due signals; returns true when all are sent or the robot is stopped permanently."""
        t, self.events = time.monotonic(), progress.events
        if progress.sim_time < _STANDS:
            return False
        if self._wake:
            if t >= self._wake:
                os.kill(self._pid, signal.SIGCONT)
                self._wake = 0.0
                self._woken.append(t)
            return False
        if not self._fresh(t) or progress.pids[self.who] == self._pid and self._is_kill:
            self._due = 0.0
            self.trouble = self._lost(t)
            return bool(self.trouble)
        if any(event.kind == "estop" for _, event in self.events):
            return True
        if not self._due:
            self._due = t + float(self._rng.uniform(*_BETWEEN))
        if t < self._due:
            return False
        if not self.left:
            return True
        self._hit(progress.pids)
        return False

    @property
    def _is_kill(self) -> bool:
        return self._number == signal.SIGKILL

    def _hit(self, pids: dict[str, int]) -> None:
        self.opened |= opened_by(pids.values())
        time.sleep(float(self._rng.uniform(0.0, 0.1)))
        self._pid, self._due, self.left = pids[self.who], 0.0, self.left - 1
        self.times.append(time.monotonic())
        os.kill(self._pid, self._number)
        if not self._is_kill:
            self._wake = self.times[-1] + float(self._rng.uniform(*_STOPPED))

    def _fresh(self, now: float) -> bool:
        """Whether commands arrive and a killed controller has restarted."""
        timeouts = [e for t, e in self.events if e.kind == "timeout"]
        if timeouts and "no command" in timeouts[-1].text:
            return False
        since = self.times[-1] if self.times else 0.0
        resumed = [t for t, e in self.events if e.kind == "resumed" and t > since]
        return not (self._is_kill and self.times) or bool(resumed)

    def _lost(self, now: float) -> str:
        if not self.times or now - self.times[-1] < PATIENCE:
            return ""
        return f"commands were not back {PATIENCE:g} s after signal {len(self.times)}"

    def count(self, row: dict[str, Any], takes: bool | None) -> None:
        """Add the outcome to a row.

        Args:
            row: Row whose repeats, safe, ridden, worst and stalls are updated.
            takes: Whether the signal must interrupt the command; None if it may.
        """
        late = [
            (t, event.tick - int(found[1]))
            for t, event in self.events
            if event.kind == "timeout"
            and (found := re.search(r"no command since tick (-?\d+)", event.text))
        ]
        stops = [*self.times[1:], np.inf]
        for k, (start, end) in enumerate(zip(self.times, stops, strict=True)):
            until = end if k >= len(self._woken) else self._woken[k] + _ECHO
            ages = [age for t, age in late if start < t < until]
            in_time = all(age <= SAFE_TICKS for age in ages)
            row["repeats"] += 1
            row["safe"] += in_time and bool(ages) and takes is not False
            row["ridden"] += not ages and not takes
            row["worst"] = max([row["worst"], *ages])
            row["stalls"] += len([t for t, _ in late if until <= t < end]) + max(0, len(ages) - 1)


def _run_on(hits: Hits, folder: Path, nodes: str, row: dict[str, Any], traces: Traces) -> None:
    """Run a graph that survives its signals."""
    try:
        run.run_robots(
            {"": experiment.load(EXPERIMENT, LONG)}, folder, "processes", "realtime",
            nodes=nodes, on_progress=hits, stop_on_fall=False, realtime=REALTIME,
        )  # fmt: skip
    except GraphError as error:
        hits.trouble = str(error).splitlines()[0]
    hits.count(row, {"robot_sim": None, "recorder": False}.get(hits.who, True))
    if hits.trouble:
        traces.notes.append(hits.trouble)
    bag = traces.look(folder, hits.opened)
    if bag is not None:
        violations = undamped(bag)
        row["safe"] = max(0, row["safe"] - len(violations))
        row["damped"] = row["safe"]
        traces.notes += violations
