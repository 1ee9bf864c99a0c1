# SPDX-License-Identifier: Apache-2.0
"""Chaos by signals: processes of a realtime graph are stopped and killed at random moments.

What has to happen stands in ``docs/faults.md``. A graph lives on where its processes do: it
is stopped and woken, or starts a killed controller again. What ends a graph is in `rough`. A
plant that stops its robot for good (it fell, and a joint got too fast) shows nothing more: the
rest of the signals is for a new graph.
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
_STOPPED = (0.2, 0.4)  # wall time that a process is stopped [s]
_BETWEEN = (0.5, 1.0)  # wall time between two signals, from when commands are back [s]
_STANDS = 3.0  # simulated time until a robot walks [s]
_ECHO = 0.2  # wall time after it is woken in which time-outs are of the signal [s]


def run_signal(how: str, who: str, repeats: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Send a signal to a process many times; a row.

    Args:
        how: SIGSTOP or SIGKILL.
        who: Process.
        repeats: Number of repetitions.
        seed: Seed of the moments.
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
    good = row["safe"] + row["ridden"]
    row["ok"] = good == row["repeats"] == repeats and traces.clean
    return [row]


def node_set(path: Path) -> str:
    """The nodes of HyQ, of which controllers start again when they are killed."""
    source = resources.files("loco_bringup") / "node_sets" / "hyq.yaml"
    content = yaml.safe_load(source.read_text())
    for node in content["nodes"]:
        if node["name"] in CONTROLLERS:
            node |= {"restart": "on_failure", "restarts_per_minute": 60}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content))
    return str(path)


class Hits:
    """Signals to one process of a graph that lives on; called with its progress.

    Attributes:
        left: Number of signals that are still to be sent.
        times: Times at which each signal was sent, `time.monotonic` [s].
        opened: Shared memory of all processes.
        trouble: Why it was given up.
    """

    def __init__(self, how: str, who: str, repeats: int, rng: np.random.Generator):
        self._number = getattr(signal, how)
        self.who, self.left, self._rng = who, repeats, rng
        self.times: list[float] = []
        self._woken: list[float] = []
        self.events: Sequence[tuple[float, Any]] = ()
        self.opened: set[str] = set()
        self.trouble = ""
        self._due = self._wake = 0.0  # times; 0: not set
        self._pid = 0

    def __call__(self, progress: Any) -> bool:
        """Do what is due; true when all is done, or the robot was stopped for good."""
        now, self.events = time.monotonic(), progress.events
        if progress.sim_time < _STANDS:
            return False
        if self._wake:
            if now >= self._wake:
                os.kill(self._pid, signal.SIGCONT)
                self._wake = 0.0
                self._woken.append(now)
            return False
        if not self._fresh(now) or progress.pids[self.who] == self._pid and self._is_kill:
            self._due = 0.0
            self.trouble = self._lost(now)
            return bool(self.trouble)
        if any(event.kind == "estop" for _, event in self.events):
            return True
        if not self._due:
            self._due = now + float(self._rng.uniform(*_BETWEEN))
        if now < self._due:
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
        """Commands come, and a killed controller is back."""
        said = [e for t, e in self.events if e.kind == "timeout"]
        if said and "no command" in said[-1].text:
            return False
        since = self.times[-1] if self.times else 0.0
        heard = [t for t, e in self.events if e.kind == "resumed" and t > since]
        return not (self._is_kill and self.times) or bool(heard)

    def _lost(self, now: float) -> str:
        if not self.times or now - self.times[-1] < PATIENCE:
            return ""
        return f"commands were not back {PATIENCE:g} s after signal {len(self.times)}"

    def count(self, row: dict[str, Any], takes: bool | None) -> None:
        """Add to a row what happened.

        Args:
            row: Gets repeats, safe, ridden, worst and stalls.
            takes: Whether the signal takes the command away; None: it may.
        """
        late = [
            (t, event.tick - int(found[1]))
            for t, event in self.events
            if event.kind == "timeout"
            and (found := re.search(r"no command since tick (-?\d+)", event.text))
        ]
        ends = [*self.times[1:], np.inf]
        for k, (begin, end) in enumerate(zip(self.times, ends, strict=True)):
            until = end if k >= len(self._woken) else self._woken[k] + _ECHO
            ages = [age for t, age in late if begin < t < until]
            good = all(age <= SAFE_TICKS for age in ages)
            row["repeats"] += 1
            row["safe"] += good and bool(ages) and takes is not False
            row["ridden"] += not ages and not takes
            row["worst"] = max([row["worst"], *ages])
            row["stalls"] += len([t for t, _ in late if until <= t < end]) + max(0, len(ages) - 1)


def _run_on(hits: Hits, folder: Path, nodes: str, row: dict[str, Any], traces: Traces) -> None:
    """A graph that outlives its signals."""
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
        bad = undamped(bag)
        row["safe"] = max(0, row["safe"] - len(bad))
        row["damped"] = row["safe"]
        traces.notes += bad
