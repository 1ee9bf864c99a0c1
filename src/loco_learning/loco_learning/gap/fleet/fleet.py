# SPDX-License-Identifier: Apache-2.0
"""Method by which effects of a fleet are found, by robot and day, on one page.

1. Every recording is read: its motion says how informative it is.
2. The best recordings of a robot's day are simulated; the day with the largest gap is searched.
3. The sizes of all effects found in any robot are measured in every recording, alone.
4. Sizes are pooled by robot and day; each recording is verified by the sizes of the others.
5. Days that stay unexplained are searched, and all sizes are measured again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError

from ...jobs import pool
from ...jobs.base import Failure
from ...jobs.kept import Memory
from ..verdict.decide import NO_GAP
from . import tasks
from .params import COSTS
from .pooled import Pooled, pooled, unexplained
from .table import Recording, by_day, by_place, stamp
from .tasks import Excitation, Measured, SearchResult, Setting
from .terms import Term, union

Report = Callable[[float, str], Any]
FAILED = "failed"  # verdict of a search that ended with an error
SMALL = 1e-3  # share of the information of an average recording that is prior before any (taste)


@dataclass
class Fleet:
    """Recordings of a fleet with everything that was found in them.

    Attributes:
        recordings: Usable recordings; they are sorted by robot, day and file.
        skipped: Reason why a recording is left out, by file.
        excitations: Length and information of each recording, by file.
        errors: Whitened rms of the given model on the best recordings of each robot and day, the
            smaller one, and whether it is a gap.
        searches: Searches of each robot by day.
        fitted: Files that were searched.
        terms: Effects of the fleet.
        measured: Sizes in each recording, by file.
        pooled: Sizes by robot and day, and verification.
    """

    recordings: list[Recording]
    skipped: dict[str, str] = field(default_factory=dict)
    excitations: dict[str, Excitation] = field(default_factory=dict)
    errors: dict[tuple[str, str], tuple[float, bool]] = field(default_factory=dict)
    searches: dict[str, dict[str, SearchResult]] = field(default_factory=dict)
    fitted: set[str] = field(default_factory=set)
    terms: list[Term] = field(default_factory=list)
    measured: dict[str, Measured] = field(default_factory=dict)
    pooled: Pooled | None = None

    def __post_init__(self) -> None:
        self.recordings = sorted(self.recordings, key=by_place)

    @property
    def robots(self) -> list[str]:
        """Names of the robots, in order."""
        return list(dict.fromkeys(row.robot for row in self.recordings))


class _Work:
    """Jobs of a fleet in one place, with progress."""

    def __init__(self, jobs: pool.Jobs, folder: Path, fleet: Fleet, report: Report):
        self._jobs, self._folder, self._fleet, self._report = jobs, folder, fleet, report
        self.done, self.total = 0.0, 1.0

    def file(self, file: str) -> tuple:
        """A recording as an argument of a job, which differs if the file has changed."""
        path = self._folder / file
        return (str(path.absolute()), *stamp(path))

    def each(self, what: str, cost: float, jobs: dict[Any, tuple]) -> Iterator[tuple[Any, Any]]:
        """Key and result of each job, in any order; a failed one as a `Failure`."""
        keys, every = list(jobs), list(jobs.values())
        for count, (index, result) in enumerate(self._jobs.outcomes(every), start=1):
            self.done += cost
            self._report(min(self.done / self.total, 1.0), f"{what} {count} of {len(keys)}")
            yield keys[index], result


def find(
    fleet: Fleet,
    folder: Path,
    setting: Setting,
    memory: Memory,
    workers: int | str = 1,
    report: Report | None = None,
) -> Fleet:
    """Fill a fleet; the result does not depend on the place of the jobs or their order.

    Args:
        fleet: Recordings.
        folder: Folder that their files are relative to.
        setting: Arguments of all jobs.
        memory: Results of the jobs that an earlier call completed.
        workers: Number of processes, or address of a dask scheduler.
        report: Called with the completed share and the stage.

    Raises:
        ParameterError: No recording is usable.
    """
    place = pool.start(tasks.call, (setting,), *pool.where(workers))
    with memory.keeping(place) as jobs:
        work = _Work(jobs, folder, fleet, report or (lambda share, stage: None))
        _read(fleet, work)
        _evaluate(fleet, work)
        days = {robot: _loudest(fleet, robot) for robot in fleet.robots}
        for _ in range(setting.params.rounds):
            if not _search(fleet, work, days, setting):
                break
            _measure(fleet, work)
            rows, params = fleet.recordings, setting.params
            fleet.pooled = pooled(rows, fleet.measured, len(fleet.terms), params)
            done = {key for key, _ in _searches(fleet)}
            days = unexplained(rows, fleet.pooled.verified, done, params.unexplained)
    return fleet


def _read(fleet: Fleet, work: _Work) -> None:
    rows = fleet.recordings
    work.total = len(rows) * (COSTS.reading + COSTS.measurement)
    work.total += len(by_day(rows)) * COSTS.simulation + len(fleet.robots) * COSTS.search
    jobs = {row.file: (tasks.excitation, work.file(row.file)) for row in rows}
    for file, result in work.each("reading", COSTS.reading, jobs):
        _keep(fleet, fleet.excitations, file, result)
    _drop(fleet)


def _evaluate(fleet: Fleet, work: _Work) -> None:
    """Simulate the best recording of each robot and day; where it shows a gap, another one too."""
    groups = by_day(fleet.recordings)
    for rank in (0, 1):
        best = {
            key: picked[rank]
            for key, rows in groups.items()
            if (not rank or fleet.errors.get(key, (0.0, False))[1])
            and len(picked := pick(fleet, rows, rank + 1)) > rank
        }
        jobs = {key: (tasks.evaluate, work.file(row.file)) for key, row in best.items()}
        work.total += rank * len(jobs) * COSTS.simulation
        for key, result in work.each("simulating days", COSTS.simulation, jobs):
            if isinstance(result, Failure):  # a day with other recordings may still be measured
                fleet.skipped[best[key].file] = result.reason
            else:
                fleet.errors[key] = min(fleet.errors.get(key, result), result)
    _drop(fleet)


def _loudest(fleet: Fleet, robot: str) -> str:
    """Day on which the given model errs most."""
    levels = {day: rms for (name, day), (rms, _) in fleet.errors.items() if name == robot}
    return max(levels, key=lambda day: levels[day], default="")


def _search(fleet: Fleet, work: _Work, days: dict[str, str], setting: Setting) -> bool:
    """Search days of robots; False if this is not the first time and no new effect was found."""
    jobs, count, first = {}, setting.params.searched, not fleet.searches
    for robot, day in days.items():
        if not day or day in fleet.searches.setdefault(robot, {}):
            continue
        gap = any(gap for (name, _), (_, gap) in fleet.errors.items() if name == robot)
        if first and not gap:
            fleet.searches[robot][day] = SearchResult(NO_GAP, "No recording shows a gap.", {}, ())
            continue
        rows = pick(fleet, by_day(fleet.recordings)[robot, day], count)
        jobs[robot, day] = tasks.search, tuple(work.file(row.file) for row in rows)
        fleet.fitted |= {row.file for row in rows}
    if first:
        work.total += (len(jobs) - len(fleet.robots)) * COSTS.search
    else:
        work.total += len(jobs) * COSTS.search + len(fleet.recordings) * COSTS.measurement
    for (robot, day), result in work.each("searching robots", COSTS.search, jobs):
        failed = isinstance(result, Failure)
        fleet.searches[robot][day] = (
            SearchResult(FAILED, result.reason, {}, ()) if failed else result
        )
    groups = {term.group for term in fleet.terms}
    every = union([one.terms for _, one in _searches(fleet)])
    new = [term for term in every if term.group not in groups]
    fleet.terms = sorted([*fleet.terms, *new], key=lambda term: term.key)
    return first or bool(new)


def _searches(fleet: Fleet) -> Iterator[tuple[tuple[str, str], SearchResult]]:
    for robot, days in fleet.searches.items():
        yield from (((robot, day), one) for day, one in days.items())


def _measure(fleet: Fleet, work: _Work) -> None:
    jobs = {}
    for row in fleet.recordings:
        results = list(fleet.searches[row.robot].values())
        keys = {term.key for one in results for term in one.terms}
        start = tuple(float(term.key in keys) for term in fleet.terms)
        arguments = results[0].overrides if results else {}, tuple(fleet.terms), start
        jobs[row.file] = tasks.measure, work.file(row.file), *arguments
    for file, result in work.each("measuring", COSTS.measurement, jobs):
        _keep(fleet, fleet.measured, file, result)
    _drop(fleet)


def _keep(fleet: Fleet, where: dict[str, Any], file: str, result: Any) -> None:
    if isinstance(result, Failure):
        fleet.skipped[file] = result.reason
    else:
        where[file] = result


def _drop(fleet: Fleet) -> None:
    """Remove recordings that cannot be used.

    Raises:
        ParameterError: None is left, with the reason of the first.
    """
    fleet.recordings = [row for row in fleet.recordings if row.file not in fleet.skipped]
    if not fleet.recordings:
        file, reason = min(fleet.skipped.items())
        raise ParameterError(
            f"none of {len(fleet.skipped)} recordings can be used; {file}: {reason}"
        )


def pick(fleet: Fleet, rows: Sequence[Recording], count: int) -> list[Recording]:
    """Recordings that are most informative together: greedy maximum of log det (D-optimal).

    Args:
        fleet: Fleet with the information of its recordings.
        rows: Recordings to choose from, at least one.
        count: Most recordings.
    """
    grams = [fleet.excitations[row.file].information for row in rows]
    size = np.einsum("rjkk->jk", np.array(grams)) / len(grams)
    prior = np.einsum("jk,kl->jkl", SMALL * size + 1e-12, np.eye(size.shape[1]))
    picked: list[int] = []
    while len(picked) < min(count, len(rows)):
        rest = [i for i in range(len(rows)) if i not in picked]
        gains = [float(np.linalg.slogdet(prior + grams[i])[1].sum()) for i in rest]
        best = rest[int(np.argmax(gains))]
        picked.append(best)
        prior = prior + grams[best]
    return [rows[i] for i in picked]
