# SPDX-License-Identifier: Apache-2.0
"""Values of the robot that a fit moved: those that stray, crowd on bounds, or are established."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import bdtr, ndtr

from ..fitting.fit import Fitted
from ..prediction.case import Case
from ..prediction.loose import RANGE, SHIFT
from ..statistics.leftover import LIMITS
from .estimates import ALARMS

LISTED = 3  # deviating values that are listed by name


def implausible_values(model: Fitted, values: Mapping[str, float], std: float) -> tuple[str, ...]:
    """Free values that a fit moved out of their plausible range, a sentence each.

    Args:
        model: Fitted model.
        values: Nominal values of the robot by dotted name.
        std: Standard deviation of the logarithm of a value.
    """
    return tuple(
        f"{name} goes to {model.overrides[name]:.3g}, {model.overrides[name] / values[name]:.3g} "
        f"times what the robot says: more than {ALARMS.strained:g} deviations of its prior"
        for name, by in _deviations(model, values, std).items()
        if abs(by) > ALARMS.strained
    )


def penalty(model: Fitted, values: Mapping[str, float], std: float) -> float:
    """Logarithm of the prior odds against the free values of a model [nat].

    Args:
        model: Fitted model.
        values: Nominal values of the robot by dotted name.
        std: Standard deviation of the logarithm of a value.
    """
    return 0.5 * sum(by**2 for by in _deviations(model, values, std).values())


def _deviations(model: Fitted, values: Mapping[str, float], std: float) -> dict[str, float]:
    """Free values of a model in deviations of their priors, by name; arguments as of `penalty`."""
    return {n: math.log(value / values[n]) / std for n, value in model.overrides.items()}


def deviating_motion(case: Case, model: Fitted) -> tuple[str, ...]:
    """Uncertain values that were refitted out of their plausible range, a sentence each."""
    if case.loose is None:
        return ()
    crowding = crowded(case, model)
    on = _names(case, on_bounds(case, model)) if crowding else ()
    values = zip(case.loose.names, case.loose.nominal, case.loose.spread, strict=True)
    single = tuple(
        f"{name} goes from {at:.3g} to {model.loose[name]:.3g}: more than {ALARMS.strained:g} "
        "deviations of what is known of it"
        for name, at, deviation in values
        if name not in on and abs(model.loose.get(name, at) - at) > ALARMS.strained * deviation
    )
    return ((crowding,) if crowding else ()) + single


def crowded(case: Case, model: Fitted) -> str:
    """A sentence if more values are on their bounds than chance explains; otherwise empty.

    Each value exceeds its bound in one of eighty robots. If many do, most of them imitate what the
    model lacks.
    """
    on = on_bounds(case, model)
    count, probability = int(np.sum(on)), 2.0 * ndtr(-RANGE)
    if not count or 1.0 - bdtr(count - 1, len(on), probability) >= LIMITS.rare:
        return ""
    return (
        f"{count} of {len(on)} values on their bound: the model lacks something that these "
        f"imitate ({_list_names(_names(case, on))})"
    )


def on_bounds(case: Case, model: Fitted) -> np.ndarray:
    """Flags of the values that are on the bound of their range, (V,)."""
    if case.loose is None or not model.loose:
        return np.zeros(0, dtype=bool)
    return case.loose.bound(case.loose.deviations(model.loose))


def put_right(case: Case, model: Fitted) -> dict[str, Any]:
    """Refitted values of the robot that the data establish, by dotted name.

    A value on its bound imitates something else, and a change within chance is not established:
    both keep their nominal values.
    """
    uncertain = case.loose
    if uncertain is None or not model.loose:
        return model.settled
    by, score = uncertain.deviations(model.loose), model.score
    weight = [1.0 / (tau * score.scale**2) for tau in score.tau]
    stays = uncertain.bound(by)
    stays |= uncertain.idle(np.where(stays, 0.0, by), model.whole, weight)
    return {**model.overrides, **{n: model.loose[n] for n in _names(case, ~stays)}}


def _names(case: Case, flags: np.ndarray) -> list[str]:
    """Names of the flagged values, flags (V,)."""
    uncertain = case.loose
    return [name for name, k in zip(uncertain.names, uncertain.of, strict=True) if flags[k]]


def _list_names(names: Sequence[str]) -> str:
    """The first names, and the number of further ones."""
    suffix = [f"{len(names) - LISTED} more"] if len(names) > LISTED else []
    return ", ".join([*names[:LISTED], *suffix])


def little_off(case: Case, model: Fitted) -> list[str]:
    """Values of the robot that the fit changed noticeably, the largest deviation first."""
    if case.loose is None:
        return []
    values = zip(case.loose.names, case.loose.nominal, case.loose.spread, strict=True)
    scores = sorted(((abs(model.loose[n] - at) / s, n, at) for n, at, s in values), reverse=True)
    distant = [row for row in scores if row[0] > SHIFT] or ([] if model.overrides else scores[:1])
    messages = [f"{n} ({at:.3g} to {model.loose[n]:.3g})" for _, n, at in distant[:LISTED]]
    return messages + ([f"{len(distant) - LISTED} more"] if len(distant) > LISTED else [])
