# SPDX-License-Identifier: Apache-2.0
"""One evaluation of a problem: nothing it does ends the optimisation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError


@dataclass(frozen=True)
class Score:
    """Result of an evaluation: a small `value` is good, a `reason` says that it failed."""

    value: float
    reason: str = ""
    extra: dict[str, Any] = field(default_factory=dict)  # plain values, kept with the score


def score(problem: Callable, failure: float, x: np.ndarray, seed: int) -> Score:
    """Evaluate one point; whatever goes wrong becomes a failure with a reason.

    Args:
        problem: A `population.Problem`.
        failure: Value of the score of an evaluation that raises or is not finite.
        x: Parameters, (d,).
        seed: Seed of the evaluation, for a problem that is ``seeded``.
    """
    try:
        result = problem(x, seed=seed) if getattr(problem, "seeded", False) else problem(x)
        if not isinstance(result, Score):
            result = Score(float(result))
    except Exception as error:  # noqa: BLE001, an evaluation may do anything
        text = str(error) if isinstance(error, LocoError) else f"{type(error).__name__}: {error}"
        return Score(failure, text or type(error).__name__)
    if not math.isfinite(result.value):
        return Score(failure, result.reason or f"the score is {result.value}", result.extra)
    return result
