# SPDX-License-Identifier: Apache-2.0
"""Cost of the population engine compared with a plain loop, and gain of two workers."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_learning.gaits.search import GaitProblem, GaitSearchParams
from loco_learning.search.evaluations import read
from loco_learning.search.population import PopulationParams, Score, minimise

POPULATION = 20


class Busy:
    """Test problem: a parabola whose evaluation occupies a CPU for a given time [s]."""

    names = tuple("abcdefg")
    low, high, start = np.zeros(7), np.ones(7), np.full(7, 0.5)

    def __init__(self, seconds: float = 0.0):
        self.seconds = seconds

    def describe(self) -> dict[str, Any]:
        """See `population.Problem`."""
        return {"busy": self.seconds}

    def __call__(self, x: np.ndarray) -> Score:
        """Score of parameters x, (7,)."""
        end = time.process_time() + self.seconds
        while time.process_time() < end:
            pass
        return Score(float(np.sum((x - 0.3) ** 2)))


@dataclass(frozen=True)
class BenchRow:
    """Evaluations per second of a plain loop and of the engine."""

    problem: str
    loop: float  # plain loop [1/s]
    here: float  # engine in this process, with its record on disk [1/s]
    two: float  # engine with two workers, after the first generation [1/s]

    @property
    def overhead(self) -> float:
        """Time that the engine adds to an evaluation in this process [ms]."""
        return 1e3 * (1.0 / self.here - 1.0 / self.loop)

    @property
    def efficiency(self) -> float:
        """Speed of two workers over twice the speed of the loop [-]."""
        return self.two / (2.0 * self.loop)


def bench_population(rollouts: int = 60, seconds: float = 5.0) -> list[BenchRow]:
    """Measure an evaluation without cost, one of 20 ms, and rollouts of Tigrillo.

    Args:
        rollouts: Evaluations of the last row.
        seconds: Simulated time of each [s].
    """
    walk = GaitProblem(GaitSearchParams(gait="tigrillo_walk", duration=seconds))
    return [
        measure("nothing", Busy(), 2000),
        measure("20 ms of arithmetic", Busy(0.02), 200),
        measure(f"Tigrillo walks {seconds:g} s", walk, rollouts),
    ]


def measure(name: str, problem: Any, count: int) -> BenchRow:
    """One row; all variants evaluate the same points."""
    points: list[np.ndarray] = []
    problem(np.array(problem.start))  # loads and compiles
    local_rate = _rate(problem, count, 0, points.append)
    began = time.perf_counter()
    for x in points:
        problem(x)
    loop = len(points) / (time.perf_counter() - began)
    return BenchRow(name, loop, local_rate, _rate(problem, count, 2))


def _rate(
    problem: Any, count: int, workers: int, keep: Callable[[np.ndarray], Any] | None = None
) -> float:
    """Evaluations per second after the first generation; `keep` receives their points."""
    options = PopulationParams(
        evaluations=count + POPULATION, population=POPULATION, workers=workers, sigma=0.1
    )
    began: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        optimum = minimise(problem, options, folder, lambda p: began.append(time.perf_counter()))
        elapsed = began[-1] - began[0]
        if keep:
            for row in read(folder)[1][POPULATION:]:
                keep(np.array(row["x"]))
    return (optimum.evaluations - POPULATION) / elapsed
