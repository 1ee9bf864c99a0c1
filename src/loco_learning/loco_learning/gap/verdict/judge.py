# SPDX-License-Identifier: Apache-2.0
"""Judgement of a search's result: more models until the most probable one has been challenged.

A model is challenged by the same model without each of its effects, with others in their place, and
with fewer joints in its families. All models with a probability worth mentioning are fitted to
convergence, with a correction of their own step error. The verdict follows from the probabilities
of all models (`decide`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fitting.fit import Fitted, Parts, fit, refit_model
from ..fitting.search import AT_JUMPS, Pool, Search
from ..fitting.seen import finalize
from ..hypotheses.families import restrict
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case
from ..prediction.channels import slides
from ..probability.prices import on_edge
from ..probability.weights import CRITERION, Weights, weigh
from ..statistics import identify
from ..statistics.leftover import has_gap
from . import stable, traded
from .decide import NAMED, NO_GAP, PARTLY, UNKNOWN, Decision, References, closes, decide
from .estimates import Estimate, absent, alarms
from .gauss_newton import gauss_newton
from .rivals import RIVAL_NAMES, leading, look_alike_names, select
from .sensitivity import sensitivities

Progress = Callable[[float], Any]

MAX_DEVIATION = 1.0  # deviation of a robot value above which sensitivities are recomputed (taste)
LEADING = 4  # models that are fitted to convergence in any case
MIN_PROBABILITY = 0.01  # probability above which a model is fitted to convergence
N_SIMPLER = 4  # effects to which another is added in place of one with more parameters (taste)
N_LOOK_ALIKES = 2  # look-alikes that are fitted in any case, if not fitted yet
ROUNDS = 3  # models that are challenged at most (taste)
UNNAMED = 1  # the same while the most probable one leaves too much to be named (taste)
LOWER = {NAMED: PARTLY, PARTLY: UNKNOWN}  # verdict if values of the robot imitate what is missing
FIRST, LATER, SETTINGS = 0.1, 0.4, 0.9  # completed shares, see `Judgement.span` (9 benches)
LITTLE_BESIDE = 0.1  # size over the largest of a family below which a joint is left out (taste)
LESS, NEARLY = 0.4, 1.5  # the same for sizes within 1.5 half intervals of 0 (taste)


@dataclass(frozen=True)
class Outcome:
    """A decision with its evidence.

    Attributes:
        decision: The verdict.
        given: The user's own model: "before".
        base: The user's model with nominal values refitted: the reference for effects.
        best: The selected model.
        weights: All models with their probabilities.
        estimates: Parameters of each effect of the selected model, by key of the hypothesis.
        without: The selected model without each of its effects, in order.
        identifiability: Analysis of the selected model's parameters; None without any.
        alarms: Implausible parameters and values, a sentence each.
        over_settings: Answers under other splits, stretches and floors, if an effect was named.
        asked: Whether the user declared values of the robot as free or uncertain.
    """

    decision: Decision
    given: Fitted
    base: Fitted
    best: Fitted
    weights: Weights
    estimates: Mapping[str, tuple[Estimate, ...]]
    without: tuple[Fitted, ...]
    identifiability: identify.Identifiability | None
    alarms: tuple[str, ...] = ()
    over_settings: tuple[stable.Row, ...] = ()
    asked: bool = False

    @property
    def after(self) -> Fitted:
        """The model after the search: with effects if the verdict names them or a few alternatives.

        With an unknown cause, refitted values of the robot are no improvement, unless declared.
        """
        if self.decision.verdict == UNKNOWN:
            return self.base if self.asked else self.given
        if self.decision.verdict == NO_GAP:
            fine = not self.asked and not has_gap(self.given.whole)
            return self.given if fine else self.base
        return self.best

    @property
    def probability(self) -> float:
        """Probability of the selected model."""
        return next((p for m, p in self.weights.ranked if m.key == self.best.key), 0.0)

    @property
    def rivals(self) -> list[tuple[Fitted, float]]:
        """Other models with effects and their probabilities, the most probable first."""
        return [(m, p) for m, p in self.weights.ranked if m.parts and m.key != self.best.key]


def judge(
    case: Case, search: Search, pool: Pool, progress: Progress = lambda share: None
) -> Outcome:
    """Judge the result of a search.

    Args:
        case: Model and data.
        search: Settings and processes.
        pool: Result of the search.
        progress: Called with the completed share.
    """
    judgement = Judgement(case, search, pool, progress)
    result = judgement.result()
    progress(SETTINGS)
    decision, after = result.decision, result.after
    if decision.verdict in (NAMED, PARTLY):
        options = [m for m, _ in result.rivals]
        table = stable.rows(search, result.best, result.base, options, search.params.seed)
        result = replace(result, over_settings=tuple(table))
    refitted = [*search.nominal, *traded.little_off(case, result.base)]
    gap = has_gap(pool.given.whole)
    if refitted and gap and decision.verdict == NO_GAP and search.adequate(result.base):
        text = (
            f"The model is a little off. With {', '.join(refitted)} refitted it explains the data: "
            f"{pool.given.held.rms:.2f} noise floors before, {result.base.held.rms:.2f} after."
        )
        decision = replace(decision, evidence=text)
    crowding = traded.crowded(case, after)
    if crowding and decision.verdict in LOWER:
        text = f"{decision.evidence} More is missing: {crowding}."
        decision = replace(decision, verdict=LOWER[decision.verdict], evidence=text)
    warnings = (
        *(
            alarm
            for h, _ in after.parts
            for alarm in alarms(f"{h.effect} {h.place}".strip(), result.estimates[h.key])
        ),
        *traded.implausible_values(after, search.nominal, search.params.free_spread),
        *traded.deviating_motion(case, after),
        *stable.alarms(result.over_settings),
        *(stable.unlike(case.records, after) if decision.verdict == UNKNOWN else ()),
    )
    return replace(result, decision=decision, alarms=warnings)


class Judgement:
    """Fits of the models that the verdict needs.

    Args:
        case: Model and data.
        search: Settings and processes.
        pool: Result of the search.
        progress: Called with the completed share.
    """

    def __init__(
        self, case: Case, search: Search, pool: Pool, progress: Progress = lambda share: None
    ):
        self.case, self.search, self.found, self.progress = case, search, pool, progress
        self.fits = {m.key: m for m in reversed([pool.base, *pool.models])}
        self.converged: set[str] = {pool.base.key}
        self.replaced: set[str] = set()  # keys of models on a bound, for which others were fitted
        self.lost: dict[str, tuple[Fitted, ...]] = {}  # models without each effect, by key
        self.about: list[dict] | None = None
        self.known: dict[str, tuple[Fitted, tuple]] = {}  # sensitivities of models, by key

    @cached_property
    def references(self) -> References:
        """Models without effects, beside which others are judged."""
        return References(self.found.given, self.found.base, self.case.persistence())

    def result(self) -> Outcome:
        """The decision on the most probable model."""
        weights = self.weights()
        model, estimates, analysis, uncertain = self._selected(weights)
        base, initial = self.found.base, self.found.given
        size = np.nanstd(np.concatenate(self.case.forward.measured), axis=0) / self.case.floor
        sliding, levels = slides(self.case.forward.channels), self.search.params.accuracy * size
        decision = decide(weights, model, self.references, uncertain, sliding, levels)
        without = tuple(self.fits[m.key] for m in self.lost.get(model.key, ()))
        evidence = weights, estimates, without, analysis
        return Outcome(decision, initial, base, model, *evidence, asked=self.search.asked)

    def weights(self) -> Weights:
        """Probabilities of all models, once the most probable ones have been challenged."""
        first = {len(m.parts): m for m in reversed(self.found.models)}.values()
        self._finish([*self.found.models[:LEADING], *first])
        self.progress(self.span[0])
        while True:
            weights = self._converged()
            models = weights.best, weights.supported(CRITERION.confidence)
            if self.search.adequate(models[1]):
                models = models[1:]  # what may be nothing beside it need not be challenged
            new = [m for m in models if m.parts and m.key not in self.lost]
            if not new or len(self.lost) >= (ROUNDS if self._nameable(new[0]) else UNNAMED):
                return weights
            self._challenge(new[0])

    def _nameable(self, model: Fitted) -> bool:
        """True if effects of a model can be named, because it explains the data or much of them."""
        aims = self.search.params.accuracy > 0.0 or self.search.adequate(model)
        return aims or closes(model, self.references)

    def _converged(self) -> Weights:
        """Probabilities of all models; those worth mentioning are fitted to convergence first."""
        while True:
            self._leave_bounds()
            weights = weigh([*self.fits.values()], self.search.params.seed, self._unusual)
            if not self._finish([m for m, value in weights.ranked if value > MIN_PROBABILITY]):
                return weights

    def _leave_bounds(self) -> None:
        """Fit what the best models equal that have a shape on the bound of its range.

        At a bound a law is another one or none, and has no weight; the model that it equals may not
        be known, as fits of nonlinear shapes depend on where they start.
        """
        while True:
            models = [m for m in self.fits.values() if m.key not in self.replaced]
            model = min(models, key=lambda m: (self.search.energy(m), m.key))
            bounded = [i for i, part in enumerate(model.parts) if on_edge(*part, CRITERION.edge)]
            if not bounded:
                return
            self.replaced.add(model.key)
            variants = [parts for i in bounded for parts in self._equal(model, i)]
            tasks = [(parts, self.search.setting) for parts in variants if parts]
            self._put(self._anew(list(self.search.each(fit, tasks))))

    def _equal(self, model: Fitted, index: int) -> list[tuple]:
        """Parts of a model without one effect, alone and with each of its look-alikes there."""
        h, rest = model.parts[index][0], _parts_without(model, index)
        present = {other.key for other, _ in rest}
        alike = [
            (s.hypothesis, s.x)
            for s in self.found.screened
            if s.hypothesis.effect in look_alike_names(h) and s.hypothesis.place == h.place
        ]
        return [rest, *((*rest, part) for part in alike if part[0].key not in present)]

    def _unusual(self, model: Fitted) -> float:
        """Prior penalty of the free values of the robot [nat]."""
        return traded.penalty(model, self.search.nominal, self.search.params.free_spread)

    def _selected(
        self, weights: Weights
    ) -> tuple[Fitted, Mapping[str, tuple], identify.Identifiability | None, set[str]]:
        """The most probable model whose effects are all established.

        One effect goes at a time, the least probable first, and the others are fitted without it:
        a size may have a wide interval only because another one, of no size, imitates it.

        Returns:
            The model, its parameters and their analysis, and the keys of the effects whose sizes
            may be those of absence.
        """
        model = weights.supported(CRITERION.confidence)
        while True:
            estimates, analysis = self._sensitivities(model)
            uncertain = {key for key, each in estimates.items() if absent(each)}
            doubtful = [h for h, _ in model.parts if h.key in uncertain]
            if not doubtful or len(model.parts) == 1:
                model = gauss_newton(self.case, model)
                return model, *self._sensitivities(model), uncertain
            least = min(doubtful, key=lambda h: (weights.effect(h.effect, h.place), h.key))
            parts = [part for part in model.parts if part[0] is not least]
            smaller = self.fits.get(" + ".join(sorted(h.key for h, _ in parts)))
            model = smaller or self._put([self._fitted(parts)])[0]

    def _challenge(self, model: Fitted) -> None:
        """Fit a model without each of its effects, with others instead, and with fewer joints."""
        (begin, end), count = self.span, len(model.parts)
        self.about = model.specs if self._off(model) else None
        (model,) = self._put(self._anew([model]))
        self._finish([model])
        model = self.fits[model.key]
        without = self._put(self._without(model, i) for i in range(len(model.parts)))
        self.lost[model.key] = tuple(without)
        variants = []
        for i, each in enumerate(without):
            variants += self._swaps(model, i, each)
            self.progress(begin + 0.5 * (end - begin) * (i + 1) / count)
        variants += self._narrowed(model) + self._pairs(model)
        self._finish([*without, *self._put(variants)])
        self.progress(end)

    @property
    def span(self) -> tuple[float, float]:
        """Completed shares before and after the next challenge, each shorter than the one before.

        How many follow is not known: models are fitted already, and most are challenged once.
        """
        return tuple(
            SETTINGS - (SETTINGS - FIRST) * LATER ** (len(self.lost) + k) for k in range(2)
        )

    def _narrowed(self, model: Fitted) -> list[Fitted]:
        """The model without the idle joints of its families, refitted; empty if there are none."""
        if not any(h.joints for h, _ in model.parts):
            return []
        estimates, _ = self._sensitivities(model)
        parts = []
        for hypothesis, x in model.parts:
            negligible = _negligible_joints(hypothesis, estimates[hypothesis.key])
            members = [joint for joint in hypothesis.joints if joint not in negligible]
            if 0 < len(members) < len(hypothesis.joints):
                hypotheses, joints = self.search.hypotheses, self.search.joints
                hypothesis, x = restrict(hypothesis, x, members, hypotheses, joints)
            parts.append((hypothesis, x))
        same = {h.key for h, _ in parts} <= {h.key for h, _ in model.parts}
        return [] if same else [self._fitted(parts)]

    def _pairs(self, model: Fitted) -> list[Fitted]:
        """Two effects with fewer parameters in place of a single one; empty for other models.

        The search adds nothing to an effect that explains the data, as a cable with five may.
        """
        if len(model.parts) != 1:
            return []
        singles = [m for m in self.fits.values() if len(m.parts) == 1 and m.paid + 1 < model.paid]
        parts = []
        for one in sorted(singles, key=lambda m: (self.search.energy(m), m.key))[:N_SIMPLER]:
            for s in self.search.beside(one, self.found.screened):
                is_smaller = one.paid + len(s.hypothesis.coordinates) < model.paid
                if is_smaller and s.hypothesis.effect not in (*one.names, *model.names):
                    parts.append((*one.parts, (s.hypothesis, s.x)))
        return self.search.fitted(parts, self.fits.values()) if parts else []

    def _sensitivities(self, model: Fitted) -> tuple:
        """Result of `sensitivities` for a model as it was fitted, computed once."""
        cached, result = self.known.get(model.key, (None, ()))
        if cached is not model:
            exact = self.case.corrected(model.specs, model.overrides)
            result = sensitivities(exact, model, wider=True)
            self.known[model.key] = model, result
        return result

    def _put(self, models: Iterable[Fitted]) -> list[Fitted]:
        """The better of each model and the fit of the same effects that is known."""
        result = []
        for model in models:
            old = self.fits.get(model.key)
            if old is None or self.search.energy(model) < self.search.energy(old):
                self.fits[model.key] = model
                self.converged.discard(model.key)
            result.append(self.fits[model.key])
        return result

    def _finish(self, models: Sequence[Fitted]) -> bool:
        """Refit models with their own step error, if they are in reach of the best one.

        Returns:
            Whether there was a model that was not fitted to convergence yet.
        """
        keys = list(dict.fromkeys(m.key for m in models if m.key not in self.converged))
        among = [*self.fits.values()]
        selected = [self.fits[key] for key in keys]
        in_reach = [self.search.in_reach(model, among, AT_JUMPS) for model in selected]
        tasks = [(m, self.search.setting, on) for m, on in zip(selected, in_reach, strict=True)]
        for key, refined in zip(keys, self.search.each(finalize, tasks), strict=True):
            self.fits[key] = refined
        self.converged |= {*keys}
        return bool(keys)

    def _off(self, model: Fitted) -> bool:
        """True if a value of the robot deviates so much that effects alter its sensitivity."""
        if not (self.case.bends and model.parts and model.loose):
            return False
        return bool(np.max(np.abs(self.case.loose.deviations(model.loose))) > MAX_DEVIATION)

    def _anew(self, models: Sequence[Fitted]) -> list[Fitted]:
        """Each model, or its fit with values linearised about the judged model if that is better."""
        if self.about is None:
            return list(models)
        tasks = [(m.parts, self.search.setting, self.about) for m in models]
        refits = self.search.each(refit_model, tasks)
        return [min(pair, key=self.search.energy) for pair in zip(models, refits, strict=True)]

    def _fitted(self, parts: Parts) -> Fitted:
        """A model fitted from the coordinates of its parts."""
        return next(iter(self.search.each(fit, [(tuple(parts), self.search.setting)])))

    def _without(self, model: Fitted, index: int) -> Fitted:
        """The model without one effect, the others refitted from their coordinates."""
        parts = _parts_without(model, index)
        return self._anew([self._fitted(parts)])[0] if parts else self.found.base

    def _swaps(self, model: Fitted, index: int, without: Fitted) -> list[Fitted]:
        """Models with another effect, or the same at another place, instead of one effect.

        If the model has a gap, the search may have missed an effect that explains most beside the
        others, because it explains less beside this one.
        """
        target = model.parts[index][0]
        rest = _parts_without(model, index)
        remaining = sorted(h.key for h, _ in rest)
        fitted: dict[str, Fitted] = {}
        for other in sorted(self.fits.values(), key=lambda m: (self.search.energy(m), m.key)):
            keys = [h.key for h, _ in other.parts]
            if all(keys.count(k) >= remaining.count(k) for k in remaining):
                new = [h for h, _ in other.parts if h.key not in remaining]
                if len(new) == 1 and len(keys) == len(model.parts) and new[0].key != target.key:
                    fitted.setdefault(new[0].key, other)
        new = [
            (s.hypothesis, s.x)
            for s in leading(self.found.screened, target)
            if s.hypothesis.key not in (*fitted, *remaining)
        ]
        similar = min(N_LOOK_ALIKES, sum(h.effect in look_alike_names(target) for h, _ in new))
        new = new[: max(similar, RIVAL_NAMES - len({m.key for m in fitted.values()}))]
        if rest and not self.search.adequate(model):
            additional = self.search.beside(without, self.found.screened)
            excluded = {*fitted, *remaining, target.key, *(h.key for h, _ in new)}
            new += [(s.hypothesis, s.x) for s in additional if s.hypothesis.key not in excluded]
        new_fits = self.search.fitted([(*rest, part) for part in new], self.fits.values())
        models = [*fitted.values(), *new_fits]
        models.sort(key=lambda m: (self.search.energy(m), m.key))
        return self._anew(select(models, target, remaining))


def _parts_without(model: Fitted, index: int) -> tuple:
    """Parts of a model without one of them."""
    return tuple(part for i, part in enumerate(model.parts) if i != index)


def _negligible_joints(hypothesis: Hypothesis, estimates: Sequence[Estimate]) -> set[str]:
    """Joints of a family whose sizes are compatible with 0 and small compared to the largest.

    A size that is merely uncertain may be real: a robot with friction has it in all joints.
    """
    pairs = list(zip(hypothesis.coordinates, estimates, strict=True))
    largest: dict[str, float] = {}
    for c, e in pairs:
        if c.strength:
            largest[c.name] = max(largest.get(c.name, 0.0), abs(e.value - e.absent))

    def is_small(e: Estimate, largest: float) -> bool:
        bound, tolerance = max(-e.low, e.high), 0.5 * NEARLY * (e.high - e.low)
        uncertain = abs(e.value - e.absent) < tolerance
        return bound < (LESS if uncertain else LITTLE_BESIDE) * largest

    significant = {
        c.of
        for c, e in pairs
        if c.strength
        and not (c.one_sided and e.value == e.absent)  # the size is at its bound of 0
        and not is_small(e, largest[c.name])
    }
    return set(hypothesis.joints) - significant
