# SPDX-License-Identifier: Apache-2.0
"""Runs damaged inputs in child processes and keeps those that are not one error of ours.

A child writes each input down before it runs it, so the one that ends the process is known, too.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError

from .mutation import damaged
from .targets import Target, target

LIMIT = 10  # processor time of one input [s]
BATCH = 200  # inputs of a child process
_CURRENT = "current"
KINDS = ("traceback", "no end", "crash")


class NoEndError(BaseException):
    """An input takes too long; no parser may catch this."""


def fuzz(
    names: list[str],
    seconds: float,
    folder: Path,
    seed: int = 0,
    on_progress: Callable[[str, dict[str, Any]], Any] = lambda name, row: None,
) -> dict[str, dict[str, Any]]:
    """Damage the inputs of targets for a while; a row of counts for each.

    Args:
        names: Names of the targets.
        seconds: Wall time for all of them together [s].
        folder: Folder that gets each find as a file in a folder of its target.
        seed: Seed of all damage.
        on_progress: Function that is called with a target and its row after each batch.

    Raises:
        NameUnknownError: There is no target of a name.
    """
    for name in names:
        target(name)
    rows = {name: {"inputs": 0, "refused": 0, **dict.fromkeys(KINDS, 0)} for name in names}
    for number, name in enumerate(names):
        end, batch = time.monotonic() + seconds / len(names), 0
        while batch == 0 or time.monotonic() < end:
            found = run_batch(name, [seed, number, batch], BATCH, folder / name)
            for key in rows[name]:
                rows[name][key] += found.get(key, 0)
            batch += 1
            on_progress(name, rows[name])
    return rows


def run_batch(name: str, seed: list[int], count: int, folder: Path) -> dict[str, int]:
    """One child process with many inputs; counts of what they did."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        job = json.dumps([name, seed, count, place, str(folder)])
        child = subprocess.Popen(
            [sys.executable, "-m", "loco_bringup.workshop.fuzz.fuzz", job],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        try:
            said, _ = child.communicate(timeout=60 + count * 2)
        except subprocess.TimeoutExpired:  # a compiled loop does not hear the signal
            child.kill()
            child.communicate()
            return {"inputs": count, "no end": keep(Path(place), folder, "no end")}
        if child.returncode:
            return {"inputs": count, "crash": keep(Path(place), folder, f"{child.returncode}")}
        return json.loads(said.splitlines()[-1])


def keep(place: Path, folder: Path, why: str) -> int:
    """Keep the input that a child was at; returns 1."""
    current = place / _CURRENT
    save(current.read_bytes() if current.is_file() else b"", folder, why)
    return 1


def save(data: bytes, folder: Path, why: str) -> None:
    """Write an input and what it did into a folder, named by its hash."""
    stem = hashlib.sha256(data).hexdigest()[:16]
    (folder / f"{stem}.bin").write_bytes(data)
    (folder / f"{stem}.txt").write_text(why)


def inputs(chosen: Target, seed: list[int], count: int) -> Iterator[bytes]:
    """Damaged inputs of a target; the same for the same seed."""
    rng, seeds = np.random.default_rng(seed), chosen.seeds()
    for _ in range(count):
        yield damaged(seeds[int(rng.integers(len(seeds)))], rng, seeds, chosen.structured)


def outcome(chosen: Target, data: bytes) -> tuple[str, str]:
    """Effect of an input: "" for a right one, ``refused``, or one of `KINDS`; and the details."""

    def stop(number: int, frame: Any) -> None:
        raise NoEndError

    old = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    try:
        with tempfile.TemporaryDirectory() as folder:
            chosen.run(data, Path(folder))
    except LocoError as error:
        return ("traceback", f"{error!r} has several lines") if "\n" in str(error) else (
            "refused", ""
        )  # fmt: skip
    except NoEndError:
        return "no end", f"more than {LIMIT} s of processor time"
    except Exception:
        return "traceback", traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, old)
    return "", ""


def main() -> None:
    """Run a batch, as JSON says, and write its counts."""
    warnings.simplefilter("ignore")
    name, seed, count, place, folder = json.loads(sys.argv[1])
    chosen, found = target(name), {"inputs": 0, "refused": 0, **dict.fromkeys(KINDS, 0)}
    current = os.path.join(place, _CURRENT)
    for data in inputs(chosen, seed, count):
        with open(current, "wb") as file:
            file.write(data)
        kind, why = outcome(chosen, data)
        found["inputs"] += 1
        if kind:
            found[kind] += 1
        if kind in KINDS:
            save(data, Path(folder), why)
    sys.stdout.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main()
