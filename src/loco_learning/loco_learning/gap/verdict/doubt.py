# SPDX-License-Identifier: Apache-2.0
"""Contribution of uncertain values of the robot to the intervals of strengths.

If masses, inertias and drives are slightly wrong, so are the strengths, in all records alike:
resampling the data does not show it. The sensitivity to each such value therefore enters with its
prior, about its refitted value, unless it is a free value.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..fitting.fit import Fitted
from ..prediction import nominal
from ..prediction.case import Case
from ..statistics import identify


def groups(case: Case, model: Fitted) -> list[dict[str, tuple[float, float]]]:
    """Nominal value and deviation by dotted name; one mapping per group that changes together.

    Args:
        case: Model and data.
        model: Fitted model.
    """
    if case.loose is None:
        robot = case.forward.given()
        return [
            {name: (nominal.nominal_value(robot, name), sigma) for name, sigma in group.items()}
            for group in nominal.priors(robot, model.overrides)
        ]
    values = case.loose
    rows = list(zip(values.names, values.nominal, values.spread, values.of, strict=True))
    return [
        {name: (float(at), float(sigma)) for name, at, sigma, of in rows if of == k}
        for k in range(len(values.at))
    ]


def columns(
    case: Case, model: Fitted, share: float = 1.0, coarse: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Change of all residuals per deviation of each value, (N, K); current deviations, (K,).

    Args:
        case: Model and data.
        model: Fitted model.
        share: Simulated change, in deviations.
        coarse: Whether to simulate with the larger time steps of the model.
    """
    base_case, overrides = case.kept(), model.settled
    reference = base_case.whitened(model.specs, overrides, coarse=coarse)
    moved, at = [], []
    for group in groups(case, model):
        if set(group) & set(model.overrides):
            continue
        current = {name: overrides.get(name, nominal) for name, (nominal, _) in group.items()}
        change = {name: current[name] + share * sigma for name, (_, sigma) in group.items()}
        moved.append(_change(base_case, model, change, reference, coarse) / share)
        name, (nominal, sigma) = next(iter(group.items()))
        at.append((current[name] - nominal) / sigma)
    return (np.stack(moved, axis=1), np.array(at)) if moved else none(identify.pack(reference).size)


def none(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Result of `columns` without uncertain values, for a number of residuals."""
    return np.zeros((count, 0)), np.zeros(0)


def _change(
    fixed_case: Case,
    model: Fitted,
    change: Mapping[str, Any],
    ref: list[np.ndarray],
    coarse: bool,
) -> np.ndarray:
    shifted = fixed_case.whitened(model.specs, {**model.settled, **change}, coarse=coarse)
    change = identify.pack([a - b for a, b in zip(shifted, ref, strict=True)])
    return np.clip(np.nan_to_num(change), -fixed_case.cap, fixed_case.cap)
