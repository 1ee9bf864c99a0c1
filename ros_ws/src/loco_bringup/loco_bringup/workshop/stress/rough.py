# SPDX-License-Identifier: Apache-2.0
"""Chaos by circumstances: who watches is killed, the disk is full, memory ends, the clock jumps.

Or it has visitors: `loco top`, `loco doctor`, a second run. Each repetition is a realtime graph of
its own that something happens to after a while. It rides that through, or it ends and says why;
nothing is left of it but a bag that is whole or is made whole.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import GraphError
from loco_control.files import write_whole
from loco_learning.runs import experiment

from ...bag.reader import Bag
from ...graph import run
from .faults import SAFE_TICKS, time_outs, undamped
from .traces import Traces, opened_by, tagged

EXPERIMENT = "hyq_trot_open"
CONTROLLERS = ("target_generator", "reflex_network", "stance_controller")
LONG = {"learner.train": 3600.0}
PATIENCE = 40.0  # wall time until a run that was hit must have ended [s]
REALTIME = {"fifo": 10}  # where it is granted, a busy machine does not answer for the robot
AHEAD, BACK = "wall clock jumps ahead", "wall clock is set back"
_GUARD = b"loco_bringup.graph.guard"
_ALIVE = (0.3, 1.5)  # wall time that a graph runs before it is hit [s]
_GOES_ON = 3.0  # wall time that it must go on after what it rides through [s]
_VISIT = 40.0  # wall time that a visitor has, with its start [s]
_DISK = 700_000  # room for each file; a bag fills it in about a second [bytes]
_JUMP = 3600.0  # longest of the wall clock [s]
_FAKETIME = "libfaketime.so.1"
_FAKETIME_AT = ("/usr/lib/*/faketime", "/usr/lib/faketime", "/usr/local/lib/faketime")


def kill_one(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill a process without which the run ends; it must end and say why."""

    def hit(pids: dict[str, int]) -> None:
        os.kill(pids[who], signal.SIGKILL)

    said = _hit(hit, rng, folder, traces)
    return _looked(said.startswith(f"{who} died with exit code -9"), "ended", said, folder, traces)


def kill_recorder_on_a_full_disk(
    who: str, rng: np.random.Generator, folder: Path, traces: Traces
) -> str:
    """The same about the time at which no file can grow any more."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (_DISK, limits[1]))
    try:
        return kill_one("recorder", rng, folder, traces)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def kill_guard(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill the guard; the run must not care."""

    def hit(pids: dict[str, int]) -> None:
        for pid in _guards():
            os.kill(pid, signal.SIGKILL)

    said = _hit(hit, rng, folder, traces, ends=False)
    return _looked(not said, "ridden", said, folder, traces)


