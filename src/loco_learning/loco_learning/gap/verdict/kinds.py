# SPDX-License-Identifier: Apache-2.0
"""Kind of an ambiguous effect, such as friction, whose law the data do not determine."""

from __future__ import annotations

from dataclasses import dataclass

from loco_sim.effects.base import EFFECTS

from .candidates import Candidate
from .decide import AMBIGUOUS, LIMITS, Limits, Ruling, serious


@dataclass(frozen=True)
class Kind:
    """A kind of effects that is named.

    Attributes:
        kind: Kind in the registry, e.g. friction.
        places: Places where it may act.
        effects: Laws of the kind that the data cannot distinguish.
        odds: Odds against the best rival of another kind; without one, against its absence.
    """

    kind: str
    places: tuple[str, ...]
    effects: tuple[str, ...]
    odds: float


def kind_of(name: str) -> str:
    """Kind of an effect; empty if it has none, or if there is no such effect."""
    return EFFECTS[name].identity.kind if name in EFFECTS else ""


def shared(candidate: Candidate, ruling: Ruling, limits: Limits = LIMITS) -> Kind | None:
    """The common kind of all explanations of an ambiguous term; None if there is none.

    Args:
        candidate: Candidate with its rivals.
        ruling: Verdict on the candidate.
        limits: Conditions of the verdict.
    """
    names = {ruling.name, *ruling.look_alikes}
    groups = {kind_of(name) for name in names}
    if ruling.verdict != AMBIGUOUS or len(groups) > 1 or groups == {""}:
        return None
    (kind,) = groups
    alternatives = serious(candidate, limits)
    locations = {candidate.place, *(r.place for r in alternatives if r.name in ruling.look_alikes)}
    odds = [r.over.odds for r in alternatives if kind_of(r.name) != kind]
    return Kind(
        kind,
        tuple(sorted(locations | set(ruling.places))),
        tuple(sorted(names)),
        min(odds, default=candidate.gain.odds),
    )
