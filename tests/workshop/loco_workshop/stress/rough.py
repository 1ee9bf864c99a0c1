# SPDX-License-Identifier: Apache-2.0
"""System failures for `loco chaos`: killed supervisor, full disk, no memory, clock jumps.

Other cases run `loco top`, `loco doctor` or a second run beside the graph. Each repetition is a
new real-time graph that is disturbed after some time. It must continue, or end with a reason; it
must leave only a bag that is complete or recoverable.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run
from loco_control.exceptions import GraphError
from loco_learning.runs import experiment

from .faults import SAFE_TICKS, time_outs, undamped
from .traces import Traces, opened_by, tagged

EXPERIMENT = "hyq_trot_open"
CONTROLLERS = ("target_generator", "reflex_network", "stance_controller")
LONG = {"learner.train": 3600.0}
PATIENCE = 40.0  # longest wall time until a disturbed run has ended [s]
REALTIME = {"fifo": 10}  # if granted, other load on the machine does not affect the robot
AHEAD, BACK = "wall clock jumps ahead", "wall clock is set back"
_GUARD = b"loco_bringup.graph.guard"
_ALIVE = (0.3, 1.5)  # wall time from the start of a graph to the disturbance [s]
_MUTE = 2.5  # simulated time without diagnostics (period 1 s) that counts as silence [s]
_GOES_ON = 4.0  # wall time that a graph must continue after a tolerated disturbance [s]
_VISIT = 40.0  # longest wall time of a command beside the graph, including its start [s]
_DISK = 700_000  # largest size of each file [bytes]; a bag reaches it in about 1 s
_JUMP = 3600.0  # largest jump of the wall clock [s]
LATE = {"real-time factor", "time-out"}  # findings of `loco doctor` on a slow machine
_CLOCK, _OFFSET = "LOCO_WALL_CLOCK", struct.Struct("=q")  # of `wall_clock.c`: file, offset [ns]


def kill_one(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill an essential process; the run must end with a reason."""

    def hit(pids: dict[str, int]) -> None:
        os.kill(pids[who], signal.SIGKILL)

    text = _hit(hit, rng, folder, traces)
    return _looked(text.startswith(f"{who} died with exit code -9"), "ended", text, folder, traces)


def kill_recorder_on_a_full_disk(
    who: str, rng: np.random.Generator, folder: Path, traces: Traces
) -> str:
    """Kill the recorder at about the time when the disk is full; the run must end with a reason."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (_DISK, limits[1]))
    try:
        return kill_one("recorder", rng, folder, traces)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def kill_guard(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill the guard; the run must continue."""

    def hit(pids: dict[str, int]) -> None:
        for pid in _guards():
            os.kill(pid, signal.SIGKILL)

    message = _hit(hit, rng, folder, traces, ends=False)
    return _looked(not message, "ridden", message, folder, traces)


