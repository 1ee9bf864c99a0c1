# SPDX-License-Identifier: Apache-2.0
"""Long commands killed at random moments, and on a disk that gets full, then started again.

Each command runs once undisturbed. Then, in a new folder each time, it is killed with all its
processes (SIGKILL), or its disk has room for a part of the results only; it is started again, and
every file is compared byte by byte with that of the undisturbed run.
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
_RECORDS = "gap battery --cases 1 --bags-only --robots servo_pendulum --workers 1 --out"
_CASE = f"bags/{BAGS}/case_0000"
COMMANDS = {  # {} is the folder of what they read
    "optimise": "optimise tigrillo_bound --seeds 2 --evaluations 30 --duration 2 --workers 2",
    "study": "study {}/study.yaml --workers 2",
    "gap": f"gap {{}}/{_CASE}/fit_chirp {{}}/{_CASE}/fit_steps --hold-out {{}}/{_CASE}/hold_out "
    f"--robot servo_pendulum --effects {' '.join(_FRICTION)} --workers 2",
    "gap battery": "gap battery --cases 2 --robots servo_pendulum --effects "
    f"{' '.join(_FRICTION)} --baselines sparse --workers 2",
    "reproduce": "reproduce all --plan {}/plan.yaml --workers 2",
    "calibrate": "calibrate {}/bags/sine --generations 2 --seeds 2 --workers 2",
}
JOURNALS = (".jsonl", TIMES)  # files that grow line by line: their last line may be cut short
TRIES = 10  # runs per kill that may end before the kill comes
PATIENCE = 600.0  # longest run of a command [s]


@dataclass
class Row:
    """Outcome of one command.

    Attributes:
        command: Name of the command.
        kills: Runs that were killed.
        full: Runs whose disk got full.
        same: Of all of these, how many had the same files after they were started again.
        torn: Files that were cut short when the run had ended.
        left: Files and processes that were left after all.
        notes: What went wrong, a sentence each.
    """

    command: str
    kills: int = 0
    full: int = 0
    same: int = 0
    torn: int = 0
    left: int = 0
    notes: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Every run ended with the same files, and nothing was torn or left."""
        return self.same == self.kills + self.full and not (self.torn or self.left or self.notes)


def run(
    name: str, kills: int, disks: int, seed: int, folder: Path, tell: Callable[[Row], object]
) -> Row:
    """Disturb one command and compare.

    Args:
        name: One of `COMMANDS`.
        kills: Runs to kill.
        disks: Runs on a disk that gets full.
        seed: Seed of moments and sizes.
        folder: Folder of inputs and results; it is removed afterwards if all is well.
        tell: Called with the row so far after each run.

    Raises:
        GraphError: The undisturbed run failed.
    """
    place = folder / name.replace(" ", "_")
    shutil.rmtree(place, ignore_errors=True)
    prepare(place / "inputs", name)
    row, draw = Row(name), random.Random(f"{seed} {name}")
    began = time.monotonic()
    code, said = _finish(_start(name, place, "whole"))
    length = time.monotonic() - began
    if code not in (0, 3):
        raise GraphError(f"the undisturbed `loco {name}` ended with code {code}: {said[-300:]}")
    whole = contents(place / "whole")
    for number in range(kills):
        out = f"kill_{number}"
        for _ in range(TRIES):
            shutil.rmtree(place / out, ignore_errors=True)
            if _killed(name, place, out, length * draw.random(), row):
                break
        else:
            raise GraphError(f"`loco {name}` ended before it could be killed, {TRIES} times")
        row.kills += 1
        _again(name, place, out, whole, row)
        tell(row)
    for _ in range(disks):
        _full(name, place, whole, draw, row)
        tell(row)
    if row.ok:
        shutil.rmtree(place)
    return row


def prepare(folder: Path, name: str) -> None:
    """Make what a command reads."""
    write_whole(folder / "study.yaml", yaml.safe_dump(_STUDY, sort_keys=False))
    write_whole(folder / "plan.yaml", yaml.safe_dump(_PLAN, sort_keys=False))
    makes = {"gap": f"{_RECORDS} {folder}/bags", "calibrate": f"rollout tigrillo_sine --set "
             f"duration=4.5 --out {folder}/bags/sine"}  # fmt: skip
    if name in makes:
        code, said = _finish(_popen(makes[name].split()))
        if code:
            raise GraphError(f"no recordings for `loco {name}`: {said[-300:]}")


