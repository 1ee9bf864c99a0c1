# SPDX-License-Identifier: Apache-2.0
"""Fits a body to a recording by CMA-ES, thesis eq. (5.3), one callback per generation.

    calibration = Calibration(recording, "tigrillo")
    fit = calibration.run(tell=lambda generation: ...)
    calibration.model(fit.values).save("model.yaml")

`cancel`, from the callback or another thread, ends the search with the best so far.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.params import to_dict
from loco_sim import model as models
from loco_sim.model import Model

from ..population import PopulationParams, Progress, minimise
from ..workers import Score
from .objective import Evaluation, Reference
from .parameters import ParameterSet, parameter_set
from .params import CalibrationParams
from .progress import Fit, Generation
from .recording import Recording

FAILED = 1e3  # error of a body that cannot be built or whose physics diverges


class Problem:
    """What the search minimises, in the unit cube; other processes can evaluate it.

    Args:
        reference: What models are compared with.
    """

    def __init__(self, reference: Reference):
        self.reference = reference
        self._set = parameter_set(reference.options.parameters)
        self.names = self._set.names
        self.low, self.high = np.zeros(len(self.names)), np.ones(len(self.names))
        self.start = start(self._set, reference.options.seed)

    def __call__(self, x: np.ndarray) -> Score:
        """Error of a body; what raises is a failed score."""
        found = self.reference.evaluate(self._set.from_unit(x))
        return Score(found.error[self.reference.options.loss], extra={"fall": found.fall})

    def describe(self) -> dict[str, Any]:
        """What tells this search from others, in the record of evaluations."""
        limits = ("generations", "evaluations", "patience", "gain")
        options = {k: v for k, v in to_dict(self.reference.options).items() if k not in limits}
        signals = hashlib.sha256(self.reference.robot.periods.tobytes()).hexdigest()
        return {"model": asdict(self.reference.base), "options": options, "recording": signals}


def start(chosen: ParameterSet, seed: int) -> np.ndarray:
    """Where a search begins, (d,): seed 0 at the default body, others anywhere inside."""
    if seed == 0:
        return chosen.to_unit(chosen.default)
    return np.random.default_rng(seed).uniform(0.1, 0.9, len(chosen.names))


class Calibration:
    """One calibration of a robot's model against a recording.

    Args:
        recording: What was measured.
        robot: Name of a robot or path of a ``robot.yaml`` or ``model.yaml``.
        options: What is fitted and how.

    Attributes:
        reference: The recording cut into periods.
        parameters: What is fitted.
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
        """End the search after the evaluation that is running."""
        self._cancelled = True

    def model(self, values: Mapping[str, float]) -> Model:
        """Model of the robot with a body."""
        return self.reference.with_body(values)

    def run(
        self,
        tell: Callable[[Generation], None] | None = None,
        folder: str | Path | None = None,
        workers: int = 0,
        scheduler: str = "",
    ) -> Fit:
        """Search until a limit, a plateau or `cancel`; the best body found.

        Args:
            tell: Called after each generation.
            folder: Where evaluations are recorded; one with the same search is resumed.
            workers: Processes that evaluate; 0 evaluates in this one.
            scheduler: Address of a dask scheduler to use instead.

        Raises:
            ParameterError: Another search in the folder, or nobody at the scheduler.
        """
        began, history = time.perf_counter(), []

        def report(progress: Progress) -> bool:
            history.append(self._generation(progress))
            if tell:
                tell(history[-1])
            return self._cancelled

        found = minimise(
            Problem(self.reference),
            self._search(workers, scheduler),
            folder,
            report,
            lambda: self._cancelled,
        )
        before = self.before.error[self.options.loss]
        values, error = self.parameters.default, before
        if found.evaluations and found.value < before:
            values, error = self.parameters.from_unit(found.x), found.value
        ended = "cancelled" if self._cancelled else found.ended
        seconds = time.perf_counter() - began
        return Fit(self.options.seed, values, error, before, history, ended, seconds)

    def _search(self, workers: int, scheduler: str) -> PopulationParams:
        o = self.options
        most = o.generations * o.population
        return PopulationParams(
            seed=o.seed,
            sigma=o.sigma,
            population=o.population,
            failure=FAILED,
            evaluations=min(most, o.evaluations) if o.evaluations else most,
            plateau=o.patience,
            tolerance=o.gain,
            workers=workers,
            scheduler=scheduler,
        )

    def _generation(self, p: Progress) -> Generation:
        values = self.parameters.from_unit(p.x)
        return Generation(
            p.generation, p.evaluations, p.best, p.median, p.sigma, values, p.failures, p.eta
        )
