# SPDX-License-Identifier: Apache-2.0
"""Comparison of models: penalties of parameters, negligible effects, selection of rivals."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..statistics import evidence
from .candidates import on_bound
from .decide import Limits, has_gap

RIVAL_NAMES, RIVAL_PLACES = 4, 2  # rivals of other names, and other places of the same, per effect
COMPARABLE = ("-", "s", "rad")  # units in which a size is comparable between robots
TRIFLE = 0.1, 0.02  # negligible share of a prior's low end, and of a two-sided one's high end
MOST_PRICE = 100.0  # largest penalty of all parameters together, as odds
NO_RIVAL = 2.0  # ratio of the rms to that of an adequate model above which it is no rival


def occam(a: Fitted, b: Fitted) -> float:
    """Penalty of the first model for additional parameters and unusual shapes [nat].

    ``log(n_eff) / 2`` for each parameter that the data can see, as in the Bayesian information
    criterion over all data, plus the prior penalty of shapes, both within limits.
    """
    price = 0.5 * math.log(max(min(a.score.n_eff, b.score.n_eff), 1.0))
    limit = math.log(MOST_PRICE)
    both = price * (a.paid - b.paid), a.strain - b.strain
    return sum(min(max(nat, -limit), limit) for nat in both)


def trifle(hypothesis: Hypothesis, x: Sequence[float], sliding: Collection[str] = ()) -> bool:
    """True if all strengths are far below those of any robot with the effect.

    False in units that are not comparable: a friction in N·m is large on one robot and
    negligible on another, and so are lengths.

    Args:
        hypothesis: Effect and place.
        x: Coordinates.
        sliding: Prismatic joints, whose positions are lengths.
    """
    priors = EFFECTS[hypothesis.effect].identity.priors
    lengths = any(joint in sliding for joint in (hypothesis.place, *hypothesis.joints))
    for c, at in zip(hypothesis.coordinates, x, strict=True):
        if not c.strength:
            continue
        prior = priors.get(c.name)
        if prior is None or c.unit not in COMPARABLE or (lengths and c.unit == "rad"):
            return False
        threshold = TRIFLE[0] * prior.low if prior.low > 0.0 else TRIFLE[1] * prior.high
        if abs(c.value(at)) > threshold:
            return False
    return True


def on_edge(hypothesis: Hypothesis, x: Sequence[float], edge: float) -> bool:
    """True if a shape of a law is on the bound of its range, where it becomes another law.

    A spring in series with a damper of zero relaxation time is a damper; friction that decays above
    the reached velocities only is dry friction.

    Args:
        hypothesis: The law.
        x: Coordinates of the law.
        edge: Distance from a bound, relative to the value, that counts as on it.
    """
    pairs = zip(hypothesis.coordinates, x, strict=True)
    return any(on_bound(c.value(at), (c.low, c.high), edge) for c, at in pairs if not c.strength)


def elsewhere(model: Fitted) -> bool:
    """True if a model has a gap in some record, but none in the held-out data."""
    return any(has_gap([record]) for record in model.whole) and not has_gap(model.held.residuals)


def paid(over: evidence.Comparison, price: float) -> evidence.Comparison:
    """Evidence minus a penalty [nat]."""
    return replace(over, gain=over.gain - price, low=over.low - price, high=over.high - price)


def sharp(limits: Limits, model: Fitted) -> Limits:
    """Stricter limit on rivals if the model is at the noise floor: the noise is then known."""
    noise = evidence.rms(model.whole) <= limits.noise
    return limits.replace(worse=min(limits.worse, NO_RIVAL)) if noise else limits


def ratio(a: Fitted, b: Fitted) -> float:
    """Ratio of the rms of two models on all data, at most 1 if the first is better on held-out."""
    quotient = evidence.rms(a.whole) / evidence.rms(b.whole)
    return quotient if elsewhere(a) or a.held.rms > b.held.rms else min(quotient, 1.0)


def look_alikes(mine: Hypothesis) -> set[str]:
    """Names of the effects that are easily mistaken for a given one."""
    return {effect.name for effect in EFFECTS[mine.effect].identity.look_alikes}


def leading(screened: Sequence, mine: Hypothesis) -> list:
    """Best hypothesis of each other effect with a share, look-alikes first."""
    similar = look_alikes(mine)
    best: dict[str, object] = {}
    for s in sorted(screened, key=lambda s: (-s.share, s.hypothesis.key)):
        if not s.dead and s.share > 0.0 and s.hypothesis.effect != mine.effect:
            best.setdefault(s.hypothesis.effect, s)
    return sorted(best.values(), key=lambda s: (s.hypothesis.effect not in similar, -s.share))


def few(models: Sequence[Fitted], mine: Hypothesis, others: Sequence[str]) -> list[Fitted]:
    """Best model of each of a few other names, and of each of a few other places."""
    selected, names, unique = [], set(), set()
    for model in models:
        (other,) = [h for h, _ in model.parts if h.key not in others]
        if other.effect != mine.effect and other.effect not in names and len(names) < RIVAL_NAMES:
            names.add(other.effect)
            selected.append(model)
        elif (
            other.effect == mine.effect and other.place not in unique and len(unique) < RIVAL_PLACES
        ):
            unique.add(other.place)
            selected.append(model)
    return selected
