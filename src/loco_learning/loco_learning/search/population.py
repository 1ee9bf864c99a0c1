# SPDX-License-Identifier: Apache-2.0
"""Minimisation by CMA-ES: one ask and tell loop, resumable, on any number of workers.

Each parameter is scaled to [0, 1] between its bounds; the search samples there, and bounds are
respected by a smooth transformation. All random draws of the search come from one generator
seeded by `seed`, and an evaluation has a seed of its own from seed, generation and index.
So the result depends neither on the number of workers nor on interruptions: a record of
evaluations (`evaluations`) is replayed through the search, which then continues.
Source: thesis eqs. 3.8 and 5.3; Hansen, The CMA Evolution Strategy: A Tutorial, 2016.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter

from ..jobs import pool
from ..jobs.kept import versions
from .cma import Search
from .evaluations import FILE, Evaluations, columns
from .score import Score, score

__all__ = ["Optimum", "PopulationParams", "Problem", "Progress", "Score", "minimise", "seed_of"]


class Problem(Protocol):
    """A function for `minimise`: callable, picklable, and with these attributes.

    If it has ``seeded = True``, it is called as ``problem(x, seed=...)``. It may have a method
    ``describe() -> dict`` with plain values that identify the problem: an optimisation is
    only resumed if the descriptions are equal.
    """

    names: tuple[str, ...]  # names of the parameters
    low: np.ndarray  # bounds in the units of each parameter, (d,)
    high: np.ndarray  # (d,)
    start: np.ndarray  # initial point of the search, (d,)

    def __call__(self, x: np.ndarray) -> Score:
        """Score of parameters x (d,)."""


@dataclass(frozen=True)
class PopulationParams(Params):
    """Settings of a search; `evaluations` and all below it may change when it is resumed."""

    seed: int = parameter(0, "seed of the search and of the evaluations", "-", 0, 2**31 - 1)
    sigma: float = parameter(0.3, "first step size, as a share of the bounds", "-", 1e-6, 1.0)
    population: int = parameter(
        0, "evaluations per generation; 0: 4 + 3 ln(number of parameters)", "-", 0, 10000
    )
    failure: float = parameter(1e6, "value of an evaluation that raises or is not finite")
    evaluations: int = parameter(2000, "stop after so many", "-", 1, 10**8)
    target: float = parameter(-math.inf, "stop when the best value is as low")
    plateau: int = parameter(
        0, "stop when the best has not improved in so many generations; 0: never", "-", 0
    )
    tolerance: float = parameter(1e-3, "what counts as improvement, relative", "-", 0.0, 1.0)
    workers: int = parameter(2, "processes; 0: none but this one", "-", 0, 1024)
    scheduler: str = parameter("", "address of a dask scheduler to use instead of processes")


@dataclass(frozen=True)
class Progress:
    """State of a search after a generation."""

    generation: int  # number of complete generations
    evaluations: int
    budget: int
    best: float
    median: float  # median value of the generation
    sigma: float  # step size in the unit box [-]
    failures: int  # number of failures in the generation
    reason: str  # reason of one failure
    rate: float  # evaluations per second since the start; nan during replay
    eta: float  # time until the budget is spent [s]; nan while unknown
    x: np.ndarray = field(repr=False)  # best point so far, (d,)


@dataclass(frozen=True)
class Optimum:
    """Result of a search."""

    x: np.ndarray  # best evaluated parameters, (d,)
    value: float
    reason: str  # reason of failure if even the best failed; otherwise empty
    extra: dict[str, Any]
    evaluations: int
    generations: int
    ended: str  # reason for the end of the search
    course: dict[str, np.ndarray] = field(repr=False)  # see `evaluations.columns`
    names: tuple[str, ...] = ()

    def named(self) -> dict[str, float]:
        """Best parameters by name."""
        return {name: float(v) for name, v in zip(self.names, self.x, strict=True)}


def seed_of(seed: int, generation: int, index: int) -> int:
    """Seed of one evaluation, independent of where and when it runs."""
    return int(np.random.SeedSequence([seed, generation, index]).generate_state(1)[0] >> 1)


def minimise(
    problem: Problem,
    options: PopulationParams | None = None,
    folder: str | Path | None = None,
    report: Callable[[Progress], Any] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Optimum:
    """Search the parameters of a problem for the lowest score.

    Args:
        problem: See `Problem`.
        options: Settings of the search.
        folder: Folder for the record of evaluations; an interrupted search in it is resumed.
        report: Called after each generation; returning True ends the search.
        stop: Called after each evaluation; returning True ends the search at once.

    Raises:
        ParameterError: Invalid bounds, another search in the folder, or no dask scheduler.
    """
    options = options or PopulationParams()
    search = Search(problem, options.seed, options.sigma, options.population)
    record = Evaluations(Path(folder) / FILE if folder else None, _header(problem, search, options))
    try:
        return _Loop(problem, options, search, record, stop or (lambda: False)).run(report)
    finally:
        record.close()


@dataclass
class _Loop:
    """Main loop over generations until a reason to end."""

    problem: Problem
    options: PopulationParams
    search: Search
    record: Evaluations
    stop: Callable[[], bool]
    jobs: pool.Jobs | None = None
    bests: list[float] = field(default_factory=list)  # value after each generation

    def run(self, report: Callable[[Progress], Any] | None) -> Optimum:
        self._started, self._replayed, reason, generation = time.perf_counter(), 0, "", 0
        try:
            while not reason:
                rows = self._evaluated(generation)
                if len(rows) < self.search.size:
                    reason = "stopped"
                    break
                converged = self.search.tell([row["value"] for row in rows])
                generation += 1
                self.bests.append(min([row["value"] for row in rows] + self.bests[-1:]))
                reason = self._reason(generation, converged)
                if report and report(self._progress(generation, rows)) is True:
                    reason = reason or "stopped"
        finally:
            if self.jobs:
                self.jobs.close()
        return self._optimum(generation, reason)

    def _evaluated(self, generation: int) -> list[dict[str, Any]]:
        """Rows of a generation; those missing in the record are evaluated, in order."""
        points, sigma = self.search.ask(), self.search.sigma
        recorded = self.record.generation(generation)
        for row, x in zip(recorded, points, strict=False):
            if row["x"] != [float(v) for v in x]:
                raise ParameterError(
                    f"generation {generation} of the record was not drawn by this search (another "
                    "version of cma or NumPy?); choose another folder"
                )
        self._replayed += len(recorded)
        seeds = [seed_of(self.options.seed, generation, i) for i in range(len(points))]
        missing = list(zip(points, seeds, strict=True))[len(recorded) :]
        pending: dict[int, Score] = {}
        for index, result in self._scores(missing):
            pending[len(recorded) + index] = result
            while (following := len(self.record.generation(generation))) in pending:
                result = pending.pop(following)
                self.record.append(generation, following, sigma, points[following], result)
            if self.stop():
                break
        return self.record.generation(generation)

    def _scores(self, missing: list[tuple[np.ndarray, int]]) -> Iterator[tuple[int, Score]]:
        """Index and score of each point and seed, in order of completion."""
        o = self.options
        if missing and self.jobs is None:
            self.jobs = pool.start(score, (self.problem, o.failure), o.workers, o.scheduler)
            self._started = time.perf_counter()
        for index, result in self.jobs.outcomes(missing) if self.jobs else ():
            lost = isinstance(result, pool.Failure)  # the process died twice
            yield index, Score(o.failure, result.reason) if lost else result

    def _reason(self, generation: int, converged: str) -> str:
        """Reason to end the search after a generation; empty to continue."""
        o, bests = self.options, self.bests
        if bests[-1] <= o.target:
            return "target reached"
        if generation * self.search.size >= o.evaluations:
            return f"{o.evaluations} evaluations done"
        if o.plateau and generation > o.plateau:
            gain = bests[-1 - o.plateau] - bests[-1]
            if gain <= o.tolerance * max(abs(bests[-1]), 1e-12):
                return f"plateau: no improvement in {o.plateau} generations"
        return f"converged ({converged})" if converged else ""

    def _progress(self, generation: int, rows: list[dict[str, Any]]) -> Progress:
        best = min(self.record.rows[: generation * self.search.size], key=_value)
        failed = [row["reason"] for row in rows if row["reason"]]
        done = generation * self.search.size
        new, elapsed = done - self._replayed, time.perf_counter() - self._started
        rate = new / elapsed if new > 0 and elapsed > 0.0 else math.nan
        return Progress(
            generation=generation,
            evaluations=done,
            budget=self.options.evaluations,
            best=best["value"],
            median=float(np.median([row["value"] for row in rows])),
            sigma=self.search.sigma,
            failures=len(failed),
            reason=failed[-1] if failed else "",
            rate=rate,
            eta=max(0.0, self.options.evaluations - done) / rate,
            x=np.array(best["x"]),
        )

    def _optimum(self, generation: int, reason: str) -> Optimum:
        rows, size = self.record.rows, self.search.size
        best = min(rows, key=_value) if rows else {"x": [], "value": math.nan}
        return Optimum(
            x=np.array(best["x"], dtype=float),
            value=best["value"],
            reason=best.get("reason", ""),
            extra=best.get("extra", {}),
            evaluations=len(rows),
            generations=generation,
            ended=reason,
            course=columns(rows, size),
            names=tuple(self.problem.names) if rows else (),
        )


def _value(row: Mapping[str, Any]) -> float:
    return row["value"]


def _header(problem: Problem, search: Search, options: PopulationParams) -> dict[str, Any]:
    """Values that identify a search; the first line of its record."""
    describe = getattr(problem, "describe", dict)
    return {
        "problem": describe(),
        "versions": versions(),
        "names": list(problem.names),
        "low": [float(v) for v in search.low],
        "high": [float(v) for v in search.high],
        "start": [float(v) for v in np.asarray(problem.start, dtype=float)],
        "seed": options.seed,
        "sigma": options.sigma,
        "population": search.size,
        "failure": options.failure,
    }
