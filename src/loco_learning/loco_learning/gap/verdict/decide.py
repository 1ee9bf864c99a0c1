# SPDX-License-Identifier: Apache-2.0
"""The verdict: the finest statement about the cause of the gap that is probable enough."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..probability.prices import is_tiny
from ..probability.weights import CRITERION, NO_EFFECT, Weights, smallest
from ..statistics import evidence
from ..statistics.leftover import adequate, has_gap

NAMED, AMBIGUOUS, UNKNOWN, NO_GAP = "named", "ambiguous", "unknown", "no gap"
PARTLY = "named, and more is missing"
ELSEWHERE = 1.5  # ratio of the gap on all data to the held-out one: above, both are told (taste)


@dataclass(frozen=True)
class Term:
    """Verdict on one effect of the selected model.

    Attributes:
        name: Name of the effect.
        place: Place of the effect.
        verdict: `NAMED`, `AMBIGUOUS` or `UNKNOWN`.
        probability: Probability of the effect, at any place.
        look_alikes: Effects that may be in its place; empty if it is probable enough itself.
        places: Other places of the effect that cannot be excluded.
        kind: Common kind of the effect and its look-alikes; empty if there is none.
    """

    name: str
    place: str
    verdict: str
    probability: float
    look_alikes: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    kind: str = ""


@dataclass(frozen=True)
class References:
    """Models without effects, beside which a model with effects is judged.

    Attributes:
        given: The user's own model.
        base: The user's model with nominal values refitted.
        persistence: Whitened residuals of signals that keep their first value, (T, C) per record.
    """

    given: Fitted
    base: Fitted
    persistence: Sequence[np.ndarray] = ()

    @cached_property
    def held(self) -> Sequence[np.ndarray]:
        """Held-out residuals of the user's own model, or of persistence where that is better."""
        return self._better(self.given.held.residuals)

    @cached_property
    def whole(self) -> Sequence[np.ndarray]:
        """The same of the model with nominal values refitted, on all data."""
        return self._better(self.base.whole)

    def _better(self, residuals: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        return evidence.smaller(residuals, self.persistence) if self.persistence else residuals


@dataclass(frozen=True)
class Decision:
    """The verdict.

    Attributes:
        verdict: `NAMED`, `PARTLY`, `AMBIGUOUS`, `UNKNOWN` or `NO_GAP`.
        rulings: One for each effect of the selected model, in order.
        adequate: Whether the model explains the data.
        evidence: Evidence in one sentence.
    """

    verdict: str
    rulings: tuple[Term, ...]
    adequate: bool
    evidence: str

    @property
    def names(self) -> tuple[str, ...]:
        """Named effects, sorted; empty if the verdict is unknown."""
        return () if self.verdict == UNKNOWN else _names(self.rulings, NAMED)

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Groups of names among which the data cannot distinguish, each led by the selected one."""
        return _groups(self.rulings)


def decide(
    weights: Weights,
    model: Fitted,
    references: References,
    uncertain: Collection[str] = (),
    sliding: Collection[str] = (),
    levels: np.ndarray | None = None,
) -> Decision:
    """Decide on the cause of the gap.

    Args:
        weights: All models with their probabilities.
        model: The selected one.
        references: Models without effects.
        uncertain: Keys of the effects of the selected model whose sizes may be those of absence.
        sliding: Prismatic joints, whose positions are lengths.
        levels: Rms over all records [floors] up to which a channel counts as explained, (C,).
    """
    initial, base = references.given, references.base
    loudest = float(np.nanmax(evidence.by_channel(base.whole)))
    slight = f"The model is {loudest:.2f} noise floors off, which no effect tried explains."
    is_slight = loudest <= CRITERION.unexplained
    if not model.parts:
        if has_gap(base.whole) and is_slight:
            return Decision(NO_GAP, (), True, slight)
        if has_gap(base.whole):
            left = base.held.rms
            rest = (
                f"; refitted values of the robot leave {left:.3g}"
                if left < initial.held.rms
                else ""
            )
            text = f"No effect tried explains the gap of {_size(initial)}{rest}."
            return Decision(UNKNOWN, (), False, text)
        text = f"The model explains the data: {base.held.rms:.2f} noise floors."
        return Decision(NO_GAP, (), True, text)
    largely = closes(model, references)
    explains = adequate(base.whole, model.whole, levels)
    explains &= largely or adequate(model.whole, model.whole, levels)  # near the floor by itself
    if explains and _negligible(weights, loudest, sliding):
        text = (
            f"The model is {initial.held.rms:.2f} noise floors off only because it is sensitive "
            f"there: {model.names[0]} too small to matter explains it."
        )
        return Decision(NO_GAP, (), True, text)
    parts = enumerate(model.parts)
    terms = tuple(_term(weights, model, i, h.key in uncertain) for i, (h, _) in parts)
    verdict = _overall({r.verdict for r in terms}, explains, largely)
    if verdict == UNKNOWN and is_slight:
        return Decision(NO_GAP, (), True, slight)
    loud = None if explains else float(np.nanmax(evidence.by_channel(model.whole)))
    text = _summary(verdict, terms, loud, initial, model)
    persistent = evidence.rms(references.held)
    if verdict == UNKNOWN and persistent < initial.held.rms:
        text += f" With signals that keep their first value instead, {persistent:.3g} are left."
    return Decision(verdict, terms, explains, text)


def closes(model: Fitted, references: References) -> bool:
    """True if a model closes so much of the gap that its effects may be named beside others.

    A given model that falls or diverges makes any gap large, of which whatever rests closes most:
    no prediction counts as worse than persistence.

    Args:
        model: Model with effects.
        references: Models without effects.
    """
    pairs = (references.whole, model.whole), (references.held, model.held.residuals)
    return all(evidence.closed_by(*pair) >= CRITERION.closed for pair in pairs)


def _term(weights: Weights, model: Fitted, index: int, is_uncertain: bool) -> Term:
    """Verdict on one effect of a model."""
    h, confidence = model.parts[index][0], CRITERION.confidence
    names = smallest(weights.alternatives(model, index), confidence)
    options = tuple(sorted(set(names) - {h.effect, NO_EFFECT}))
    is_absent = is_uncertain or NO_EFFECT in names
    verdict = UNKNOWN if is_absent else AMBIGUOUS if len(names) > 1 else NAMED
    types = {EFFECTS[name].identity.kind for name in (h.effect, *options)}
    shared = next(iter(types)) if len(types) == 1 and verdict == AMBIGUOUS else ""
    place_weights = weights.places_of(h.effect)
    total = sum(place_weights.values())
    where = smallest({p: v / total for p, v in place_weights.items()}, confidence) if total else ()
    return Term(
        h.effect, h.place, verdict, weights.effect(h.effect), options,
        tuple(p for p in where if p != h.place), shared,
    )  # fmt: skip


def _overall(verdicts: Collection[str], explains: bool, closes: bool) -> str:
    """Verdict on a model from those on its effects.

    Args:
        verdicts: Verdicts on its effects, each once.
        explains: Whether the model explains the data.
        closes: Whether the model closes a large share of the gap.
    """
    if UNKNOWN in verdicts or not (explains or closes):
        return UNKNOWN
    if AMBIGUOUS in verdicts:
        return AMBIGUOUS
    return NAMED if explains else PARTLY


def _negligible(weights: Weights, loudest: float, sliding: Collection[str]) -> bool:
    """True if a small gap may be due to effects that are too small to matter on any robot.

    `loudest` is the largest rms of a channel without effects [floors].
    """
    if loudest > CRITERION.trifle:
        return False
    small = [
        bool(m.parts) and all(is_tiny(*part, sliding) for part in m.parts) for m in weights.models
    ]
    return bool(weights.values[small].sum() > 1.0 - CRITERION.confidence)


def _names(terms: Sequence[Term], verdict: str) -> tuple[str, ...]:
    return tuple(sorted({r.name for r in terms if r.verdict == verdict}))


def _groups(terms: Sequence[Term]) -> tuple[tuple[str, ...], ...]:
    ambiguous = [r for r in terms if r.verdict == AMBIGUOUS]
    groups = {frozenset({r.name, *r.look_alikes}): r.name for r in reversed(ambiguous)}
    return tuple(sorted((name, *sorted(group - {name})) for group, name in groups.items()))


def _summary(
    verdict: str, terms: Sequence[Term], loud: float | None, initial: Fitted, model: Fitted
) -> str:
    """Sentence on the verdict; `loud` is the largest unexplained rms of a channel [floors]."""
    before, after = initial.held.rms, model.held.rms
    closed = evidence.closed_by(initial.held.residuals, model.held.residuals)
    names = " and ".join(_names(terms, NAMED))
    groups = ["{" + ", ".join(group) + "}" for group in _groups(terms)]
    gap = f"the gap falls from {before:.3g} to {after:.3g} noise floors ({closed:.0%} closed)"
    rest = "" if loud is None else f"; more is missing: {loud:.3g} are left where most is"
    if verdict in (NAMED, PARTLY):
        return f"With {names} {gap}{rest}."
    if verdict == AMBIGUOUS:
        return f"The data cannot tell {'; '.join(groups)} apart; {gap}{rest}."
    unknown = " and ".join(_names(terms, UNKNOWN))
    if loud is None and names and unknown:
        return f"With {names} {gap}, but only beside {unknown}, which the data do not establish."
    if not after < before:
        return f"No effect tried explains the gap of {_size(initial)}, or lowers it."
    best = " and ".join(filter(None, [names, *groups]))
    part = f"{best} would close part of it, to" if best else "the best try leaves"
    return f"No effect tried explains the gap of {_size(initial)}; {part} {after:.3g}."


def _size(model: Fitted) -> str:
    """Gap of a model on held-out data, and on all where most of it is in what was fitted."""
    held, every = model.held.rms, evidence.rms(model.whole)
    where = f" on held-out data ({every:.3g} on all)" if every > ELSEWHERE * held else ""
    return f"{held:.3g} noise floors{where}"
