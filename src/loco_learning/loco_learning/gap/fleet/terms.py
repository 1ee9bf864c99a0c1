# SPDX-License-Identifier: Apache-2.0
"""Effects whose sizes are measured in every recording of a fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import limits
from loco_sim.effects.base import EFFECTS

from ..verdict.decide import AMBIGUOUS, NAMED, PARTLY

LOCATION_KEYS = ("joint", "link", "foot")


@dataclass(frozen=True)
class Term:
    """An effect at a place with one size; its other parameters are those that a search found.

    Attributes:
        effect: Name of the effect.
        place: Joint, link or foot, by name or pattern; empty if it has none.
        parameter: Name of the strength that is the size.
        unit: Unit of the size.
        size: Size that the search found; the norm of a vector.
        spec: Entry in the list of effects of an experiment, at that size.
        probability: Probability of the name, in that search.
    """

    effect: str
    place: str
    parameter: str
    unit: str
    size: float
    spec: dict[str, Any]
    probability: float

    @property
    def key(self) -> str:
        """Effect, place and parameter."""
        return " ".join(filter(None, (self.effect, self.place, self.parameter)))

    @property
    def group(self) -> tuple[str, str]:
        """Kind of the effect (the effect itself, if it has no kind) and its place."""
        return EFFECTS[self.effect].identity.kind or self.key, self.place

    def legal(self) -> tuple[float, float]:
        """Smallest and largest ratio to the size that the search found."""
        value = self.spec[self.parameter]
        if not np.isscalar(value):
            return -np.inf, np.inf
        low, high = sorted(end / value for end in limits(EFFECTS[self.effect], self.parameter))
        return low, high

    def at(self, ratio: float) -> dict[str, Any]:
        """The effect at a ratio to the size that the search found."""
        names = [n for n in EFFECTS[self.effect].identity.strengths if n in self.spec]
        scaled = {n: (ratio * np.asarray(self.spec[n])).tolist() for n in names}
        return {**self.spec, **scaled}


def terms_of(result: Mapping[str, Any], count: int) -> list[Term]:
    """Effects that a search found.

    Args:
        result: Contents of ``gap.json``.
        count: Number of effects of the model before the search.
    """
    if result["verdict"] not in (NAMED, PARTLY, AMBIGUOUS):
        return []
    probable = result["probability"]["effects"] if result["probability"] else {}
    return [
        _term(spec, probable.get(spec["name"], 0.0)) for spec in result["model"]["effects"][count:]
    ]


def _term(spec: Mapping[str, Any], probability: float) -> Term:
    kind, name = EFFECTS[spec["name"]], spec["name"]
    place = next((str(spec[key]) for key in LOCATION_KEYS if spec.get(key)), "")
    strengths = [n for n in kind.identity.strengths if np.any(spec.get(n, 0.0))]
    parameter = strengths[0]
    value = spec[parameter]
    size = float(value) if np.isscalar(value) else float(np.linalg.norm(value))
    unit = kind.__dataclass_fields__[parameter].metadata["unit"]
    return Term(name, place, parameter, unit, size, dict(spec), probability)


def union(results: Sequence[Sequence[Term]]) -> list[Term]:
    """Effects of several searches, each once, sorted by key; its most probable spec counts.

    Laws of one kind at one place in different robots, such as two laws of friction in a knee, are
    one effect of the fleet: those of the searches that are surest of them all together stay.

    Args:
        results: Effects of each search.
    """
    sets: dict[tuple[str, str], dict[tuple[str, ...], list[Term]]] = {}
    for terms in results:
        groups: dict[tuple[str, str], list[Term]] = {}
        for term in terms:
            groups.setdefault(term.group, []).append(term)
        for group, members in groups.items():
            keys = tuple(sorted(term.key for term in members))
            sets.setdefault(group, {}).setdefault(keys, []).extend(members)
    merged: list[Term] = []
    for laws in sets.values():

        def rank(keys: tuple[str, ...], laws: Mapping = laws) -> tuple[float, tuple[str, ...]]:
            return -sum(t.probability for t in laws[keys]) / len(keys), keys

        best = laws[min(laws, key=rank)]
        for key in sorted({term.key for term in best}):
            same = [term for term in best if term.key == key]
            merged.append(min(same, key=lambda t: (-t.probability, -abs(t.size), repr(t.spec))))
    return sorted(merged, key=lambda t: t.key)


def at_ratio(terms: Sequence[Term], ratios: Sequence[float]) -> list[dict[str, Any]]:
    """All effects at ratios to the sizes that the searches found; those of size 0 are left out."""
    return [term.at(float(x)) for term, x in zip(terms, ratios, strict=True) if x]
