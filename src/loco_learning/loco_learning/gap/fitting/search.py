# SPDX-License-Identifier: Apache-2.0
"""Search for effects that together explain the data: screening, fits, then one more effect."""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from loco_sim.effects import EFFECTS

from ...jobs.pool import Jobs
from ..hypotheses.bundles import Batch
from ..hypotheses.families import by_law
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case, are_smooth
from ..statistics import evidence, noise
from ..statistics.leftover import has_gap
from .fit import Fitted, Setting, converge, fit, refine, rough_fit, weigh
from .params import GapParams
from .screen import Screened, screen, smooth

log = logging.getLogger(__name__)
Report = Callable[[float, str, str], Any]
AT_LEAST = 6  # effects that are tested beside others
NEAR_FLOOR = 5.0  # noise floors; above, the search goes on however much of the gap is closed
FITTED_PLACES, CLOSE = 4, 0.8  # fitted places of an effect, and share of the best one to be fitted
LEAST_OF_BEST = 0.1  # share of what the best explains below which an effect is not fitted
CLOSE_RACE = 1.1  # ratio to the smallest rough rms up to which twice as many models are fitted
LEAST_GAIN = 0.05  # decrease of the log residual below which no further effect is sought
REFITS = 3  # refits of nominal values, each with the residual scale of the previous one
TANGENT_STEP = 0.05  # step of a size, or of the logarithm of a nominal value, for sensitivities
MAX_SIBLINGS = 3  # effects of a kind at a place that are tested in pairs
PAIRS = 2  # pairs that are fitted
# Increase of the log residual, fitted plus held-out, from the best model to the worst that is
# refined: twice its rms (taste). A smooth model does not fall that far by refinement.
IN_REACH = 2.0 * math.log(2.0)
# The same for effects that act in jumps, in models beside a judged one. On 9 benches the largest
# fall was 1.1, of two stops; of models that began farther away none came near.
AT_JUMPS = 2.0 * IN_REACH
EXCESS = 1.1  # ratio of the rms to that of a part of a model above which it is fitted anew (taste)
DEEPEST = 4  # effects in one model, laws in several joints included (taste)
# Completed shares of a search before and after screening, after single effects and at its end, and
# of a tournament after rough fits and after fits: of simulations, on 9 benches and a quadruped.
PREPARED, SCREENING, SINGLES, SEARCHED = 0.2, 0.45, 0.8, 0.95
ROUGH_FITS, FITS = 0.2, 0.75
DEEP = 3  # models of two or more effects that are fitted to convergence at each step


@dataclass
class Pool:
    """Result of a search.

    Attributes:
        given: The user's own model.
        base: The user's model with nominal values refitted, which effects must improve on.
        models: All fitted models, the best first.
        screened: Share that each hypothesis may explain alone.
    """

    given: Fitted
    base: Fitted
    models: list[Fitted] = field(default_factory=list)
    screened: list[Screened] = field(default_factory=list)

    @property
    def best(self) -> Fitted:
        """The best model; `base` if no effect was fitted."""
        return self.models[0] if self.models else self.base


def call(case: Case, function: Callable[..., Any], arguments: tuple) -> Any:
    """Call a function with a case and plain arguments; the task of the worker processes."""
    return function(case, *arguments)


