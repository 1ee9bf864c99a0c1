# SPDX-License-Identifier: Apache-2.0
"""Test that long commands reach the same end, however they are disturbed in their work.

Each command runs once undisturbed. Then it is disturbed at random times after its first result:
killed or interrupted with all its processes and restarted in the same folder, with one or two
workers, until it completes; stopped for a while; or started once more in the same folder. Or its
disk has space for only a part of the results. After each completion every file is compared byte
by byte with that of the undisturbed run.
"""

from __future__ import annotations

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from loco_control.exceptions import GraphError
from loco_control.files import write_whole

from ..battery.bags import BAGS, TIMES

_SHORT = {"learner.train": 1.0, "learner.closing": 0.5, "learner.test": 0.5, "learner.stand": 0.2}
_STUDY = {
    "description": "Two short runs on two engines.",
    "variants": {
        engine: {"experiment": "hyq_short", "sim.engine": engine, **_SHORT}
        for engine in ("mujoco", "pybullet")
    },
    "seeds": [0, 1],
    "metrics": ["speed", "nrmse"],
    "figures": ["trunk"],
}
_PLAN = {
    "clock": {"study": "chapter8_clock", "seeds": 1, "engine": "mujoco", "overrides": _SHORT},
    "gaits": {"study": "tigrillo_gaits", "engine": "mujoco", "overrides": {"duration": 2.0}},
}
_FRICTION = ("coulomb_friction", "viscous_friction")
_CASE = f"bags/{BAGS}/case_0000"
COMMANDS = {  # {} is the folder of the inputs
    "optimise": "optimise tigrillo_bound --seeds 2 --evaluations 16 --duration 1",
    "study": "study {}/study.yaml",
    "gap": f"gap {{}}/{_CASE}/fit_chirp {{}}/{_CASE}/fit_steps --hold-out {{}}/{_CASE}/hold_out "
    f"--robot linear_axis --effects {' '.join(_FRICTION)}",
    "gap battery": "gap battery --cases 2 --robots linear_axis --effects "
    f"{' '.join(_FRICTION)} --baselines sparse",
    "reproduce": "reproduce all --plan {}/plan.yaml",
    "calibrate": "calibrate {}/bags/sine --generations 2 --seeds 2",
}
MAKES = {  # commands that create the inputs
    "gap": "gap battery --cases 1 --bags-only --robots linear_axis --workers 1 --out {}/bags",
    "calibrate": "run tigrillo_sine --layout rollout --set duration=21.0 --out {}/bags/sine",
}
JOURNALS = (".jsonl", TIMES)  # files written line by line, whose last line may be incomplete
TWICE = "two at once"
WAYS = ("SIGKILL", "SIGINT", "SIGSTOP", TWICE)  # used in turn
GOOD, REFUSED, INTERRUPTED = (0, 3), 2, 130  # exit codes; 3: the best gait falls
PATIENCE = 600.0  # longest run of a command [s]
_STOPPED = (0.5, 2.0)  # wall time for which a command is stopped [s]
_TRIES = 10  # runs in a row that may complete before they are disturbed
_LOOK = 0.02  # wall time between two looks at the results [s]