def end_of_memory(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """No process of the run gets more memory than it has."""

    def hit(pids: dict[str, int]) -> None:
        for pid in pids.values():
            pages = int(Path(f"/proc/{pid}/statm").read_text().split()[0])
            size = pages * resource.getpagesize()
            resource.prlimit(pid, resource.RLIMIT_AS, (size, size))

    said = _hit(hit, rng, folder, traces, ends=False)
    how = "ended" if re.match(r"\w+ died with exit code", said) else "ridden"
    return _looked(how == "ended" or not said, how, said, folder, traces)


def clock_jump(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """The wall clock of all nodes jumps by up to an hour.

    A robot must not notice when it jumps ahead. When it is set back, Fast DDS drops messages for
    moments, as younger ones seem older (its issue 5019): the plant may get to its safe state then.

    Raises:
        GraphError: libfaketime is not installed.
    """
    jump = float(rng.uniform(0.0, _JUMP)) * (1 if who == AHEAD else -1)
    file = write_whole(folder.with_name(f"{folder.name}.clock"), "+0")
    changed = {
        "LD_PRELOAD": str(faketime()),
        "FAKETIME_TIMESTAMP_FILE": str(file),
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        "DONT_FAKE_MONOTONIC": "1",
        "FAKETIME_NO_CACHE": "1",  # all processes jump at once
    }
    os.environ.update(changed)
    try:
        said = _hit(lambda pids: write_whole(file, f"{jump:+.3f}"), rng, folder, traces, ends=False)
    finally:
        for name in changed:
            del os.environ[name]
        file.unlink()
    late = [] if said else time_outs(Bag(folder))[0]
    if late and (jump > 0 or any(tick - last > SAFE_TICKS for tick, last in late)):
        said = f"time-outs after a jump of {jump:.0f} s: {late}"
    elif late and (bad := undamped(Bag(folder))):
        said = f"after a jump of {jump:.0f} s: {bad}"
    return _looked(not said, "safe" if late else "ridden", said, folder, traces)


def doctor_beside_top(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Ask `loco doctor` while `loco top` is open; it must find nothing."""
    return _visited(["doctor", "--json"], [["top"]], 0, "", rng, folder, traces)


def doctor_of_a_stopped(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Ask `loco doctor` while a controller is stopped; it must name it."""
    node = CONTROLLERS[int(rng.integers(len(CONTROLLERS)))]

    def stop(pids: dict[str, int]) -> Callable[[], None]:
        os.kill(pids[node], signal.SIGSTOP)
        return lambda: os.kill(pids[node], signal.SIGCONT)

    return _visited(["doctor", "--json"], [], 1, f"{node} (pid", rng, folder, traces, stop)


def second_run(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Start a second run on the same domain; it must be refused, and leave nothing."""
    other = folder.with_name(f"{folder.name}_second")
    words = ["run", EXPERIMENT, "--out", str(other)]
    how = _visited(words, [], 1, "another loco run uses ROS domain", rng, folder, traces)
    if other.exists():
        traces.notes.append(f"{other.name} is there")
        return ""
    return how


def kill_supervisor(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill `loco run` itself, with its guard or without; all that it started must end."""
    command = ["run", EXPERIMENT, "--layout", "processes", "--clock", "realtime"]
    supervisor = subprocess.Popen(
        [sys.executable, "-m", "loco_bringup.cli.main", *command, "--out", str(folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + PATIENCE
    while sum(p.stat().st_size for p in folder.glob("*.mcap")) < 2e5 and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(float(rng.uniform(*_ALIVE)))
    traces.opened = opened_by(tagged() - {supervisor.pid})
    for pid in _guards() if who != "supervisor" else ():
        os.kill(pid, signal.SIGKILL)
    supervisor.kill()
    code = supervisor.wait()
    return _looked(code == -9, "ended", f"exit code {code}", folder, traces)


KILLED: dict[str, Callable[[str, np.random.Generator, Path, Traces], str]] = {
    "robot_sim": kill_one,
    "recorder": kill_one,
    "recorder on a full disk": kill_recorder_on_a_full_disk,
    "guard": kill_guard,
    "supervisor": kill_supervisor,
    "supervisor and guard": kill_supervisor,
}
HAPPENS = {
    "no more memory": end_of_memory,
    AHEAD: clock_jump,
    BACK: clock_jump,
    "doctor beside top": doctor_beside_top,
    "doctor of a stopped node": doctor_of_a_stopped,
    "second run": second_run,
}


def run_rough(how: str, what: str, repeats: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Let something happen to many graphs; a row.

    Args:
        how: SIGKILL or rough.
        what: Key of `KILLED` or of `HAPPENS`.
        repeats: Number of graphs.
        seed: Seed of the moments.
        folder: New folder of the bags.
    """
    rng = np.random.default_rng([seed, *f"{how} {what}".encode()])
    row: dict[str, Any] = {"what": what, "how": how, "repeats": 0, "ridden": 0, "ended": 0}
    traces = Traces()
    for k in range(repeats):
        outcome = {**KILLED, **HAPPENS}[what](what, rng, folder / f"{k:02d}", traces)
        row["repeats"] += 1
        if outcome:
            row[outcome] = row.get(outcome, 0) + 1
    row |= {"bags": traces.bags, "whole": traces.whole, "notes": traces.notes}
    row |= {"orphans": traces.orphans, "segments": traces.segments}
    row["ok"] = row["ridden"] + row["ended"] + row.get("safe", 0) == repeats and traces.clean
    return [row]


def faketime() -> Path:
    """Library that lets a wall clock jump.

    Raises:
        GraphError: The library is not there.
    """
    for pattern in _FAKETIME_AT:
        for path in Path("/").glob(f"{pattern[1:]}/{_FAKETIME}"):
            return path
    raise GraphError(f"{_FAKETIME} is not there; install the package faketime, or use --only")


def _hit(
    hit: Callable[[dict[str, int]], Any],
    rng: np.random.Generator,
    folder: Path,
    traces: Traces,
    ends: bool = True,
    done: Callable[[], bool] = lambda: True,
) -> str:
    """Run a graph, do something to its processes after a while; why it ended, "" if it went on.

    It goes on until `done`, too.
    """
    due = end = 0.0

    def watch(progress: Any) -> bool:
        nonlocal due, end
        now = time.monotonic()
        if progress.sim_time > 0.0 and not due:
            due = now + float(rng.uniform(*_ALIVE))
        if due and now >= due and not end:
            end = now + (PATIENCE if ends else _GOES_ON)
            traces.opened = opened_by(progress.pids.values())
            hit(progress.pids)
        return bool(end) and now >= end and (done() or now >= end + _VISIT)

    said = ""
    try:
        outcome = run.run_robots(
            {"": experiment.load(EXPERIMENT, LONG)}, folder, "processes", "realtime",
            on_progress=watch, stop_on_fall=False, realtime=REALTIME,
        )  # fmt: skip
        if any(outcome.exit_codes.values()):
            said = f"exit codes {outcome.exit_codes}"
    except GraphError as error:
        said = str(error).splitlines()[0]
    return said


def _hears_interrupts() -> None:
    """Undo that a shell lets what it starts in the background, and its children, ignore SIGINT."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _visited(
    words: list[str],
    others: list[list[str]],
    code: int,
    text: str,
    rng: np.random.Generator,
    folder: Path,
    traces: Traces,
    change: Callable[[dict[str, int]], Callable[[], None]] = lambda pids: lambda: None,
) -> str:
    """Start commands beside a graph; the first must end with a code and a text, the graph go on."""
    visitors: list[subprocess.Popen[str]] = []
    undo: list[Callable[[], None]] = []

    def come(pids: dict[str, int]) -> None:
        undo.append(change(pids))
        visitors.extend(
            subprocess.Popen(
                [sys.executable, "-m", "loco_bringup.cli.main", *line],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                preexec_fn=_hears_interrupts,
            )
            for line in (words, *others)
        )

    def gone() -> bool:
        if visitors and visitors[0].poll() is None:
            return False
        while undo:
            undo.pop()()
        return True

    try:
        said = _hit(come, rng, folder, traces, ends=False, done=gone)
    finally:
        while undo:
            undo.pop()()
        for visitor in visitors:
            visitor.send_signal(signal.SIGINT)
        answers = [visitor.communicate(timeout=PATIENCE)[0] for visitor in visitors]
    if not said and (visitors[0].returncode != code or text not in answers[0]):
        said = f"exit code {visitors[0].returncode}, {' '.join(answers[0].split())[:300]}"
    return _looked(not said, "ridden", said, folder, traces)


def _guards() -> list[int]:
    found = []
    for pid in tagged():
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
        except OSError:
            continue
        if _GUARD in command:
            found.append(pid)
    return found


def _looked(good: bool, how: str, said: str, folder: Path, traces: Traces) -> str:
    """Look at what is left; how it went, "" if not as it has to."""
    known = len(traces.notes)
    if not good:
        traces.notes.append(f"{folder.name}: {said or 'the run did not end'}")
    traces.look(folder, traces.opened)
    if len(traces.notes) == known:
        shutil.rmtree(folder)
        shutil.rmtree(folder.with_name(f"{folder.name}_recovered"), ignore_errors=True)
    return how if good else ""
