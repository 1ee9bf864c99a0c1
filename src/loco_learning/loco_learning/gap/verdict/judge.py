# SPDX-License-Identifier: Apache-2.0
"""Judgement of a search's result: each effect against its absence and against its rivals.

All compared models are fitted to convergence, with a correction of their own step error.
Each additional parameter is penalised (`occam`): friction with a Stribeck velocity above all
measured velocities is Coulomb friction, and must not make it ambiguous.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..fitting.fit import Fitted, Parts, anew, fit
from ..fitting.search import Found, Search
from ..fitting.seen import finish
from ..hypotheses.families import fewer
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case
from ..prediction.channels import slides
from ..statistics import evidence, identify
from . import stable
from .candidates import Candidate, Estimate, Rival
from .decide import (
    AMBIGUOUS,
    LIMITS,
    MORE,
    NAMED,
    NO_GAP,
    UNKNOWN,
    Decision,
    Limits,
    adequate,
    decide,
    has_gap,
)
from .rivals import (
    RIVAL_NAMES,
    elsewhere,
    few,
    leading,
    look_alikes,
    occam,
    on_edge,
    paid,
    ratio,
    sharp,
    trifle,
)
from .sensitivity import sensitivities
from .traded import LeftOut, Nominal, crowded, little_off, strayed

BENT = 1.0  # deviation of a robot value above which sensitivities are recomputed (taste)
INSTEAD = 2  # rivals that may replace a model that is not established
LEADING = 4  # models among which the simplest unbeaten one is selected
LEAST_SHARE = 0.02  # smallest share of the energy above noise for one more effect (battery)
LOOK_ALIKES = 2  # look-alikes that are fitted in any case, if not fitted yet
LITTLE_BESIDE = 0.1  # size over the largest of a family below which a joint is left out (taste)
LESS, NEARLY = 0.4, 1.5  # the same for sizes within 1.5 half intervals of 0 (taste)
ODDS, INTERVAL = 1, 2  # keys of random streams


@dataclass(frozen=True)
class Judged:
    """A decision with its evidence.

    Attributes:
        decision: The verdict.
        given: The user's own model: "before".
        base: The user's model with nominal values refitted: the reference for effects.
        best: The selected model.
        candidates: Effects of the selected model with the evidence, in order.
        rivals: Other models of as many effects, each with the evidence of the best over it.
        identifiability: Analysis of the best model's parameters; None without any.
        left_out: Models that were excluded because nominal values imitate their effects.
        alarms: Implausible parameters and values, a sentence each.
        over_settings: Answers under other splits, stretches and floors, if an effect was named.
        asked: Whether the user declared values of the robot as free or uncertain.
        models: All models that were fitted, the best fit of each.
    """

    decision: Decision
    given: Fitted
    base: Fitted
    best: Fitted
    candidates: tuple[Candidate, ...]
    rivals: tuple[tuple[Fitted, evidence.Comparison], ...]
    identifiability: identify.Identifiability | None
    left_out: tuple[LeftOut, ...] = ()
    alarms: tuple[str, ...] = ()
    over_settings: tuple[stable.Row, ...] = ()
    asked: bool = False
    models: tuple[Fitted, ...] = ()

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


def judge(case: Case, search: Search, found: Found, limits: Limits = LIMITS) -> Judged:
    """Judge the result of a search.

    Args:
        case: Model and data.
        search: Settings and processes.
        found: Result of the search.
        limits: Conditions for naming an effect.
    """
    base = found.base
    nominal = Nominal(search.nominal, search.params.free_spread)
    sufficient, result = search.adequate(base), None
    fits = {"": base} | {model.key: model for model in reversed(found.models)}
    if found.models:
        comparison = _Judgement(case, search, found, nominal)
        result = comparison.run(limits)
        fits |= comparison.done
        needed = result.decision.verdict in (NAMED, MORE, AMBIGUOUS)
        if sufficient and not (needed and comparison.beats(result.best, base, limits)):
            result = None
    if result is None:
        residuals = base.whole, base.whole
        decision = decide((), found.given.held, base.held, limits, residuals, gap=not sufficient)
        result = Judged(decision, found.given, base, base, (), (), None)
    if result.decision.verdict in (NAMED, MORE):
        alternatives = [
            model
            for model, _ in result.rivals
            if not any(on_edge(*part, limits.edge) for part in model.parts)
        ]
        table = tuple(stable.rows(search, result.best, base, alternatives, search.params.seed))
        decision = stable.downgraded(result.decision, table)
        result = replace(result, decision=decision, over_settings=table)
    result = replace(result, asked=search.asked, models=tuple(fits.values()))
    refitted = [*search.nominal, *little_off(case, base)]
    no_gap = result.decision.verdict == NO_GAP
    if refitted and sufficient and no_gap and has_gap(found.given.whole, limits):
        text = (
            f"The model is a little off. With {', '.join(refitted)} refitted it explains the data: "
            f"{found.given.held.rms:.2f} noise floors before, {base.held.rms:.2f} after."
        )
        result = replace(result, decision=replace(result.decision, evidence=text))
    crowding = crowded(case, result.after)
    if crowding and result.decision.verdict == NAMED:
        text = f"{result.decision.evidence} More is missing: {crowding}."
        result = replace(result, decision=replace(result.decision, verdict=MORE, evidence=text))
    alarms = (
        *result.decision.alarms,
        *nominal.alarms(result.after, limits),
        *strayed(case, result.after, limits),
    )
    return replace(result, alarms=alarms)


class _Judgement:
    """Fits and comparisons of the models that the verdict needs."""

    def __init__(self, case: Case, search: Search, found: Found, nominal: Nominal):
        self.case, self.search, self.found = case, search, found
        self.seed = search.params.seed
        self.done: dict[str, Fitted] = {}
        self.nominal = nominal
        self.about: list[dict] | None = None
        self.sliding = slides(case.forward.channels)
        size = np.nanstd(np.concatenate(case.forward.measured), axis=0) / case.floor
        self.enough = search.params.accuracy * size

    def run(self, limits: Limits) -> Judged:
        models, out = self.nominal.believed(
            self.case, self.found.models, limits, lambda m: self._explains(m, limits)
        )
        result = self._swapped(self._judged(self._best(models, limits), limits), out, limits)
        if result.decision.verdict == UNKNOWN and result.decision.adequate:
            result = self._instead(result, {o.model.key for o in out}, limits)
        if result.decision.verdict == UNKNOWN:
            result = self._established(result, limits)
        return replace(result, left_out=tuple(out))

    def _trifle(self, part: tuple) -> bool:
        return trifle(*part, self.sliding)

    def _swapped(self, judged: Judged, out: Sequence, limits: Limits) -> Judged:
        """Judgement of the best rival, if that beats the selected model."""
        excluded = {o.model.key for o in out}
        candidates = [
            model
            for model, _ in judged.rivals
            if self.beats(model, judged.best, limits)
            and model.key not in excluded
            and not any(self._trifle(part) for part in model.parts)
        ]
        best = min(candidates, key=lambda m: (self.search.energy(m), m.key), default=None)
        return self._judged(best, limits) if best else judged

    def _instead(self, judged: Judged, out: set[str], limits: Limits) -> Judged:
        """Judgement of an established rival that cannot be excluded, instead of one that is not."""
        candidates = [
            m
            for m, over in judged.rivals
            if over.odds <= limits.odds
            and ratio(m, judged.best) <= sharp(limits, judged.best).worse
            and m.key not in out
        ]
        for model in candidates[:INSTEAD]:
            other = self._judged(model, limits)
            if other.decision.verdict != UNKNOWN:
                return other
        return judged

    def _established(self, judged: Judged, limits: Limits) -> Judged:
        """Judgement without the effects that are not established, if that one is established."""
        assessments = judged.decision.rulings
        unknown = [i for i, assessment in enumerate(assessments) if assessment.verdict == UNKNOWN]
        if not unknown or len(unknown) == len(assessments):
            return judged
        best = judged.best
        for i in reversed(unknown):
            best = self._without(best, i)
        other = self._judged(self._finished([best])[0], limits)
        if other.decision.verdict == UNKNOWN:
            other = self._established(other, limits)
        return judged if other.decision.verdict == UNKNOWN else other

    def _judged(self, best: Fitted, limits: Limits) -> Judged:
        """Judgement of a model without its superfluous effects, against its rivals."""
        self.about = best.specs if self._off(best) else None
        (best,) = self._finished(self._anew([best]))
        best, lost = self._pruned(best, limits)
        exact = self.case.corrected(best.specs, best.overrides)  # as it was fitted
        estimates, analysis = sensitivities(exact, best, doubtful=True)
        narrower = self._narrowed(best, estimates)
        if narrower and not self._needs(best, narrower, limits):
            return self._judged(narrower, limits)
        swaps = [self._swaps(best, i, without) for i, without in enumerate(lost)]
        rest = self._finished([m for each in swaps for m in each])
        candidates, alternatives = [], []
        for i, (hypothesis, _) in enumerate(best.parts):
            models, rest = rest[: len(swaps[i])], rest[len(swaps[i]) :]
            scored = [(m, self._odds(best, m)) for m in models]
            alternatives += scored
            candidate = self._candidate(best, i, estimates[hypothesis.key], lost[i], scored, limits)
            traded = self.nominal.traded(best, hypothesis, analysis, limits)
            candidates.append(replace(candidate, traded=traded))
        base = self.found.base
        residuals = base.whole, best.whole
        strict = sharp(limits, best)
        before, after = self._weighed(self.found.given, best)
        decision = decide(candidates, before, after, strict, residuals, self.enough, gap=True)
        alternatives.sort(key=lambda pair: (pair[1].odds, pair[0].key))
        first = self.found.given
        return Judged(decision, first, base, best, tuple(candidates), tuple(alternatives), analysis)

    def _explains(self, model: Fitted, limits: Limits) -> bool:
        """True if a model explains the data."""
        return adequate(self.found.base.whole, model.whole, limits, self.enough)

    def _best(self, found: Sequence[Fitted], limits: Limits) -> Fitted:
        """The simplest of the leading models that no other one beats."""
        first = {len(m.parts): m for m in reversed(found)}.values()
        leading = {m.key: m for m in (*found[:LEADING], *first)}
        models = self._finished(list(leading.values()))
        models.sort(key=lambda m: (m.count, self.search.energy(m), m.key))
        for model in models:
            alternatives = (other for other in models if other is not model)
            if not any(self.beats(r, model, limits) for r in alternatives):
                return model
        return min(models, key=lambda m: (self.search.energy(m), m.key))

    def _pruned(self, best: Fitted, limits: Limits) -> tuple[Fitted, list[Fitted]]:
        """The model without superfluous effects, and that model without each remaining effect."""
        while True:
            lost = self._finished([self._without(best, i) for i in range(len(best.parts))])
            superfluous = [m for m in lost if m.parts and not self._needs(best, m, limits)]
            if not superfluous:
                return best, lost
            best = min(superfluous, key=lambda m: (self.search.energy(m), m.key))

    def _narrowed(self, best: Fitted, estimates: Mapping[str, Sequence[Estimate]]) -> Fitted | None:
        """The model without the idle joints of its families, refitted; None if there are none."""
        parts = []
        for hypothesis, x in best.parts:
            negligible = _idle(hypothesis, estimates[hypothesis.key])
            members = [joint for joint in hypothesis.joints if joint not in negligible]
            if 0 < len(members) < len(hypothesis.joints):
                hypotheses, joints = self.search.hypotheses, self.search.joints
                hypothesis, x = fewer(hypothesis, x, members, hypotheses, joints)
            parts.append((hypothesis, x))
        if {h.key for h, _ in parts} <= {h.key for h, _ in best.parts}:
            return None
        return self._finished([self._fitted(parts)])[0]

    def beats(self, a: Fitted, b: Fitted, limits: Limits) -> bool:
        """True if `a` is more probable; with more effects, it must also explain noticeably more."""
        if self._odds(a, b).odds <= limits.odds and ratio(b, a) <= sharp(limits, a).worse:
            return False
        return len(a.parts) <= len(b.parts) or not self._plain(a, b, limits)

    def _needs(self, a: Fitted, b: Fitted, limits: Limits) -> bool:
        """True if `a` needs the effects that `b` lacks: `b` is significantly worse on held-out data.

        If the residual of `b` is at the floor, only the odds decide.
        """
        if self.beats(a, b, limits):
            return True
        return not self._settled(b, limits) and self._gain(a, b)[0].low > 0.0

    def _plain(self, a: Fitted, b: Fitted, limits: Limits) -> bool:
        """True if `b`, with fewer effects, is at the floor and its residual is hardly larger."""
        base, larger, smaller = (
            evidence.excess(self._weighed(self.found.base, m)[1].residuals)
            for m in (self.found.base, a, b)
        )
        return self._settled(b, limits) and smaller - larger <= LEAST_SHARE * base

    def _settled(self, model: Fitted, limits: Limits) -> bool:
        """True if the residual of a model is at the floor, or within the requested accuracy."""
        strict = limits.replace(most=1.0, aside=0.0)
        return adequate(self.found.base.whole, model.whole, strict, self.enough)

    def _finished(self, models: Sequence[Fitted]) -> list[Fitted]:
        """Models refitted with their own step error, if that is better and they are in reach.

        A model that was refitted earlier is refitted again if its residual is now smaller.
        """
        new = {m.key: m for m in models if m.key not in self.done or self._better(m)}
        tasks = [(m, self.search.setting, self.search.in_reach(m, models)) for m in new.values()]
        for key, refined in zip(new, self.search.each(finish, tasks), strict=True):
            self.done[key] = refined
        return [self.done[m.key] for m in models]

    def _off(self, model: Fitted) -> bool:
        """True if a value of the robot deviates so much that effects alter its sensitivity."""
        if not (self.case.bends and model.parts and model.loose):
            return False
        return bool(np.max(np.abs(self.case.loose.deviations(model.loose))) > BENT)

    def _anew(self, models: Sequence[Fitted]) -> list[Fitted]:
        """Each model, or its fit with values linearised about the judged one, if better."""
        if self.about is None:
            return list(models)
        tasks = [(m.parts, self.search.setting, self.about) for m in models]
        refits = self.search.each(anew, tasks)
        return [min(pair, key=self.search.energy) for pair in zip(models, refits, strict=True)]

    def _fitted(self, parts: Parts) -> Fitted:
        """A model fitted from the coordinates of its parts."""
        return next(iter(self.search.each(fit, [(tuple(parts), self.search.setting)])))

    def _better(self, model: Fitted) -> bool:
        """True if a model has a smaller residual than the finished one of the same effects."""
        return self.search.energy(model) < self.search.energy(self.done[model.key])

    def _without(self, best: Fitted, index: int) -> Fitted:
        """The model without one effect, the others refitted from their coordinates.

        The search may have found another optimum for these others alone. The better of both is the
        reference, so that the effect does not get credit for that optimum.
        """
        left = [part for i, part in enumerate(best.parts) if i != index]
        if not left:
            return self.found.base
        refit = self._fitted(left)
        candidates = [model for model in self.found.models if model.key == refit.key]
        return min((*candidates, *self._anew([refit])), key=self.search.energy)

    def _swaps(self, best: Fitted, index: int, without: Fitted) -> list[Fitted]:
        """Models with another effect, or the same at another place, instead of one effect.

        If the model has a gap, the search may have missed an effect that explains most beside the
        others, because it explains less beside this one.
        """
        target = best.parts[index][0]
        remaining = sorted(h.key for i, (h, _) in enumerate(best.parts) if i != index)
        fitted: dict[str, Fitted] = {}
        for model in self.found.models:
            keys = [h.key for h, _ in model.parts]
            if all(keys.count(k) >= remaining.count(k) for k in remaining):
                other = [h for h, _ in model.parts if h.key not in remaining]
                if len(other) == 1 and len(keys) == len(best.parts) and other[0].key != target.key:
                    fitted.setdefault(other[0].key, model)
        new = [
            (s.hypothesis, s.x)
            for s in leading(self.found.screened, target)
            if s.hypothesis.key not in (*fitted, *remaining)
        ]
        rest = tuple(part for i, part in enumerate(best.parts) if i != index)
        similar = min(LOOK_ALIKES, sum(h.effect in look_alikes(target) for h, _ in new))
        new = new[: max(similar, RIVAL_NAMES - len({m.key for m in fitted.values()}))]
        if rest and not self.search.adequate(best):
            additional = self.search.beside(without, self.found.screened)
            excluded = {*fitted, *remaining, target.key, *(h.key for h, _ in new)}
            new += [(s.hypothesis, s.x) for s in additional if s.hypothesis.key not in excluded]
        models = [*fitted.values(), *self.search.fitted([(*rest, part) for part in new])]
        models.sort(key=lambda m: (self.search.energy(m), m.key))
        return self._anew(few(models, target, remaining))

    def _closed(self, model: Fitted) -> float:
        """Share of the gap of the reference model that a model closes on held-out data."""
        before, after = self._weighed(self.found.base, model)
        return evidence.closed_by(before.residuals, after.residuals)

    def _weighed(self, without: Fitted, model: Fitted) -> tuple[evidence.Score, evidence.Score]:
        """Scores of both on held-out data; on all data if the first has no gap there."""
        pair = without, model
        return tuple(m.score if elsewhere(without) else m.held for m in pair)

    def _gain(self, a: Fitted, b: Fitted) -> tuple[evidence.Comparison, float]:
        """Evidence on held-out data, and the closed share of the gap of the second model.

        If the second has a gap elsewhere only, all data are used, with a penalty for parameters
        that were fitted to them.
        """
        rng = np.random.default_rng([self.seed, INTERVAL])
        trials = max(1, min(len(self.found.models), self.search.params.finalists))
        before, after = self._weighed(b, a)
        over = evidence.compare(after, before, rng, trials)
        closed = evidence.closed_by(before.residuals, after.residuals)
        return (paid(over, occam(a, b)) if elsewhere(b) else over), closed

    def _odds(self, a: Fitted, b: Fitted) -> evidence.Comparison:
        """Evidence between rivals on all data, both fitted to it, with parameter penalty."""
        rng = np.random.default_rng([self.seed, ODDS])
        return evidence.compare(a.score, b.score, rng, price=occam(a, b))

    def _total(self, a: Fitted, b: Fitted) -> evidence.Comparison:
        """Evidence on all data for a model over one without an effect, with parameter penalty."""
        return paid(self._odds(a, b), occam(a, b))

    def _candidate(
        self,
        best: Fitted,
        index: int,
        estimates: tuple[Estimate, ...],
        without: Fitted,
        rivals: Sequence[tuple[Fitted, evidence.Comparison]],
        limits: Limits,
    ) -> Candidate:
        hypothesis = best.parts[index][0]
        remaining = [h.key for i, (h, _) in enumerate(best.parts) if i != index]
        alternatives = []
        for model, over in rivals:
            (part,) = [part for part in model.parts if part[0].key not in remaining]
            other, _ = part
            closed, growth = self._closed(model), ratio(model, best)
            at_bound = on_edge(*part, limits.edge)
            alternatives.append(
                Rival(other.effect, other.place, over, closed, self._trifle(part), growth, at_bound)
            )
        return Candidate(
            hypothesis.effect,
            hypothesis.place,
            estimates,
            *self._gain(best, without),
            tuple(alternatives),
            self._trifle(best.parts[index]),
            total=self._total(best, without),
            worse=ratio(without, best),
            elsewhere=elsewhere(without),
        )


def _idle(hypothesis: Hypothesis, estimates: Sequence[Estimate]) -> set[str]:
    """Joints of a family whose sizes are compatible with 0 and small compared to the largest.

    A size that is merely uncertain may be real: a robot with friction has it in all joints.
    """
    pairs = list(zip(hypothesis.coordinates, estimates, strict=True))
    largest: dict[str, float] = {}
    for c, e in pairs:
        if c.strength:
            largest[c.name] = max(largest.get(c.name, 0.0), abs(e.value - e.absent))

    def little(e: Estimate, largest: float) -> bool:
        bound, tolerance = max(-e.low, e.high), 0.5 * NEARLY * (e.high - e.low)
        uncertain = abs(e.value - e.absent) < tolerance
        return bound < (LESS if uncertain else LITTLE_BESIDE) * largest

    significant = {
        c.of
        for c, e in pairs
        if c.strength
        and not (c.one_sided and e.value == e.absent)  # the size is at its bound of 0
        and not little(e, largest[c.name])
    }
    return set(hypothesis.joints) - significant