class Search:
    """Forward selection of effects, with look-alikes, backward elimination and swaps.

    Args:
        case: Model and data.
        hypotheses: Hypotheses about what is missing.
        params: Settings.
        tasks: Pool of processes that run `call` with the case.
        report: Progress callback: completed share, stage, best name so far.
        nominal: Nominal values that are refitted.
        make_batches: Groups hypotheses that can be simulated together.
    """

    def __init__(
        self,
        case: Case,
        hypotheses: Sequence[Hypothesis],
        params: GapParams,
        tasks: Jobs,
        report: Report,
        nominal: Mapping[str, float],
        make_batches: Callable[[Sequence[Hypothesis]], list[Batch]],
    ):
        self.case, self.hypotheses, self.params, self.tasks = case, hypotheses, params, tasks
        self.report, self.nominal, self.bundled = report, dict(nominal), make_batches
        self.joints = case.forward.robot().joints
        self.fits: dict[str, Fitted] = {}

    def _records_to_screen(self, base: Fitted) -> list[int]:
        """Fit records with the largest residuals, up to `GapParams.screen_seconds` in total."""
        size = {i: -evidence.rms([base.whole[i]]) for i in self.case.fitted}
        selected, seconds = [], 0.0
        for i in sorted(size, key=lambda i: (size[i], i)):
            if selected and seconds >= self.params.screen_seconds:
                break
            selected.append(i)
            seconds += self.case.records[i].duration
        return sorted(selected)

    def singles(self) -> Pool:
        """Test effects one at a time, all starting from the user's own model.

        Effects must improve on refitted nominal values, but do not start from these: nominal values
        that compensate a missing effect would hide it.
        """
        self.report(0.02, "fitting the model as it came", "")
        initial = weigh(self.case, (), self.nominal, initial=True)
        base = converge(self.case, (), self.nominal)
        for _ in range(REFITS if self.nominal else 0):  # the robust loss gets narrower
            setting = Setting(self.params, self.nominal, base.overrides, self._scale(base), ())
            base = next(iter(self.each(fit, [((), setting)])))
        if self.nominal:
            base = next(iter(self.each(refine, [(base, setting)])))
        result, self.only = Pool(initial, base), self._records_to_screen(initial)
        self.setting = Setting(
            self.params, self.nominal, self.nominal, self._scale(base), tuple(self.only)
        )
        if self.adequate(initial) or self.asked and self.adequate(base):
            return result  # otherwise an adequate `base` competes with effects
        result.screened = self._screen(initial, PREPARED, SCREENING)
        grouped = [(one,) for one in by_law(result.screened, self.joints)]
        singles = [((s.hypothesis, s.x),) for s in self._chosen(result.screened)]
        span = SCREENING, 0.9 * SINGLES
        self._tournament([*grouped, *singles], self.params.finalists, span)
        ranked = self._ranked(base)
        if ranked and not self.enough(ranked[0], base):
            pairs = sibling_pairs(result.screened, self.params.screen_share)
            self._tournament(pairs, PAIRS, (span[1], SINGLES))
        result.models = self._ranked(base)
        self.report(SINGLES, "fitted single effects", self._best(base))
        return result

    def together(self, pool: Pool) -> Pool:
        """Add one effect at a time to the best models until the residual is explained."""
        base = pool.base
        level = self._leading(pool.models)
        for depth in range(2, DEEPEST + 1):
            ranked, level = self._ranked(base), [m for m in level if self._extensible(m)]
            done = not ranked or self.enough(ranked[0], base) or self._idle(ranked, depth - 1)
            if done or not level:
                break
            self._deepen(level, pool, depth)
            level = self._leading([m for m in self._ranked(base) if len(m.parts) == depth])
        pool.models = self._ranked(base)
        self.report(SEARCHED, "weighing", self._best(base))
        return pool

    def _scale(self, model: Fitted) -> float:
        """Scale of the robust loss for a model: three robust deviations of its residual."""
        residual = self.case.vector(model.specs, model.overrides)
        return 3.0 * max(1.0, noise.TO_DEVIATION * float(np.median(np.abs(residual))))

    def _leading(self, ranked: Sequence[Fitted]) -> list[Fitted]:
        """Models to which another effect is added; of each combination of kinds only the best."""
        best: dict[tuple, Fitted] = {}
        for model in ranked:
            names = [EFFECTS[h.effect].identity.kind if h.joints else h.key for h, _ in model.parts]
            best.setdefault(tuple(sorted(names)), model)
        return list(best.values())[: self.params.beam]

    def _extensible(self, model: Fitted) -> bool:
        """True if a model may have one more effect; a law in several joints is not counted."""
        return sum(not h.joints for h, _ in model.parts) < self.params.most_terms

    def _idle(self, ranked: Sequence[Fitted], depth: int) -> bool:
        """True if the last added effect hardly improved the fit, which ends the search."""
        best = {len(m.parts): self.energy(m) for m in reversed(ranked)}
        return depth - 1 in best and best.get(depth, math.inf) > best[depth - 1] - LEAST_GAIN

    @property
    def asked(self) -> bool:
        """True if the user declared values of the robot as free or uncertain."""
        loose = self.case.loose
        return bool(self.nominal) or loose is not None and bool(loose.stated.any())

    # ---- judging ---------------------------------------------------------------------

    def adequate(self, model: Fitted) -> bool:
        """True if no gap is left in the fitted rows, in the held-out rows and in both together."""
        every = range(len(model.whole))
        parts = (self.case.masked(model.whole, every, held) for held in (False, True))
        return not any(has_gap(residuals) for residuals in (model.whole, *parts))

    def enough(self, model: Fitted, base: Fitted) -> bool:
        """True if another effect is not worth seeking: adequate, or close to the noise floor."""
        if self.adequate(model):
            return True
        every = range(len(model.whole))
        pairs = [
            [self.case.masked(m.whole, every, held) for m in (base, model)]
            for held in (True, False)
        ]
        at_floor = max(model.held.rms, model.fit_rms) <= NEAR_FLOOR
        return at_floor and all(evidence.closed_by(*pair) >= self.params.closed for pair in pairs)

    def _ranked(self, base: Fitted) -> list[Fitted]:
        """Models with a smaller residual than `base`, the best first."""
        limit = self.energy(base)
        improved = [m for m in self.fits.values() if self.energy(m) < limit and m.parts]
        return sorted(improved, key=lambda m: (self.energy(m) + 0.02 * m.count, m.key))

    def energy(self, model: Fitted) -> float:
        """Logarithm of the residual of a model: held-out counts as much as fitted."""
        return math.log(model.held.rms) + math.log(model.fit_rms)

    def each(self, function: Callable, arguments: Sequence[tuple]) -> Iterator[Any]:
        """Results of calls with the case, in the order of the arguments."""
        return self.tasks.ordered([(function, entry) for entry in arguments])

    # ---- steps -----------------------------------------------------------------------

    def _tournament(
        self, candidates: Sequence[tuple], limit: int, span: tuple[float, float]
    ) -> list[Fitted]:
        """Fit all models roughly, then the best of them to convergence; tells a span of shares."""

        def report(share: float) -> None:
            best = min(self.fits.values(), key=self.energy, default=None)
            names = " + ".join(best.names) if best else ""
            self.report(span[0] + share * (span[1] - span[0]), "fitting", names)

        new = [parts for parts in candidates if _key(parts) not in self.fits]
        tasks = [(parts, self.setting) for parts in new]
        scores = sorted(
            ((rms, _key(parts), parts) for rms, parts in self.each(rough_fit, tasks)),
            key=lambda one: one[:2],
        )
        for rms, key, _ in scores:
            log.info("rough %-50s %8.3f", key, rms)
        report(ROUGH_FITS)
        threshold = CLOSE_RACE * scores[0][0] if scores else 0.0
        last = [
            parts
            for i, (rms, _, parts) in enumerate(scores)
            if i < limit or (i < 2 * limit and rms <= threshold)
        ]
        fitted = self._fit(last)
        report(FITS)
        best = sorted(fitted, key=lambda m: (self.energy(m), m.key))[: self.params.polished]
        best = [m for m in best if self.in_reach(m)]
        tasks = [(model, self.setting) for model in best]
        for old, model in zip(best, self.each(refine, tasks), strict=True):
            log.info("polished %-45s %8.3f held %8.3f", model.key, model.fit_rms, model.held.rms)
            if self.energy(model) < self.energy(old):
                self.fits[model.key] = model
        return fitted

    def _fit(self, candidates: Sequence[tuple]) -> list[Fitted]:
        """Fitted models, each given as a tuple of (hypothesis, start); known fits are reused."""
        new = [parts for parts in candidates if _key(parts) not in self.fits]
        self.fits |= {_key(m.parts): m for m in self.fitted(new)}
        return [self.fits[_key(parts)] for parts in candidates]

    def fitted(
        self, candidates: Sequence[tuple], competitors: Iterable[Fitted] = ()
    ) -> list[Fitted]:
        """New fits; values of the robot are fitted by simulation only if that can matter.

        Args:
            candidates: Models, each as a tuple of (hypothesis, start).
            competitors: Fitted models with which the new ones compete; if there are any, fits that
                leave far more than the best of them end early.
        """
        setting, farthest = self.setting, math.inf
        if cost := min((m.cost for m in competitors if m.parts and m.cost), default=0.0):
            farthest = AT_JUMPS
            setting = replace(setting, hopeless=cost * math.exp(farthest))
        models = list(self.each(fit, [(parts, setting, False) for parts in candidates]))
        unconverged = [
            i for i, m in enumerate(models) if m.hope < 1.0 and self.in_reach(m, models, farthest)
        ]
        tasks = [(models[i].parts, models[i].overrides, models[i].cost) for i in unconverged]
        for i, model in zip(unconverged, self.each(converge, tasks), strict=True):
            models[i] = model
        improvable = [(i, parts) for i, m in enumerate(models) if (parts := self._from_fewer(m))]
        tasks = [(parts, setting, False) for _, parts in improvable]
        for (i, _), model in zip(improvable, self.each(fit, tasks), strict=True):
            models[i] = min((models[i], model), key=self.energy)
        for m in models:
            log.info("fit %-50s %8.3f held %8.3f", m.key, m.fit_rms, m.held.rms)
        return models

    def _from_fewer(self, model: Fitted) -> tuple:
        """Start of a model at the known one with an effect fewer that fits best, if better.

        A limit of a torque may start beside friction that, without the limit, was far larger, and
        that now holds the joint whatever its size. Empty if no such model fits better.
        """
        best: tuple = (model.fit_rms / EXCESS, ())
        for i, (h, *_) in enumerate(model.parts):
            reduced = self.fits.get(_key((*model.parts[:i], *model.parts[i + 1 :])))
            if reduced is not None and reduced.fit_rms < best[0]:
                best = reduced.fit_rms, (*reduced.parts, (h, tuple(h.starts()[0])))
        return best[1]

    def in_reach(
        self, model: Fitted, among: Sequence[Fitted] = (), farthest: float = math.inf
    ) -> bool:
        """True if a model may come near the best one, of the search or `among`, by refinement.

        Args:
            model: A fitted model.
            among: Models beside those of the search.
            farthest: Increase of the log residual up to which effects that act in jumps may; no
                limit while nothing is known about them.
        """
        lowest = min(self.energy(m) for m in (*self.fits.values(), *among, model))
        limit = IN_REACH if are_smooth(model.names) else farthest
        return self.energy(model) + math.log(model.hope) <= lowest + limit

    def _best(self, base: Fitted) -> str:
        """Name of the best model so far."""
        ranked = self._ranked(base)
        return " + ".join(ranked[0].names) if ranked else ""

    def _screen(
        self, model: Fitted, start: float, stop: float, before: Sequence[Screened] = ()
    ) -> list[Screened]:
        """Screen every hypothesis on top of a model."""
        starts = {s.hypothesis.key: s.x for s in before if s.cost}
        hypotheses = [s.hypothesis for s in before if not s.dead] or self.hypotheses
        present = {h.key for h, _ in model.parts}
        candidates = [h for h in hypotheses if h.key not in present]
        results = self._tried(model, candidates, self.only, (start, stop), starts)
        return results if before else self._alone(model, results, stop)

    def beside(self, model: Fitted, before: Sequence[Screened]) -> list[Screened]:
        """Effects that explain most on top of a model, started from their earlier coordinates."""
        return self._chosen(self._screen(model, SEARCHED, SEARCHED, before), AT_LEAST)

    @staticmethod
    def failed(screening: Sequence[Screened]) -> list[tuple[str, str]]:
        """Keys of the hypotheses with which the robot cannot be built, with the reasons."""
        return [(s.hypothesis.key, s.failed) for s in screening if s.failed]

    def _alone(self, model: Fitted, screening: list[Screened], at: float) -> list[Screened]:
        """Second screening, on the record with the largest residual, of effects without a share.

        A large friction stops a joint in one record; in another it only shifts a swing, and at a
        wrong size by more than the residual. Smooth effects act alike in all records.
        """
        loud = self.only[np.argmax([evidence.rms([model.whole[i]]) for i in self.only])]
        weak = [s for s in screening if s.share < self.params.screen_share and not s.dead]
        weak = [s.hypothesis for s in weak if not smooth(s.hypothesis, self.case)]
        if len(self.only) < 2 or not weak:
            return screening
        energy, every = (
            float(np.sum(np.square(self.case.vector(model.specs, model.overrides, only))))
            for only in ([loud], self.only)
        )
        improved = {}
        for s in self._tried(model, weak, [loud], (at, at), {}):
            improved[s.hypothesis.key] = replace(s, share=s.share * energy / max(every, 1e-300))
        return [max(s, improved.get(s.hypothesis.key, s), key=lambda s: s.share) for s in screening]

    def _tried(
        self,
        model: Fitted,
        hypotheses: Sequence[Hypothesis],
        only: Sequence[int],
        span: tuple[float, float],
        starts: Mapping[str, Sequence[float]],
    ) -> list[Screened]:
        """Shares that hypotheses explain of some records on top of a model."""
        specs, overrides = model.specs, model.overrides
        residual = self.case.vector(specs, overrides, only, coarse=True)
        tangent = self._tangent(model, residual, only)
        batches, (start, stop) = self.bundled(hypotheses), span
        tasks = [
            (
                batch, specs, overrides, only, residual, tangent,
                [starts.get(h.key) for h in batch.hypotheses],
            )
            for batch in batches
        ]  # fmt: skip
        results = []
        for i, rows in enumerate(self.each(screen, tasks)):
            results += rows
            share = start + (stop - start) * (i + 1) / len(tasks)
            self.report(share, f"screening {batches[i].key}", " + ".join(model.names))
            for one in rows:
                log.info("screen %-45s %7.3f cost %d", one.hypothesis.key, one.share, one.cost)
        return results

    def _tangent(
        self, model: Fitted, residual: np.ndarray, only: Sequence[int]
    ) -> np.ndarray | None:
        """Orthonormal columns spanned by sensitivities to the model's parameters, (N, k)."""
        columns = []
        for name, value in self.nominal.items():
            moved = {
                **model.overrides,
                name: model.overrides.get(name, value) * math.exp(TANGENT_STEP),
            }
            columns.append(self.case.vector(model.specs, moved, only, coarse=True) - residual)
        for i, (hypothesis, x) in enumerate(model.parts):
            for j in range(len(x)):
                moved = list(x)
                moved[j] += (
                    0.1 if hypothesis.coordinates[j].logarithmic else TANGENT_STEP * (x[j] or 1.0)
                )
                specs = model.moved(i, moved)
                shifted = self.case.vector(specs, model.overrides, only, coarse=True)
                columns.append(shifted - residual)
        live = [c / np.linalg.norm(c) for c in columns if np.linalg.norm(c) > 1e-9]
        return np.linalg.qr(np.stack(live, axis=1))[0] if live else None

    def _chosen(self, screening: Sequence[Screened], count: int = 0) -> list[Screened]:
        """The best places of those effects that explain most."""
        ordered = sorted(screening, key=lambda s: (-s.share, s.hypothesis.key))
        max_share = ordered[0].share if ordered else 0.0
        threshold = max(self.params.screen_share, LEAST_OF_BEST * max_share)
        by_variant: dict[tuple[str, str], list[Screened]] = {}
        for one in ordered:
            group = by_variant.setdefault((one.hypothesis.effect, one.hypothesis.variant), [])
            close = not group or (len(group) < FITTED_PLACES and one.share > CLOSE * group[0].share)
            if one.share >= threshold and close:
                group.append(one)
        groups = [group for group in by_variant.values() if group][: count or self.params.keep]
        return [one for group in groups for one in group]

    def _deepen(self, level: Sequence[Fitted], pool: Pool, depth: int) -> None:
        """Add one effect to each of some models, until one of the results is enough."""
        each = (SEARCHED - SINGLES) / (DEEPEST - 1)
        ends = SINGLES + each * (depth - 2 + np.linspace(0.0, 1.0, len(level) + 1))
        for model, start, stop in zip(level, ends, ends[1:], strict=False):
            middle = 0.5 * (start + stop)
            results = self._screen(model, start, middle, pool.screened)
            selected = [(s.hypothesis, s.x) for s in self._chosen(results, AT_LEAST)]
            present = {h.key for h, _ in model.parts}
            best = max((s.share for s in results), default=0.0)
            grouped = [
                one for one in by_law(results, self.joints, best) if one[0].key not in present
            ]
            extended = [(*model.parts, one) for one in (*grouped, *selected)]
            limit = min(DEEP, self.params.finalists)
            fitted = self._tournament(extended, limit, (middle, stop))
            if any(self.enough(m, pool.base) for m in fitted):
                break  # `judge` looks for rivals of its effects


