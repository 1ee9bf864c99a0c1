# SPDX-License-Identifier: Apache-2.0
"""Effects that refitted nominal values imitate: a model that needs both is not believed.

Where a nominal value and an effect do nearly the same, a fit may take the one to where no
robot has it and let the other make up for it. Such a pair is no finding: models without it
come first if they explain the data, and what is left out is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from .case import Case
from .decide import Limits
from .fit import Fitted
from .hypotheses import Hypothesis
from .identify import Identifiability
from .sensitivity import sensitivities


@dataclass(frozen=True)
class LeftOut:
    """A model that was not considered, because nominal values imitate what it adds.

    Attributes:
        model: With its nominal values.
        effects: Name and place of each effect that they imitate, with the cosine.
        values: Nominal values beyond what is plausible.
    """

    model: Fitted
    effects: tuple[tuple[str, str, float], ...]
    values: tuple[str, ...]


@dataclass(frozen=True)
class Nominal:
    """What the robot says of the values that are refitted.

    Attributes:
        values: By dotted name.
        spread: Standard deviation of their logarithm.
    """

    values: Mapping[str, float]
    spread: float

    def strained(self, model: Fitted, limits: Limits) -> tuple[str, ...]:
        """Values that a fit took beyond what is plausible."""
        most = limits.strained * self.spread
        return tuple(
            name
            for name, value in model.overrides.items()
            if abs(math.log(value / self.values[name])) > most
        )

    def traded(
        self, model: Fitted, of: Hypothesis, known: Identifiability, limits: Limits
    ) -> tuple[str, ...]:
        """Strained values from which an effect cannot be told."""
        alike = cosine(of, known)
        return self.strained(model, limits) if alike > limits.imitated else ()

    def believed(
        self,
        case: Case,
        models: Sequence[Fitted],
        limits: Limits,
        explains: Callable[[Fitted], bool],
    ) -> tuple[list[Fitted], list[LeftOut]]:
        """Models without an effect that is traded, if one of them explains the data.

        Args:
            case: Model and data.
            models: The best first.
            limits: What it takes to get a name.
            explains: Whether a model explains the data.

        Returns:
            Models to consider, all if none explains the data, and those that were left out.
        """
        kept, out = [], []
        for model in models:
            found = self._left_out(case, model, limits)
            (out if found else kept).append(found or model)
        return (kept, out) if any(map(explains, kept)) else (list(models), [])

    def _left_out(self, case: Case, model: Fitted, limits: Limits) -> LeftOut | None:
        values = self.strained(model, limits)
        if not values:
            return None
        known = sensitivities(case, model)[1]
        alike = [(h.effect, h.place, cosine(h, known)) for h, _ in model.parts]
        found = tuple(one for one in alike if one[2] > limits.imitated)
        return LeftOut(model, found, values) if found else None


def cosine(of: Hypothesis, known: Identifiability) -> float:
    """How well nominal values imitate an effect: the largest cosine of its strengths."""
    names = (f"{of.effect}.{c.label} {of.place}".strip() for c in of.coordinates if c.strength)
    return max((known.imitated.get(name, 0.0) for name in names), default=0.0)
