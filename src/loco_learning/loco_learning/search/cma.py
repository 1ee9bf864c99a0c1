# SPDX-License-Identifier: Apache-2.0
"""CMA-ES between bounds, with an ask and tell interface for `population`.

Source: thesis eq. 3.8; Hansen, The CMA Evolution Strategy: A Tutorial, 2016; package cma.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError


class Search:
    """CMA-ES in the unit box, with scaling to the parameters.

    Args:
        problem: Object with names, low, high and start; see `population.Problem`.
        seed: Seed of all random draws; NumPy's global generator is not used.
        sigma: Initial step size in the unit box.
        population: Points per generation; 0 for the rule of CMA-ES.

    Attributes:
        size: Points per generation.
        sigma: Current step size.

    Raises:
        ParameterError: Names, bounds and start are inconsistent.
    """

    def __init__(self, problem: Any, seed: int, sigma: float, population: int):
        import cma

        self.low, self.high, start = checked(problem)
        rng = np.random.default_rng(np.random.SeedSequence([seed]))
        settings = {
            "bounds": [0.0, 1.0],
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": math.nan,
            "maxiter": math.inf,
            "tolflatfitness": 100,  # generations full of failures do not end the search
            "signals_filename": None,
            "verbose": -10,
            "verb_log": 0,
        }
        if population:
            settings["popsize"] = population
        first = (start - self.low) / (self.high - self.low)
        with warnings.catch_warnings():  # cma warns about its own defaults
            warnings.simplefilter("ignore")
            self.cma = cma.CMAEvolutionStrategy(first, sigma, settings)
        self.size, self.sigma = int(self.cma.popsize), float(self.cma.sigma)

    def ask(self) -> list[np.ndarray]:
        """Points of a generation in the units of the parameters, each (d,)."""
        self._asked = self.cma.ask()
        return [self.low + np.asarray(u) * (self.high - self.low) for u in self._asked]

    def tell(self, values: list[float]) -> str:
        """Pass the values of the last points; returns the reason if the search has converged."""
        self.cma.tell(self._asked, values)
        self.sigma = float(self.cma.sigma)
        return ", ".join(self.cma.stop())


def checked(problem: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds and start of a problem, (d,) each, after checks."""
    arrays = [np.array(getattr(problem, key), dtype=float) for key in ("low", "high", "start")]
    low, high, start = arrays
    count = len(problem.names)
    if count < 2 or any(array.shape != (count,) for array in arrays):
        shapes = [array.shape for array in arrays]
        raise ParameterError(
            f"a problem needs 2 or more names, with bounds and start for each; got {count} names "
            f"and shapes {shapes}"
        )
    for name, a, b, c in zip(problem.names, low, high, start, strict=True):
        if not (math.isfinite(a) and math.isfinite(b) and a < b):
            raise ParameterError(f"bounds of {name} must be finite and low < high, got {a}, {b}")
        if not a <= c <= b:
            raise ParameterError(f"start of {name} must be in its bounds [{a:g}, {b:g}], got {c:g}")
    return low, high, start