@dataclass
class Row:
    """Outcome of one command.

    Attributes:
        command: Name of the command.
        hits: Number of disturbances in the work, by `WAYS`.
        full: Number of runs with a full disk.
        ends: Number of completions after a disturbance.
        same: Number of completions with the same files as the undisturbed run.
        torn: Number of incomplete files after a run had ended.
        left: Number of leftover files and processes.
        notes: Errors, one line each.
    """

    command: str
    hits: dict[str, int] = field(default_factory=lambda: dict.fromkeys(WAYS, 0))
    full: int = 0
    ends: int = 0
    same: int = 0
    torn: int = 0
    left: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether all completions gave the same files, without incomplete or leftover files."""
        return self.same == self.ends > 0 and not (self.torn or self.left or self.notes)


def run(
    name: str, kills: int, disks: int, seed: int, folder: Path, tell: Callable[[Row], object]
) -> Row:
    """Disturb one command and compare its results.

    Args:
        name: One of `COMMANDS`.
        kills: Number of disturbances in the work, by `WAYS` in turn.
        disks: Number of runs on a disk that becomes full.
        seed: Seed of times, sizes and numbers of workers.
        folder: Folder of inputs and results; the command's files are removed on success.
        tell: Called with the current row after each disturbance and each full disk.

    Raises:
        GraphError: The undisturbed run failed.
    """
    place = folder / name.replace(" ", "_")
    shutil.rmtree(place, ignore_errors=True)
    prepare(place / "inputs", name)
    trial = _Trial(name, place, random.Random(f"{seed} {name}"))
    try:
        trial.undisturbed()
        for index in range(kills):
            trial.hit(WAYS[index % len(WAYS)])
            tell(trial.row)
        if trial.out.exists():
            trial.end()
        for _ in range(disks):
            trial.fill()
            tell(trial.row)
    finally:
        trial.kill_all()
    if trial.row.ok:
        shutil.rmtree(place)
    return trial.row


def prepare(folder: Path, name: str) -> None:
    """Create the inputs of a command."""
    write_whole(folder / "study.yaml", yaml.safe_dump(_STUDY, sort_keys=False))
    write_whole(folder / "plan.yaml", yaml.safe_dump(_PLAN, sort_keys=False))
    if name in MAKES:
        code, output = finish(start(MAKES[name].replace("{}", str(folder)).split()))
        if code:
            raise GraphError(f"no recordings for `loco {name}`: {output[-300:]}")


def contents(folder: Path) -> dict[str, bytes]:
    """Bytes of all files except `TIMES`, by path."""
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != TIMES]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def torn(now: dict[str, bytes], whole: dict[str, bytes]) -> list[str]:
    """Incomplete files: proper prefixes of the expected files, except journals and recordings."""
    return [
        path for path, data in now.items()
        if path in whole and len(data) < len(whole[path]) and whole[path].startswith(data)
        and not path.endswith(JOURNALS) and f"{BAGS}/" not in path
    ]  # fmt: skip


class _Trial:
    """Undisturbed and disturbed runs of one command."""

    def __init__(self, name: str, place: Path, draw: random.Random):
        self.row, self._draw, self._place = Row(name), draw, place
        self._work = 0.0  # wall time from the first result to the end [s]
        self._cuts = 0  # number of runs of the current folder that were cut off
        self._whole: dict[str, bytes] = {}
        self._processes: list[subprocess.Popen] = []

    @property
    def out(self) -> Path:
        """Folder of the current results."""
        return self._place / f"run_{self.row.ends}"

    def undisturbed(self) -> None:
        """Run once undisturbed, to get its files and the duration of its work.

        Raises:
            GraphError: The run failed.
        """
        out = self._place / "whole"
        process = self._start(out)
        _wait_for_work(process, out)
        began = time.monotonic()
        code, output = finish(process)
        if code not in GOOD:
            raise GraphError(f"`loco {self.row.command}` alone ended with {code}: {output[-300:]}")
        self._work, self._whole = time.monotonic() - began, contents(out)

    def hit(self, way: str) -> None:
        """Disturb the command once; runs that complete before are compared, and repeated."""
        if not any(self.disturb(way) for _ in range(_TRIES)):
            self._note(f"{_TRIES} runs in a row were not hit by {way}")

    def disturb(self, way: str) -> bool:
        """Start the command and disturb it at a random time after its first result.

        Each time in the same folder less is left to do, so the range of times is halved.

        Returns:
            False if it completed before; its files are then compared.
        """
        process = self._start(self.out)
        _wait_for_work(process, self.out)
        began = time.monotonic()
        if not _runs(process, self._work * self._draw.random() / 2**self._cuts):
            if not self._cuts:  # a first run compiles; later ones are faster
                self._work = min(self._work, time.monotonic() - began)
            self._complete(process)
            return False
        if way == TWICE:
            self._start_second(process)
        elif way == "SIGSTOP":
            os.killpg(process.pid, signal.SIGSTOP)
            time.sleep(self._draw.uniform(*_STOPPED))
            os.killpg(process.pid, signal.SIGCONT)
            self._complete(process)
        elif not self._cut_off(process, getattr(signal, way)):
            return False
        self.row.hits[way] += 1
        return True

    def _cut_off(self, process: subprocess.Popen, number: signal.Signals) -> bool:
        """Kill or interrupt a run; False if it completed before."""
        os.killpg(process.pid, number)
        code, output = finish(process)
        if code in GOOD:
            self.compare()
            return False
        if number == signal.SIGINT and (code != INTERRUPTED or "Traceback" in output):
            self._note(f"interrupted it ended with {code}: {output[-200:]}")
        if _survivors(process.pid):
            self.row.left += 1
            self._note("processes are left")
        self._cuts += 1
        self._look_for_torn()
        return True

    def _start_second(self, process: subprocess.Popen) -> None:
        """Start the command once more beside a run of the same folder, which then completes.

        The second is refused in one line, or works beside the first, or is what goes on where the
        first is refused, as it has lost its folder.
        """
        ends = [finish(self._start(self.out)), finish(process)]
        for code, output in ends:
            if code not in (*GOOD, REFUSED) or (
                code == REFUSED and len(output.strip().splitlines()) != 1
            ):
                self._note(f"two at once: one ended with {code}: {output[-200:]}")
        if not any(code in GOOD for code, _ in ends):
            self._note(f"two at once: none came to its end: {ends[1][1][-200:]}")
        self.compare()

    def fill(self) -> None:
        """Run with disk space for a part of the results, then with enough space.

        The disk is a tmpfs if mounting is permitted; otherwise the size of each file is limited.
        """
        out = self.out
        out.mkdir()
        sizes = [len(data) for data in self._whole.values()]
        size = 4096 * self._draw.randint(2, max(3, sum(sizes) // 4096))
        mounted = _mount(f"size={size}", out)
        try:
            limit = 0 if mounted else self._draw.choice(sizes) // 2 + 1
            code, output = finish(self._start(out, limit))
            self.row.full += 1
            if "Traceback" in output or code not in (*GOOD, REFUSED):
                self._note(f"a full disk ended it with {code}: {output[-200:]}")
            self._look_for_torn()
            if mounted:
                _mount("remount,size=1G", out)
            self.end()
        finally:
            if mounted:
                subprocess.run(["umount", str(out)], check=True)

    def end(self) -> None:
        """Start the command once more, let it complete, and compare."""
        self._complete(self._start(self.out))

    def _complete(self, process: subprocess.Popen) -> None:
        code, output = finish(process)
        if code not in GOOD:
            self._note(f"it ended with {code}: {output[-200:]}")
        self.compare()

    def compare(self) -> None:
        """Compare the files of a completed run; the next run gets a new folder."""
        after = contents(self.out)
        extra = sorted(set(after) - set(self._whole))
        other = [path for path in self._whole if after.get(path) != self._whole[path]]
        self.row.left += len(extra)
        for path in extra:
            self._note(f"{path} is left")
        for path in other:
            self._note(f"{path} differs")
        self.row.ends, self._cuts = self.row.ends + 1, 0
        self.row.same += not other

    def _look_for_torn(self) -> None:
        for path in torn(contents(self.out), self._whole):
            self.row.torn += 1
            self._note(f"{path} is cut short")

    def _note(self, text: str) -> None:
        self.row.notes.append(f"run {self.row.ends}: {' '.join(text.split())}")

    def _start(self, out: Path, limit: int = 0) -> subprocess.Popen:
        arguments = COMMANDS[self.row.command].replace("{}", str(self._place / "inputs")).split()
        words = [*arguments, "--workers", str(self._draw.choice((1, 2))), "--out", str(out)]
        self._processes.append(start(words, limit))
        return self._processes[-1]

    def kill_all(self) -> None:
        """Kill the runs that are left after an error or an interrupt, with their children."""
        for process in self._processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate()


def start(words: list[str], limit: int = 0) -> subprocess.Popen:
    """Start loco in a new session; a limit above 0 is the largest file size [bytes]."""

    def limited() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # ignored where loco is in the background
        if limit:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.Popen(
        [sys.executable, "-m", "loco_bringup.cli.main", *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        start_new_session=True, preexec_fn=limited,
    )  # fmt: skip


def finish(process: subprocess.Popen, patience: float = PATIENCE) -> tuple[int, str]:
    """Exit code and output of a run, which is killed with its children after `patience` [s].

    It is also killed if this process is interrupted.
    """
    try:
        output, _ = process.communicate(timeout=patience)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if not isinstance(error, subprocess.TimeoutExpired):
            raise
        return -signal.SIGKILL, f"no end within {patience:g} s"
    return process.returncode, output


def _runs(process: subprocess.Popen, seconds: float) -> bool:
    """Whether a run still exists after a wall time [s]."""
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=seconds)
    return process.returncode is None


def _wait_for_work(process: subprocess.Popen, out: Path) -> None:
    """Wait until a run has changed the files of its results, or ended."""
    before, end = _sizes(out), time.monotonic() + PATIENCE
    while time.monotonic() < end and _runs(process, _LOOK) and _sizes(out) == before:
        pass


def _sizes(folder: Path) -> dict[str, int]:
    """Sizes of the files that are not empty [bytes], by path."""
    sizes = {}
    for path in folder.rglob("*"):
        with suppress(FileNotFoundError):  # a temporary file that was just renamed
            if path.is_file() and (size := path.stat().st_size):
                sizes[str(path)] = size
    return sizes


def _survivors(group: int, patience: float = 5.0) -> bool:
    """Whether processes of a group still exist `patience` seconds after they were killed."""
    end = time.monotonic() + patience
    with suppress(ProcessLookupError):
        while time.monotonic() < end:
            os.killpg(group, 0)
            time.sleep(0.05)
        return True
    return False


def _mount(options: str, folder: Path) -> bool:
    """Mount or remount a tmpfs; returns False if this is not permitted."""
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False
