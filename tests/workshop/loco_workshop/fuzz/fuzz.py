# SPDX-License-Identifier: Apache-2.0
"""Run damaged inputs in child processes and save inputs with unexpected results.

Expected results are success and a `LocoError` of one line. A child saves each input before it
runs it, so that an input that kills the process is known too.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError, NameUnknownError

from . import mutation
from .targets import TARGETS, Target, target

LIMIT = 10  # longest CPU time of one input [s]
BATCH = 200  # number of inputs per child process if the time is limited
MANY = 2000  # the same if the number of inputs is given: less time is spent on imports
STUCK = 120.0  # wall time after which a child that began no new input is killed [s]
_CURRENT, _ROW = "current", "row"
MEMORY = 1_500_000  # largest memory growth of a child [kB]; a file may fill 1 GiB
KINDS = ("traceback", "no end", "crash", "memory")


class NoEndError(BaseException):
    """Time-out of an input; a BaseException, so that no parser catches it."""


def fuzz(
    names: list[str],
    seconds: float,
    folder: Path,
    seed: int = 0,
    count: int = 0,
    damage: str = "any",
    workers: int = 1,
) -> dict[str, dict[str, Any]]:
    """Fuzz targets with damaged inputs; returns a row of counts for each.

    Findings of earlier runs in the folder are damaged further, so the corpus grows.

    Args:
        names: Names of the targets.
        seconds: Total wall time of all targets [s]; ignored if `count` is set.
        folder: Folder of the findings, one file each in the subfolder of its target.
        seed: Seed of all damage.
        count: Total number of inputs, divided equally among the targets; 0 for no limit.
        damage: Kind of damage, one of `mutation.KINDS`.
        workers: Number of targets run in parallel, each in its own process.

    Raises:
        NameUnknownError: There is no such target or kind of damage.
    """
    for name in names:
        target(name)
    if damage not in mutation.KINDS:
        raise NameUnknownError("damage", damage, mutation.KINDS)
    share, end = -(-count // len(names)), time.monotonic() + seconds

    def one(name: str) -> tuple[str, dict[str, Any]]:
        row = {"inputs": 0, "refused": 0, **dict.fromkeys(KINDS, 0)}
        until = time.monotonic() + seconds * workers / len(names)
        batch = 0
        while row["inputs"] < share if count else not batch or time.monotonic() < min(end, until):
            size = min(MANY, share - row["inputs"]) if count else BATCH
            job = [seed, list(TARGETS).index(name), batch]
            counts = run_batch(name, job, size, folder / name, damage)
            row = {key: row[key] + counts.get(key, 0) for key in row}
            batch += 1
        return name, row

    with ThreadPoolExecutor(workers) as pool:
        return dict(pool.map(one, names))


def run_batch(
    name: str, seed: list[int], count: int, folder: Path, damage: str = "any"
) -> dict[str, int]:
    """Run one child process with many inputs; returns the counts of their results."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        job = json.dumps([name, seed, count, place, str(folder), damage])
        child = subprocess.Popen(
            [sys.executable, "-m", "loco_workshop.fuzz.fuzz", job],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        row, now, output = Path(place, _ROW), None, None
        while output is None:
            try:
                output, _ = child.communicate(timeout=STUCK)
            except subprocess.TimeoutExpired:  # a compiled loop does not handle the signal
                before, now = now, row.read_bytes() if row.is_file() else b""
                if now == before:
                    child.kill()
                    child.communicate()
                    return keep(Path(place), folder, "no end", "no end")
        if child.returncode:
            return keep(Path(place), folder, "crash", f"{child.returncode}")
        return json.loads(output.splitlines()[-1])


def keep(place: Path, folder: Path, kind: str, why: str) -> dict[str, int]:
    """Save the current input of a child; returns the child's counts including it."""
    current, row = place / _CURRENT, place / _ROW
    save(current.read_bytes() if current.is_file() else b"", folder, why)
    before = json.loads(row.read_text()) if row.is_file() else {"inputs": 0}
    return {**before, "inputs": before["inputs"] + 1, kind: before.get(kind, 0) + 1}


def save(data: bytes, folder: Path, why: str) -> None:
    """Write an input and its result to a folder, named by its hash."""
    stem = hashlib.sha256(data).hexdigest()[:16]
    (folder / f"{stem}.bin").write_bytes(data)
    (folder / f"{stem}.txt").write_text(why)


def inputs(
    chosen: Target, seed: list[int], count: int, damage: str = "any", corpus: Sequence[bytes] = ()
) -> Iterator[bytes]:
    """Damaged inputs of a target, determined by seed and corpus."""
    rng, seeds = np.random.default_rng(seed), [*chosen.seeds(), *corpus]
    for _ in range(count):
        data = seeds[int(rng.integers(len(seeds)))]
        yield mutation.damaged(data, rng, seeds, chosen.structured, damage)


def outcome(chosen: Target, data: bytes) -> tuple[str, str]:
    """Result of an input ("" for success, ``refused``, or one of `KINDS`), and details."""

    def stop(number: int, frame: Any) -> None:
        raise NoEndError

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    old = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    kind = "", ""
    try:
        with tempfile.TemporaryDirectory() as folder:
            chosen.run(data, Path(folder))
    except LocoError as error:
        kind = "refused", ""
        if "\n" in str(error):
            kind = "traceback", f"{error!r} has several lines"
    except NoEndError:
        kind = "no end", f"more than {LIMIT} s of processor time"
    except Exception:
        kind = "traceback", traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, old)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        if grown > MEMORY:
            kind = "memory", f"{grown / 1e6:.1f} GB more than before"
    return kind


def main() -> None:
    """Run a batch described by JSON on the command line, and print its counts."""
    warnings.simplefilter("ignore")
    name, seed, count, place, folder, damage = json.loads(sys.argv[1])
    selected, counts = target(name), {"inputs": 0, "refused": 0, **dict.fromkeys(KINDS, 0)}
    corpus = [path.read_bytes() for path in sorted(Path(folder).glob("*.bin"))]
    with tempfile.TemporaryDirectory() as first:  # first run: compiles, imports
        selected.run(selected.seeds()[0], Path(first))
    current, row = os.path.join(place, _CURRENT), os.path.join(place, _ROW)
    for data in inputs(selected, seed, count, damage, corpus):
        Path(row).write_text(json.dumps(counts))
        Path(current).write_bytes(data)
        kind, reason = outcome(selected, data)
        counts["inputs"] += 1
        if kind:
            counts[kind] += 1
        if kind in KINDS:
            save(data, Path(folder), reason)
    sys.stdout.write("\n" + json.dumps(counts) + "\n")


if __name__ == "__main__":
    main()
