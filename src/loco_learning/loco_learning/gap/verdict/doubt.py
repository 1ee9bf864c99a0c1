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
            {name: (nominal.nominal_value(robot, name), spread) for name, spread in group.items()}
            for group in nominal.priors(robot, model.overrides)
        ]
    known = case.loose
    rows = list(zip(known.names, known.nominal, known.spread, known.of, strict=True))
    return [
        {name: (float(at), float(spread)) for name, at, spread, of in rows if of == k}
        for k in range(len(known.at))
    ]


def columns(case: Case, model: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """Change of all residuals by one deviation of each value, (N, K); current deviations, (K,).

    Args:
        case: Model and data.
        model: Fitted model.
    """
    kept, settled = case.kept(), model.settled
    here = kept.whitened(model.specs, settled, coarse=True)
    moved, at = [], []
    for group in groups(case, model):
        if set(group) & set(model.overrides):
            continue
        now = {name: settled.get(name, nominal) for name, (nominal, _) in group.items()}
        change = {name: now[name] + spread for name, (_, spread) in group.items()}
        moved.append(_change(kept, model, change, here))
        name, (nominal, spread) = next(iter(group.items()))
        at.append((now[name] - nominal) / spread)
    return (np.stack(moved, axis=1), np.array(at)) if moved else none(identify.flat(here).size)


def none(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Result of `columns` without uncertain values, for a number of residuals."""
    return np.zeros((count, 0)), np.zeros(0)


def _change(
    kept: Case, model: Fitted, change: Mapping[str, Any], here: list[np.ndarray]
) -> np.ndarray:
    there = kept.whitened(model.specs, {**model.settled, **change}, coarse=True)
    change = identify.flat([a - b for a, b in zip(there, here, strict=True)])
    return np.clip(np.nan_to_num(change), -kept.cap, kept.cap)