def contents(folder: Path) -> dict[str, bytes]:
    """Bytes of all files but times, by path."""
    files = [p for p in sorted(folder.rglob("*")) if p.is_file() and p.name != TIMES]
    return {str(p.relative_to(folder)): p.read_bytes() for p in files}


def torn(now: dict[str, bytes], whole: dict[str, bytes]) -> list[str]:
    """Files that are a part of what they should be; journals and recordings may be."""
    return [
        path for path, data in now.items()
        if path in whole and len(data) < len(whole[path]) and whole[path].startswith(data)
        and not path.endswith(JOURNALS) and f"{BAGS}/" not in path
    ]  # fmt: skip


def _killed(name: str, place: Path, out: str, after: float, row: Row) -> bool:
    """Kill a run after a time [s] and look at its files; False if it had ended before."""
    process = _start(name, place, out)
    try:
        process.wait(after)
        return False
    except subprocess.TimeoutExpired:
        pass
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    row.left += _survivors(process.pid)
    return True


def _full(name: str, place: Path, whole: dict[str, bytes], draw: random.Random, row: Row) -> None:
    """Run with room for a part of the results, then with enough.

    The disk is a file system in memory where one may be mounted, else each file has a limit.
    """
    out = f"full_{row.full}"
    shutil.rmtree(place / out, ignore_errors=True)
    (place / out).mkdir()
    sizes = [len(data) for data in whole.values()]
    mounted = _mount(f"size={4096 * draw.randint(2, max(3, sum(sizes) // 4096))}", place / out)
    try:
        code, said = _finish(
            _start(name, place, out, 0 if mounted else draw.choice(sizes) // 2 + 1)
        )
        row.full += 1
        lines = said.strip().splitlines()
        if "Traceback" in said or code not in (0, 1, 2, 3):
            row.notes.append(f"full disk: code {code}, {lines[-1] if lines else 'no word'}")
        if mounted:
            _mount("remount,size=1G", place / out)
        _again(name, place, out, whole, row)
    finally:
        if mounted:
            subprocess.run(["umount", str(place / out)], check=True)


def _again(name: str, place: Path, out: str, whole: dict[str, bytes], row: Row) -> None:
    """Start a disturbed run again and compare what it leaves."""
    before = contents(place / out)
    row.torn += len(cut := torn(before, whole))
    row.notes += [f"{out}: {path} is cut short" for path in cut]
    code, said = _finish(_start(name, place, out))
    if code not in (0, 3):
        row.notes.append(f"{out}: started again it ended with code {code}: {said[-200:]}")
        return
    after = contents(place / out)
    row.left += len(more := sorted(set(after) - set(whole)))
    row.notes += [f"{out}: {path} is left" for path in more]
    other = [path for path in whole if after.get(path) != whole[path]]
    row.notes += [f"{out}: {path} differs" for path in other]
    row.same += not other


def _start(name: str, place: Path, out: str, limit: int = 0) -> subprocess.Popen:
    """Start a command; `limit` is the largest size of a file [bytes], 0 for none."""
    words = [w.replace("{}", str(place / "inputs")) for w in COMMANDS[name].split()]
    return _popen([*words, "--out", str(place / out)], limit)


def _popen(words: list[str], limit: int = 0) -> subprocess.Popen:
    def limited() -> None:
        if limit:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    return subprocess.Popen(
        [sys.executable, "-m", "loco_bringup.cli.main", *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        start_new_session=True, preexec_fn=limited,
    )  # fmt: skip


def _finish(process: subprocess.Popen) -> tuple[int, str]:
    """Exit code and output of a run that is left alone."""
    try:
        said, _ = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return -signal.SIGKILL, f"no end within {PATIENCE:g} s"
    return process.returncode, said


def _survivors(group: int, patience: float = 5.0) -> int:
    """1 if processes of a group are there some seconds after they were killed."""
    end = time.monotonic() + patience
    with suppress(ProcessLookupError):
        while time.monotonic() < end:
            os.killpg(group, 0)
            time.sleep(0.05)
        return 1
    return 0


def _mount(options: str, folder: Path) -> bool:
    """Mount a file system in memory, or change one; False where that is not allowed."""
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False
