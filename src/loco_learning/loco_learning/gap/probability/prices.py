# SPDX-License-Identifier: Apache-2.0
"""Prices of parameters, laws at the bound of their shape, and effects too small to matter."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis

COMPARABLE = ("-", "s", "rad")  # units in which a size is comparable between robots
NEGLIGIBLE = 0.1, 0.02  # negligible share of a prior's low end, and of a two-sided one's high end
MOST_PRICE = 100.0  # largest penalty of all parameters together, as odds


def occam(a: Fitted, b: Fitted) -> float:
    """Penalty of the first model for additional parameters and unusual shapes [nat].

    ``log(n_eff) / 2`` for each parameter that the data can see, as in the Bayesian information
    criterion over all data, plus the prior penalty of shapes, both within limits.
    """
    price = 0.5 * math.log(max(min(a.score.n_eff, b.score.n_eff), 1.0))
    limit = math.log(MOST_PRICE)
    both = price * (a.paid - b.paid), a.strain - b.strain
    return sum(min(max(nat, -limit), limit) for nat in both)


def is_tiny(hypothesis: Hypothesis, x: Sequence[float], sliding: Collection[str] = ()) -> bool:
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
        threshold = NEGLIGIBLE[0] * prior.low if prior.low > 0.0 else NEGLIGIBLE[1] * prior.high
        if abs(c.value(at)) > threshold:
            return False
    return True


def on_edge(hypothesis: Hypothesis, x: Sequence[float], margin: float) -> bool:
    """True if a shape of a law is on the bound of its range, where it becomes another law.

    A spring in series with a damper of zero relaxation time is a damper; friction that decays above
    the reached velocities only is dry friction.

    Args:
        hypothesis: The law.
        x: Coordinates of the law.
        margin: Distance from a bound, relative to the value, that counts as on it.
    """
    pairs = zip(hypothesis.coordinates, x, strict=True)
    return any(on_bound(c.value(at), (c.low, c.high), margin) for c, at in pairs if not c.strength)


def on_bound(value: float, bounds: Iterable[float], margin: float) -> bool:
    """True if a value is within `margin` of a finite bound, relative to the larger of both."""
    finite = filter(math.isfinite, bounds)
    return any(abs(value - b) <= margin * max(abs(value), abs(b)) for b in finite)