def end_of_memory(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Limit the memory of all processes of the run to their current use."""

    def hit(pids: dict[str, int]) -> None:
        for pid in pids.values():
            pages = int(Path(f"/proc/{pid}/statm").read_text().split()[0])
            size = pages * resource.getpagesize()
            resource.prlimit(pid, resource.RLIMIT_AS, (size, size))

    message = _hit(hit, rng, folder, traces, ends=False)
    how = "ended" if re.match(r"\w+ died with exit code", message) else "ridden"
    return _looked(how == "ended" or not message, how, message, folder, traces)


def clock_jump(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Let the wall clock of the run, including its supervisor, jump by up to an hour.

    A jump forward must have no effect on the robot. After a jump back, Fast DDS may drop messages
    for a short time, since newer ones seem older (its issue 5019), so the plant may enter its safe
    state. All nodes must continue to publish diagnostics. Needs the environment from `wall_clock`.
    """
    jump = float(rng.uniform(0.0, _JUMP)) * (1 if who == AHEAD else -1)
    try:
        message = _hit(lambda pids: _set_clock(jump), rng, folder, traces, ends=False)
    finally:
        _set_clock(0.0)
    late: list[tuple[int, int]] = []
    if not message:
        bag = Bag(folder)
        late = time_outs(bag)[0]
        if late and (jump > 0 or any(tick - last > SAFE_TICKS for tick, last in late)):
            message = f"time-outs after a jump of {jump:.0f} s: {late}"
        elif late and (violations := undamped(bag)):
            message = f"after a jump of {jump:.0f} s: {violations}"
        elif mute := _mute(bag):
            message = f"silent after a jump of {jump:.0f} s: {', '.join(mute)}"
    return _looked(not message, "safe" if late else "ridden", message, folder, traces)


def _mute(bag: Bag) -> list[str]:
    """Nodes without diagnostics at the end of a run."""
    diagnostics = zip(bag.times("/diagnostics"), bag.messages("/diagnostics"), strict=True)
    newest = {message.status[0].name: at for at, message in diagnostics}
    return sorted(name for name, at in newest.items() if bag.end - at / 1e9 > _MUTE)


def wall_clock(folder: Path) -> dict[str, str]:
    """Environment variables for processes that share an adjustable wall clock.

    Args:
        folder: New folder for the compiled library and its file.

    Raises:
        GraphError: There is no C compiler.
    """
    folder.mkdir(parents=True)
    library, file = folder / "wall_clock.so", folder / "wall_clock"
    file.write_bytes(_OFFSET.pack(0))
    source = Path(__file__).with_name("wall_clock.c")
    command = [os.environ.get("CC", "cc"), "-O1", "-shared", "-fPIC", "-o", library, source, "-ldl"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except OSError as error:
        raise GraphError(f"{command[0]} cannot be run: {error.strerror}; CC names one") from None
    except subprocess.CalledProcessError as error:
        raise GraphError(f"{source.name} cannot be compiled: {error.stderr[-300:]}") from None
    return {"LD_PRELOAD": str(library), _CLOCK: str(file)}


def _set_clock(seconds: float) -> None:
    """Set the offset [s] of the shared wall clock from the machine's clock."""
    with open(os.environ[_CLOCK], "r+b") as file:  # memory-mapped by all processes
        file.write(_OFFSET.pack(round(seconds * 1e9)))


def doctor_beside_top(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Run `loco doctor` while `loco top` is open; it may report only a slow machine.

    Three additional programs start; with few cores the graph may miss ticks for a short time.
    """
    return _visited(["doctor", "--json"], [["top"]], doctor_said, rng, folder, traces)


def doctor_said(code: int, text: str) -> str:
    """Evaluate the output of `loco doctor --json` for an undisturbed graph.

    Returns:
        "ridden": no grave finding; "late": only findings of a slow machine; "": other findings.
    """
    try:
        grave = {row["fault"] for row in json.loads(text) if row["grave"]}
    except (ValueError, TypeError, KeyError):
        return ""
    if code != int(bool(grave)):
        return ""
    return ("late" if grave else "ridden") if grave <= LATE else ""


def _said(code: int, text: str) -> Callable[[int, str], str]:
    """Function that checks the exit code and output of a command."""
    return lambda ended, said: "ridden" if ended == code and text in said else ""


def doctor_of_a_stopped(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Run `loco doctor` while a controller is stopped; it must name the controller."""
    node = CONTROLLERS[int(rng.integers(len(CONTROLLERS)))]

    def stop(pids: dict[str, int]) -> Callable[[], None]:
        os.kill(pids[node], signal.SIGSTOP)
        return lambda: os.kill(pids[node], signal.SIGCONT)

    judge = _said(1, f"{node} (pid")
    return _visited(["doctor", "--json"], [], judge, rng, folder, traces, stop)


def second_run(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Start a second run in the same domain; it must be refused without leftovers."""
    other = folder.with_name(f"{folder.name}_second")
    arguments = ["run", EXPERIMENT, "--out", str(other)]
    judge = _said(1, "another loco run uses ROS domain")
    how = _visited(arguments, [], judge, rng, folder, traces)
    if other.exists():
        traces.notes.append(f"{other.name} is there")
        return ""
    return how


def kill_supervisor(who: str, rng: np.random.Generator, folder: Path, traces: Traces) -> str:
    """Kill `loco run` itself, with or without its guard; all its child processes must end."""
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
    """Disturb many graphs in the same manner; returns one row.

    Args:
        how: SIGKILL or rough.
        what: Key of `KILLED` or `HAPPENS`.
        repeats: Number of graphs.
        seed: Seed of the times.
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
    passed = sum(row.get(outcome, 0) for outcome in ("ridden", "ended", "safe", "late"))
    row["ok"] = passed == repeats and traces.clean
    return [row]


def _hit(
    hit: Callable[[dict[str, int]], Any],
    rng: np.random.Generator,
    folder: Path,
    traces: Traces,
    ends: bool = True,
    done: Callable[[], bool] = lambda: True,
) -> str:
    """Run a graph and call `hit` after some time; returns the reason of its end, "" if none.

    The graph runs at least until `done` is true.
    """
    due = end = 0.0

    def watch(progress: Any) -> bool:
        nonlocal due, end
        t = time.monotonic()
        if progress.sim_time > 0.0 and not due:
            due = t + float(rng.uniform(*_ALIVE))
        if due and t >= due and not end:
            end = t + (PATIENCE if ends else _GOES_ON)
            traces.opened = opened_by(progress.pids.values())
            hit(progress.pids)
        return bool(end) and t >= end and (done() or t >= end + _VISIT)

    message = ""
    try:
        outcome = run.run_robots(
            {"": experiment.load(EXPERIMENT, LONG)}, folder, "processes", "realtime",
            on_progress=watch, stop_on_fall=False, realtime=REALTIME,
        )  # fmt: skip
        if any(outcome.exit_codes.values()):
            message = f"exit codes {outcome.exit_codes}"
    except GraphError as error:
        message = str(error).splitlines()[0]
    return message


def _hears_interrupts() -> None:
    """Restore the SIGINT handler, which shells disable for background processes."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _visited(
    words: list[str],
    others: list[list[str]],
    judge: Callable[[int, str], str],
    rng: np.random.Generator,
    folder: Path,
    traces: Traces,
    change: Callable[[dict[str, int]], Callable[[], None]] = lambda pids: lambda: None,
) -> str:
    """Run commands beside a graph, which must continue; check the first command's result."""
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
        message = _hit(come, rng, folder, traces, ends=False, done=gone)
    finally:
        while undo:
            undo.pop()()
        for visitor in visitors:
            visitor.send_signal(signal.SIGINT)
        outputs = [visitor.communicate(timeout=PATIENCE)[0] for visitor in visitors]
    how = ""
    if visitors and not message:
        how = judge(visitors[0].returncode, outputs[0])
        message = f"exit code {visitors[0].returncode}, {' '.join(outputs[0].split())[:300]}"
    return _looked(bool(how), how, message, folder, traces)


def _guards() -> list[int]:
    pids = []
    for pid in tagged():
        try:
            command = Path(f"/proc/{pid}/cmdline").read_bytes()
        except OSError:
            continue
        if _GUARD in command:
            pids.append(pid)
    return pids


def _looked(good: bool, how: str, said: str, folder: Path, traces: Traces) -> str:
    """Check for leftovers; returns the outcome, "" if a requirement is not met."""
    n_notes = len(traces.notes)
    if not good:
        traces.notes.append(f"{folder.name}: {said or 'the run did not end'}")
    traces.look(folder, traces.opened)
    if len(traces.notes) == n_notes:
        shutil.rmtree(folder)
        shutil.rmtree(folder.with_name(f"{folder.name}_recovered"), ignore_errors=True)
    return how if good else ""