def sibling_pairs(screening: Sequence[Screened], min_share: float) -> list[tuple]:
    """Pairs of effects of one kind at one place, where that kind explains most.

    The zero and the gain of an encoder are off together, or a joint has friction by two laws. Each
    alone may explain less than an effect of another kind that imitates both, and would never be
    extended.

    Args:
        screening: Share that each hypothesis explains alone.
        min_share: Smallest share that is considered.
    """
    groups: dict[tuple[str, str], dict[str, Screened]] = {}
    for one in sorted(screening, key=lambda s: (-s.share, s.hypothesis.key)):
        h = one.hypothesis
        kind = EFFECTS[h.effect].identity.kind
        if kind and h.place and not one.dead and one.share >= min_share:
            groups.setdefault((kind, h.place), {}).setdefault(h.effect, one)
    first: dict[str, list[Screened]] = {}
    for (kind, _), members in groups.items():  # ordered by the largest share
        first.setdefault(kind, list(members.values())[:MAX_SIBLINGS])
    return [
        tuple((s.hypothesis, s.x) for s in pair)
        for members in first.values()
        for pair in itertools.combinations(members, 2)
    ]


def _key(parts: Sequence[tuple]) -> str:
    """Names of the hypotheses of a model, sorted."""
    return " + ".join(sorted(hypothesis.key for hypothesis, _ in parts))
