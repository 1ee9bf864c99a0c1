# SPDX-License-Identifier: Apache-2.0
"""Score of an evaluation, in which errors of the problem become failures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError


@dataclass(frozen=True)
class Score:
    """Result of an evaluation: a small `value` is good; `reason` is set if it failed."""

    value: float
    reason: str = ""
    extra: dict[str, Any] = field(default_factory=dict)  # plain values, stored with the score


def score(problem: Callable, failure: float, x: np.ndarray, seed: int) -> Score:
    """Evaluate one point; any error becomes a failure with a reason.

    Args:
        problem: A `population.Problem`.
        failure: Value of the score of an evaluation that raises or is not finite.
        x: Parameters, (d,).
        seed: Seed of the evaluation, for a problem with ``seeded``.
    """
    try:
        result = problem(x, seed=seed) if getattr(problem, "seeded", False) else problem(x)
        if not isinstance(result, Score):
            result = Score(float(result))
    except Exception as error:  # noqa: BLE001, an evaluation may raise anything
        text = str(error) if isinstance(error, LocoError) else f"{type(error).__name__}: {error}"
        return Score(failure, text or type(error).__name__)
    if not math.isfinite(result.value):
        return Score(failure, result.reason or f"the score is {result.value}", result.extra)
    return result
