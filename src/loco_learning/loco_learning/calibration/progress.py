# SPDX-License-Identifier: Apache-2.0
"""Progress and result of a calibration: plain data, ready for JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Generation:
    """State of the search after one generation."""

    index: int  # number of completed generations
    evaluations: int  # rollouts so far
    best: float  # smallest error so far
    median: float  # median error of the generation
    sigma: float  # step size, share of the bounds
    values: dict[str, float]  # best values so far, in the units of the parameters
    failed: int = 0  # models of the generation that could not be built or diverged
    eta: float = 0.0  # wall time until the limit [s]; nan while unknown


@dataclass(frozen=True)
class Fit:
    """Result of one search."""

    seed: int
    values: dict[str, float]
    error: float
    before: float  # error of the default body
    history: list[Generation] = field(repr=False)
    ended: str  # reason for the end

    @property
    def ratio(self) -> float:
        """Error before over error after."""
        return self.before / self.error if self.error > 0.0 else float("inf")

    @property
    def curve(self) -> np.ndarray:
        """Smallest error so far: of the default body, then after each generation, (G + 1,)."""
        return np.minimum.accumulate([self.before, *(g.best for g in self.history)])

    @property
    def plateau(self) -> int:
        """Generation at which the error has fallen by 95 % of its total decrease."""
        return plateau(self.curve.tolist())

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        rows = [{k: v for k, v in asdict(g).items() if k != "eta"} for g in self.history]
        return asdict(self) | {"ratio": self.ratio, "plateau": self.plateau, "history": rows}


def plateau(best: list[float], share: float = 0.95) -> int:
    """First index at which a falling curve has reached `share` of its total decrease."""
    curve = np.minimum.accumulate(np.asarray(best, dtype=float))
    bound = curve[0] - share * (curve[0] - curve[-1])
    return int(np.argmax(curve <= bound))


def fit_from_dict(values: dict[str, Any]) -> Fit:
    """Inverse of `Fit.to_dict`."""
    fields = {k: values[k] for k in ("seed", "values", "error", "before", "ended")}
    return Fit(**fields, history=[Generation(**g) for g in values["history"]])
