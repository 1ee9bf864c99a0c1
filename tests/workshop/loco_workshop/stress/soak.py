# SPDX-License-Identifier: Apache-2.0
"""`loco soak`: long run that checks for growth of memory, descriptors, threads and /dev/shm.

The smallest Python object takes at least 16 bytes, so a leak of one object per tick
is at least 16 MB per million ticks. `LIMIT`, one object in 16 ticks, is far below.
"""

from __future__ import annotations

import csv
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from loco_bringup.graph import run as runner
from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import override

LIMIT = 1.0  # largest growth of memory that counts as flat [MB per million ticks]
WARM_UP = 0.2  # share of the samples at the start that is ignored
BLOCKS = 10  # number of blocks of the rest, since successive samples are correlated
STUDENT = 2.306  # two-sided 95 % quantile of t with BLOCKS - 2 degrees of freedom
COUNTS = ("descriptors", "threads", "shm_files")
WRITTEN = ("events", "/diagnostics")  # recorded topics, few to save disk space
_PAGE = resource.getpagesize()
_SHM = "/dev/shm/"


@dataclass(frozen=True)
class Sample:
    """Resources of a process at a tick."""

    tick: int
    wall: float  # wall time since the start [s]
    process: str
    memory: float  # resident memory [MB]
    descriptors: int
    threads: int
    shm_files: int  # number of mapped files in /dev/shm
    shm: float  # their size [MB]


@dataclass(frozen=True)
class Verdict:
    """Growth of one resource of a process."""

    process: str
    what: str
    start: float  # value after the warm-up [MB or number]
    end: float
    slope: float  # [MB or number per million ticks]
    error: float  # half width of the 95 % interval of the slope
    says: str  # flat, grows or "not settled"


def take(pid: int, process: str, tick: int, wall: float) -> Sample | None:
    """Sample of a process; None if the process has ended."""
    proc = Path(f"/proc/{pid}")
    try:
        pages = int((proc / "statm").read_text().split()[1])
        counts = len(os.listdir(proc / "fd")), len(os.listdir(proc / "task"))
        mapped = {line[line.index(_SHM) :] for line in open(proc / "maps") if _SHM in line}
    except OSError:
        return None
    sizes = [os.stat(p).st_size for p in map(str.strip, mapped) if os.path.exists(p)]
    return Sample(tick, wall, process, pages * _PAGE / 1e6, *counts, len(mapped), sum(sizes) / 1e6)


def soak(
    experiment: Any,
    ticks: int,
    table: Path,
    layout: str = "composed",
    on_progress: Callable[[Any], Any] = lambda progress: None,
    clock: str = "lockstep",
) -> runner.Outcome:
    """Run a graph and sample its processes about once per second.

    Args:
        experiment: Experiment to run; its duration is replaced.
        ticks: Length of the run in ticks.
        table: CSV file of the samples, written immediately to keep memory constant.
        layout: ``composed`` (one process) or ``processes`` (one per node).
        on_progress: Called about ten times per second of wall time; a true return value ends the
            run.
        clock: ``lockstep``, ``asap`` or ``realtime``.

    Raises:
        ParameterError: `ticks` is below 1,000, or there is no such layout or clock.
        GraphError: A node died or never got ready, or no tick arrives.
    """
    if ticks < 1000:
        raise ParameterError(f"ticks must be at least 1000, got {ticks}")
    experiment = override(experiment, {"duration": ticks * experiment.dt})
    table.parent.mkdir(parents=True, exist_ok=True)
    began, latest = time.monotonic(), 0.0

    def look(progress: Any) -> Any:
        nonlocal latest
        if progress.sim_time > latest:
            latest = progress.sim_time
            tick, wall = round(latest / experiment.dt), time.monotonic() - began
            for name, pid in {**progress.pids, "supervisor": os.getpid()}.items():
                sample = take(pid, name, tick, wall)
                if sample:
                    writer.writerow(astuple(sample))
        return on_progress(progress)

    with (
        tempfile.TemporaryDirectory(prefix="loco_soak_") as folder,
        open(table, "w", newline="") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(f.name for f in fields(Sample))
        return runner.run_robots(
            {"": experiment}, Path(folder) / "bag", layout, clock, on_progress=look,
            written=WRITTEN, stop_on_fall=False,
        )  # fmt: skip


def read(table: Path) -> list[Sample]:
    """Samples from a CSV file written by `soak`."""
    parsers = [{"int": int, "float": float, "str": str}[f.type] for f in fields(Sample)]
    with open(table, newline="") as file:
        rows = csv.reader(file)
        next(rows, None)
        return [Sample(*(k(v) for k, v in zip(parsers, row, strict=True))) for row in rows]


def judge(samples: Iterable[Sample]) -> list[Verdict]:
    """Verdicts for the memory and each count of every process."""
    by_process: dict[str, list[Sample]] = {}
    for sample in samples:
        by_process.setdefault(sample.process, []).append(sample)
    verdicts = []
    for process, rows in by_process.items():
        rows = rows[int(WARM_UP * len(rows)) :]
        ticks = np.array([row.tick for row in rows], dtype=float)
        for what in ("memory", *COUNTS):
            values = np.array([getattr(row, what) for row in rows], dtype=float)
            verdicts.append(_verdict(process, what, ticks, values))
    return verdicts


def _verdict(process: str, what: str, ticks: np.ndarray, values: np.ndarray) -> Verdict:
    """Verdict from a straight line through the block means; a count is flat if its median stays."""
    cut = np.array_split(np.arange(len(ticks)), max(1, min(BLOCKS, len(ticks))))
    x = np.array([ticks[block].mean() for block in cut]) / 1e6
    y = np.array([values[block].mean() for block in cut])
    start, end = (float(np.median(values[block])) for block in (cut[0], cut[-1]))
    if len(cut) < BLOCKS:
        return Verdict(process, what, start, end, float("nan"), float("inf"), "not settled")
    variation = np.sum((x - x.mean()) ** 2)
    slope = float(np.sum((x - x.mean()) * (y - y.mean())) / variation)
    rest = np.sum((y - y.mean() - slope * (x - x.mean())) ** 2)
    error = float(np.sqrt(rest / (BLOCKS - 2) / variation) * STUDENT)
    low, high = slope - error, slope + error
    if what != "memory":
        trend = "grows" if end > start else "flat"
    else:
        trend = "flat" if high < LIMIT else "grows" if low > LIMIT else "not settled"
    return Verdict(process, what, start, end, slope, error, trend)
