# SPDX-License-Identifier: Apache-2.0
"""Probabilities of effects, kinds and places, from all models that a search fitted.

Each model has a weight (`evidence.log_weights`: Student-t likelihood, block bootstrap, price of its
effects and parameters). The probability of a statement is the sum of the weights of the models in
which it is true. Exact twins, which no recording can distinguish, share the weight of a model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from loco_control.params import Params, parameter
from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..statistics import evidence
from .prices import occam, on_edge

NO_EFFECT = "nothing"
WEIGHTS = 8  # key of a random stream
ROUNDING = 1e-9  # of a sum of probabilities


@dataclass(frozen=True)
class Criterion(Params):
    """All free numbers of the probabilities and of the verdict by them."""

    confidence: float = parameter(
        0.95, "probability from which on a statement is made: a false name costs as much as 19 "
        "abstentions", low=0.5, high=1.0
    )  # fmt: skip
    price: float = parameter(
        3.0, "logarithm of the prior odds against one additional effect: about twenty effects of "
        "the registry apply to a robot", "nat", low=0.0
    )  # fmt: skip
    closed: float = parameter(
        0.5, "share of the rms above noise that the effects of a model must close if it does not "
        "explain the data", low=0.0, high=1.0
    )  # fmt: skip
    edge: float = parameter(
        0.01, "distance from a bound, over the value, that counts as on it", low=0.0, high=0.5
    )
    trifle: float = parameter(
        3.0, "rms of the loudest channel [floors] on all records up to which a gap that something "
        "too small to matter explains is none", low=1.0
    )  # fmt: skip
    # Battery: models without a gap whose masses are off leave up to 1.42, and 1.34 elsewhere.
    unexplained: float = parameter(
        1.5, "rms of the loudest channel [floors] on all records up to which a gap that no effect "
        "explains is none", low=1.0
    )  # fmt: skip


CRITERION = Criterion()


@dataclass(frozen=True)
class Weights:
    """Models with their weights.

    Attributes:
        models: Fitted models, the largest weight first.
        values: Probability of each model, (M,); they sum to 1.
    """

    models: tuple[Fitted, ...]
    values: np.ndarray

    @property
    def best(self) -> Fitted:
        """The most probable model."""
        return self.models[0]

    @property
    def ranked(self) -> list[tuple[Fitted, float]]:
        """Models with their probabilities, the most probable first."""
        return list(zip(self.models, map(float, self.values), strict=True))

    def probability(self, holds: Callable[[Hypothesis], float]) -> float:
        """Probability that some effect of the model fulfils a condition.

        Args:
            holds: Share of an effect that fulfils it: 0 or 1, between these if it has exact twins.
        """
        shares = [1.0 - math.prod(1.0 - holds(h) for h, _ in m.parts) for m in self.models]
        return float(np.clip(np.dot(self.values, shares), 0.0, 1.0))

    def effect(self, name: str, place: str | None = None) -> float:
        """Probability of an effect, at any place or at one.

        Args:
            name: Name of the effect.
            place: Place as in `Hypothesis.place`; a law in several joints acts in each of them.
        """
        members = None if place is None else set(place.split())

        def holds(h: Hypothesis) -> float:
            acts = members is None or members <= {*locations(h), h.place}
            return share(h, name) if acts else 0.0

        return self.probability(holds)

    def kind(self, kind: str) -> float:
        """Probability of an effect of a kind, such as friction."""
        return self.probability(lambda h: float(EFFECTS[h.effect].identity.kind == kind))

    def place(self, place: str) -> float:
        """Probability of an effect at a joint, link or foot."""
        return self.probability(lambda h: float(place in {*locations(h), h.place}))

    def places_of(self, name: str) -> dict[str, float]:
        """Probability of an effect by place as in `Hypothesis.place`, the largest first.

        Args:
            name: Name of the effect.
        """
        result: dict[str, float] = {}
        for model, value in self.ranked:
            for place in {h.place for h, _ in model.parts if h.effect == name}:
                result[place] = result.get(place, 0.0) + value
        return dict(sorted(result.items(), key=lambda pair: (-pair[1], pair[0])))

    def alternatives(self, model: Fitted, index: int) -> dict[str, float]:
        """Probabilities of what is in the place of one effect of a model.

        Args:
            model: Model with the effect.
            index: Index of the effect.

        Returns:
            Probability by name, the largest first; `NO_EFFECT` for models without the effect that
            have no other one which the given model lacks.
        """
        target, present = model.parts[index][0], set(model.names)
        result: dict[str, float] = {}
        for candidate, value in self.ranked:
            if target.effect in candidate.names:
                names = (target.effect, *EFFECTS[target.effect].identity.twins)
            else:
                names = tuple(n for n in candidate.names if n not in present) or (NO_EFFECT,)
            for name in names:
                result[name] = result.get(name, 0.0) + value / len(names)
        return dict(sorted(result.items(), key=lambda pair: (-pair[1], pair[0])))

    def supported(self, confidence: float) -> Fitted:
        """The most probable model, without effects in whose place there may be nothing.

        Args:
            confidence: Probability of the set of alternatives that is considered.
        """
        model, by_key = self.best, {m.key: m for m in reversed(self.models)}
        while True:
            empty = [
                i
                for i in range(len(model.parts))
                if NO_EFFECT in smallest(self.alternatives(model, i), confidence)
            ]
            keys = [h.key for i, (h, _) in enumerate(model.parts) if i not in empty]
            smaller = by_key.get(" + ".join(sorted(keys)))
            if not empty or smaller is None:
                return model
            model = smaller


def weigh(
    models: Sequence[Fitted],
    seed: int,
    unusual: Callable[[Fitted], float] = lambda model: 0.0,
) -> Weights:
    """Weights of models on the same data.

    A law with a shape on the bound of its range is another law, which has its own model.

    Args:
        models: Fitted models, with that without effects.
        seed: Seed of the resampling.
        unusual: Logarithm of the prior odds against further values of a model [nat].
    """
    inside = [m for m in models if not any(on_edge(*part, CRITERION.edge) for part in m.parts)]
    models = sorted(inside, key=lambda m: (m.fit_rms * m.held.rms, m.key))
    first, scores = 0, [m.score for m in models]
    for _ in models:
        extra = [unusual(m) - unusual(models[first]) for m in models]
        prices = [_price(m, models[first]) + e for m, e in zip(models, extra, strict=True)]
        rng = np.random.default_rng([seed, WEIGHTS])
        logs = evidence.log_weights(scores, first, prices, rng)
        if logs.max() <= 0.0:
            break
        first = int(np.argmax(logs))
    order = np.argsort(-logs, kind="stable")
    values = np.exp(logs[order] - logs.max())
    return Weights(tuple(models[i] for i in order), values / values.sum())


def _price(a: Fitted, b: Fitted) -> float:
    """Logarithm of the prior odds against the first model [nat]: of its effects and parameters."""
    return occam(a, b) + CRITERION.price * (len(a.parts) - len(b.parts))


def smallest(probabilities: Mapping[str, float], confidence: float) -> tuple[str, ...]:
    """Names of the smallest set with a probability, in the given order.

    Args:
        probabilities: Probability by name, the largest first.
        confidence: Probability that the set has at least.
    """
    names, total = [], 0.0
    for name, probability in probabilities.items():
        if total >= confidence - ROUNDING:
            break
        names.append(name)
        total += probability
    return tuple(names)


def share(h: Hypothesis, name: str) -> float:
    """Share of an effect's weight that a name has: exact twins share it."""
    names = (h.effect, *EFFECTS[h.effect].identity.twins)
    return names.count(name) / len(names)


def locations(h: Hypothesis) -> tuple[str, ...]:
    """Joints of a law in several joints, or the place of an effect."""
    return h.joints or (h.place,)
