# SPDX-License-Identifier: Apache-2.0
"""Fits a body to a recording by CMA-ES, thesis eq. (5.3), one callback per generation.

The error has several minima: a knee that bends at the wrong moment may fit better than
one that does not bend. A search without further gain restarts from another body, until
its generations are spent; the thesis saw a second descent after 500 generations instead.

    calibration = Calibration(recording, "tigrillo")
    fit = calibration.run(lambda generation: ...)
    calibration.model(fit.values).save("model.yaml")

`cancel`, from the callback or another thread, ends the search and keeps the best so far.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from ..search.population import Optimum, PopulationParams, Progress, minimise
from ..search.score import Score
from .objective import Evaluation, Reference
from .parameters import ParameterSet, parameter_set
from .params import CalibrationParams
from .progress import Fit, Generation
from .recording import Recording

FAILED = 1e3  # error of a body that cannot be built or whose physics diverges


class Problem:
    """Objective of the search, on the unit cube; other processes can evaluate it.

    Args:
        reference: Recording that models are compared with.
        run: Number of earlier starts of the search.
    """

    def __init__(self, reference: Reference, run: int = 0):
        self.reference, self.run = reference, run
        self._set = parameter_set(reference.options.parameters)
        self.names = self._set.names
        self.low, self.high = np.zeros(len(self.names)), np.ones(len(self.names))
        self.start = start(self._set, reference.options.seed, run)

    def __call__(self, x: np.ndarray) -> Score:
        """Error of a body; an exception gives a failed score."""
        evaluation = self.reference.evaluate(self._set.from_unit(x))
        return Score(evaluation.error[self.reference.options.loss], extra={"fall": evaluation.fall})

    def describe(self) -> dict[str, Any]:
        """Values that identify this search, for the record of evaluations."""
        options = self.reference.options.deciding()
        signals = hashlib.sha256(self.reference.robot.periods.tobytes()).hexdigest()
        model = asdict(self.reference.base)
        return {"model": model, "options": options, "recording": signals, "run": self.run}


def start(parameters: ParameterSet, seed: int, run: int = 0) -> np.ndarray:
    """Starting point of a search, (d,): first the default body, later a random one."""
    if run == 0:
        return parameters.to_unit(parameters.default)
    return np.random.default_rng([seed, run]).uniform(0.1, 0.9, len(parameters.names))


class Calibration:
    """One calibration of a robot's model against a recording.

    Args:
        recording: Measurements of the robot.
        robot: Name of a robot or path of a ``robot.yaml`` or ``model.yaml``.
        options: Parameters to fit, and settings of the search.

    Attributes:
        reference: The recording divided into periods.
        parameters: Parameters that are fitted.
        before: The default body compared with the recording.

    Raises:
        LocoError: Unknown robot; a recording that does not fit it or has too few periods.
    """

    def __init__(
        self,
        recording: Recording,
        robot: str | Path = "tigrillo",
        options: CalibrationParams | None = None,
    ):
        self.options = options or CalibrationParams()
        self.parameters = parameter_set(self.options.parameters)
        self.reference = Reference(recording, models.load_any(robot), self.options)
        self.before: Evaluation = self.reference.evaluate(self.parameters.default)
        self._cancelled = False

    def cancel(self) -> None:
        """End the search after the current evaluation."""
        self._cancelled = True

    def model(self, values: Mapping[str, float]) -> Model:
        """Model of the robot with the given body parameters."""
        return self.reference.with_body(values)

    def run(
        self,
        on_progress: Callable[[Generation], None] | None = None,
        folder: str | Path | None = None,
        workers: int = 0,
        scheduler: str = "",
    ) -> Fit:
        """Search until the generations are spent or `cancel` is called; return the best body.

        Args:
            on_progress: Called after each generation.
            folder: Folder for the record of evaluations; an interrupted search in it is resumed.
            workers: Number of worker processes; 0 evaluates in this process.
            scheduler: Address of a dask scheduler to use instead.

        Raises:
            ParameterError: The folder has another search, or the scheduler does not respond.
        """
        course = _Course(self.parameters, on_progress)
        o, run, reason = self.options, 0, ""
        budget = o.generations * o.population
        budget = min(budget, o.evaluations) if o.evaluations else budget
        while not reason:
            place = Path(folder) / f"run_{run}" if folder else None
            search = self._search(run, budget - course.evaluations, workers, scheduler)
            optimum = minimise(
                Problem(self.reference, run),
                search,
                place,
                lambda progress: course.add(progress) or self._cancelled,
                lambda: self._cancelled,
            )
            course.end(optimum)
            run += 1
            if self._cancelled:
                reason = "cancelled"
            elif budget - course.evaluations < o.population:
                reason = f"{course.evaluations} evaluations, {run} starts"
        before = self.before.error[o.loss]
        values, error = course.values, course.best
        if not error < before:
            values, error = self.parameters.default, before
        return Fit(o.seed, values, error, before, course.history, reason)

    def _search(self, run: int, budget: int, workers: int, scheduler: str) -> PopulationParams:
        o = self.options
        return PopulationParams(
            seed=(o.seed + 1_000_003 * run) % 2**31,
            sigma=o.sigma,
            population=o.population,
            failure=FAILED,
            evaluations=max(budget, 1),
            plateau=o.patience,
            tolerance=o.gain,
            workers=workers,
            scheduler=scheduler,
        )


class _Course:
    """History of all starts, joined as one search."""

    def __init__(self, parameters: ParameterSet, on_progress: Callable[[Generation], None] | None):
        self._parameters, self._tell = parameters, on_progress
        self.history: list[Generation] = []
        self.best, self.values = float("inf"), parameters.default
        self.evaluations = 0  # evaluations of the finished starts

    def add(self, p: Progress) -> None:
        """Append a generation to the history."""
        self._better(p.best, p.x)
        generation = Generation(
            len(self.history) + 1,
            self.evaluations + p.evaluations,
            self.best,
            p.median,
            p.sigma,
            dict(self.values),
            p.failures,
            p.eta,
        )
        self.history.append(generation)
        if self._tell:
            self._tell(generation)

    def end(self, optimum: Optimum) -> None:
        """Add the result of a finished start."""
        self.evaluations += optimum.evaluations
        if optimum.evaluations:
            self._better(optimum.value, optimum.x)

    def _better(self, value: float, x: np.ndarray) -> None:
        if value < self.best:
            self.best, self.values = value, self._parameters.from_unit(x)
