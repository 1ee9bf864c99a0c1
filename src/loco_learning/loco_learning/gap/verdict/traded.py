# SPDX-License-Identifier: Apache-2.0
"""Exclusion of models whose effects are imitated by implausible nominal values.

Where a nominal value and an effect act nearly alike, a fit may move the value out of its plausible
range and compensate this with the effect. Models without such a pair are preferred if they explain
the data, and the excluded ones are reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import bdtr, ndtr

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case
from ..prediction.loose import MOST, NEAR
from ..statistics.identify import Identifiability
from .decide import Limits
from .leftover import RARE
from .sensitivity import sensitivities

TOLD = 3  # deviating values that are listed by name


@dataclass(frozen=True)
class LeftOut:
    """A model that was excluded because nominal values imitate its effects.

    Attributes:
        model: Model with its nominal values.
        effects: Name and place of each imitated effect, with the cosine.
        values: Nominal values outside of their plausible range.
    """

    model: Fitted
    effects: tuple[tuple[str, str, float], ...]
    values: tuple[str, ...]


@dataclass(frozen=True)
class Nominal:
    """Refitted values with their nominal values in the robot.

    Attributes:
        values: Value by dotted name.
        spread: Standard deviation of their logarithm.
    """

    values: Mapping[str, float]
    spread: float

    def strained(self, model: Fitted, limits: Limits) -> tuple[str, ...]:
        """Values that a fit moved out of their plausible range."""
        limit = limits.strained * self.spread
        return tuple(
            name
            for name, value in model.overrides.items()
            if abs(math.log(value / self.values[name])) > limit
        )

    def alarms(self, model: Fitted, limits: Limits) -> tuple[str, ...]:
        """Implausible values of a model, a sentence each."""
        return tuple(
            f"{name} goes to {model.overrides[name]:.3g}, "
            f"{model.overrides[name] / self.values[name]:.3g} times what the robot says: more than "
            f"{limits.strained:g} deviations of its prior"
            for name in self.strained(model, limits)
        )

    def traded(
        self, model: Fitted, of: Hypothesis, known: Identifiability, limits: Limits
    ) -> tuple[str, ...]:
        """Implausible values that imitate an effect."""
        similarity = cosine(of, known)
        return self.strained(model, limits) if similarity > limits.imitated else ()

    def believed(
        self,
        case: Case,
        models: Sequence[Fitted],
        limits: Limits,
        explains: Callable[[Fitted], bool],
    ) -> tuple[list[Fitted], list[LeftOut]]:
        """Models whose effects are not imitated by implausible values, if one explains the data.

        Args:
            case: Model and data.
            models: Models, the best first.
            limits: Conditions for naming an effect.
            explains: Predicate: a model explains the data.

        Returns:
            Models to consider, all if none explains the data, and the excluded ones.
        """
        retained, out = [], []
        for model in models:
            excluded = self._left_out(case, model, limits)
            (out if excluded else retained).append(excluded or model)
        return (retained, out) if any(map(explains, retained)) else (list(models), [])

    def _left_out(self, case: Case, model: Fitted, limits: Limits) -> LeftOut | None:
        values = self.strained(model, limits)
        if not values:
            return None
        analysis = sensitivities(case, model)[1]
        similarities = [(h.effect, h.place, cosine(h, analysis)) for h, _ in model.parts]
        matches = tuple(one for one in similarities if one[2] > limits.imitated)
        return LeftOut(model, matches, values) if matches else None


def strayed(case: Case, model: Fitted, limits: Limits) -> tuple[str, ...]:
    """Uncertain values that were refitted out of their plausible range, a sentence each."""
    if case.loose is None:
        return ()
    crowding = crowded(case, model)
    on = _names(case, on_bounds(case, model)) if crowding else ()
    values = zip(case.loose.names, case.loose.nominal, case.loose.spread, strict=True)
    single = tuple(
        f"{name} goes from {at:.3g} to {model.loose[name]:.3g}: more than {limits.strained:g} "
        "deviations of what is known of it"
        for name, at, deviation in values
        if name not in on and abs(model.loose.get(name, at) - at) > limits.strained * deviation
    )
    return ((crowding,) if crowding else ()) + single


def crowded(case: Case, model: Fitted) -> str:
    """A sentence if more values are on their bounds than chance explains; otherwise empty.

    Each value exceeds its bound in one of eighty robots. If many do, most of them imitate what the
    model lacks.
    """
    on = on_bounds(case, model)
    count, probability = int(np.sum(on)), 2.0 * ndtr(-MOST)
    if not count or 1.0 - bdtr(count - 1, len(on), probability) >= RARE:
        return ""
    return (
        f"{count} of {len(on)} values on their bound: the model lacks something that these "
        f"imitate ({_few(_names(case, on))})"
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


def _few(names: Sequence[str]) -> str:
    """The first names, and the number of further ones."""
    suffix = [f"{len(names) - TOLD} more"] if len(names) > TOLD else []
    return ", ".join([*names[:TOLD], *suffix])


def little_off(case: Case, model: Fitted) -> list[str]:
    """Values of the robot that the fit changed noticeably, the largest deviation first."""
    if case.loose is None:
        return []
    values = zip(case.loose.names, case.loose.nominal, case.loose.spread, strict=True)
    scores = sorted(((abs(model.loose[n] - at) / s, n, at) for n, at, s in values), reverse=True)
    distant = [row for row in scores if row[0] > NEAR] or ([] if model.overrides else scores[:1])
    messages = [f"{n} ({at:.3g} to {model.loose[n]:.3g})" for _, n, at in distant[:TOLD]]
    return messages + ([f"{len(distant) - TOLD} more"] if len(distant) > TOLD else [])


def cosine(of: Hypothesis, known: Identifiability) -> float:
    """Largest cosine of an effect's strengths with the span of the nominal values."""
    names = (f"{of.effect}.{c.label} {of.place}".strip() for c in of.coordinates if c.strength)
    return max((known.imitated.get(name, 0.0) for name in names), default=0.0)
