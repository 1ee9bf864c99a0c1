# SPDX-License-Identifier: Apache-2.0
"""Which effects together explain the data: screening, fits, one effect more at a time."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from . import evidence
from .bundles import Bundle
from .case import Case
from .fit import Fitted, Setting, fit, polish, rough
from .hypotheses import Hypothesis
from .parallel import Tasks
from .params import GapParams
from .screen import Screened, screen

log = logging.getLogger(__name__)
Report = Callable[[float, str, str], Any]
AT_LEAST = 6  # effects that are tried beside others
NEAR = 5.0  # floors: more is not the end, however much is closed
PLACES, CLOSE = 2, 0.8  # of an effect that are fitted, and share of the best that is close
FAR = 0.1  # share of what the best explains below which an effect is not fitted
ALIKE = 1.1  # times the smallest rms of a rough fit up to which twice as many go on
LEAST_GAIN = 0.05  # of the logarithm of what is left that makes another effect worth a search
DEEP = 3  # models of two effects and more that are fitted to the end at each step


@dataclass
class Found:
    """What a search found.

    Attributes:
        base: The model as it came, with nominal values refitted.
        models: All models that were fitted, the best first.
        screened: What each hypothesis may explain by itself.
    """

    base: Fitted
    models: list[Fitted] = field(default_factory=list)
    screened: list[Screened] = field(default_factory=list)

    @property
    def best(self) -> Fitted:
        """The best model, the one as it came if nothing was fitted."""
        return self.models[0] if self.models else self.base


class Search:
    """Forward selection with look-alikes, backward elimination and swaps.

    Args:
        case: Model and data.
        hypotheses: What may be missing.
        params: Settings.
        tasks: Where simulations run.
        report: Progress: share done, stage, best name so far.
        nominal: Nominal values that are refitted.
        bundled: Puts hypotheses together that may be tried at once.
    """

    def __init__(
        self,
        case: Case,
        hypotheses: Sequence[Hypothesis],
        params: GapParams,
        tasks: Tasks,
        report: Report,
        nominal: Mapping[str, float],
        bundled: Callable[[Sequence[Hypothesis]], list[Bundle]],
    ):
        self.case, self.hypotheses, self.params, self.tasks = case, hypotheses, params, tasks
        self.report, self.nominal, self.bundled = report, dict(nominal), bundled
        self.fits: dict[str, Fitted] = {}

    def _records_to_screen(self, base: Fitted) -> list[int]:
        """Fit records in which the residual is largest, until there is enough of them."""
        size = {i: -evidence.rms([base.whole[i]]) for i in self.case.fitted}
        chosen, seconds = [], 0.0
        for i in sorted(size, key=lambda i: (size[i], i)):
            if chosen and seconds >= self.params.screen_seconds:
                break
            chosen.append(i)
            seconds += self.case.records[i].duration
        return sorted(chosen)

    def run(self) -> Found:
        """Search."""
        self.report(0.02, "fitting the model as it came", "")
        self.setting = Setting(self.params, self.nominal, self.nominal, 3.0, ())
        base = self._fit([()])[0]
        found = Found(base)
        residual = self.case.vector([], base.overrides)
        scale = 3.0 * max(1.0, 1.4826 * float(np.median(np.abs(residual))))
        self.only = self._records_to_screen(base)
        self.setting = Setting(self.params, self.nominal, base.overrides, scale, tuple(self.only))
        if self.adequate(base):
            return found
        found.screened = self._screen(base, 0.05, 0.35)
        singles = [((s.hypothesis, s.x),) for s in self._chosen(found.screened)]
        self._tournament(singles, self.params.finalists)
        self.report(0.6, "fitted single effects", self._best(base))
        level = self._ranked(base)[: self.params.beam]
        for depth in range(2, self.params.most_terms + 1):
            ranked = self._ranked(base)
            if not ranked or self.enough(ranked[0], base) or self._idle(ranked, depth - 1):
                break
            self._deepen(level, found, depth)
            level = [m for m in self._ranked(base) if len(m.parts) == depth][: self.params.beam]
            if not level:
                break
        found.models = self._ranked(base)
        self.report(0.95, "weighing", self._best(base))
        return found

    def _idle(self, ranked: Sequence[Fitted], depth: int) -> bool:
        """The last effect added next to nothing: one more would not, either."""
        best = {len(m.parts): self.energy(m) for m in reversed(ranked)}
        return depth - 1 in best and best.get(depth, math.inf) > best[depth - 1] - LEAST_GAIN

    # ---- judging ---------------------------------------------------------------------

    def adequate(self, model: Fitted) -> bool:
        """Nothing is left to explain in any channel, neither in what was fitted nor beyond."""
        worst = 0.0
        for held in (False, True):
            rows = self.case.masked(model.whole, range(len(model.whole)), held)
            stacked = np.concatenate(rows)
            seen = np.maximum(np.isfinite(stacked).sum(0), 1)  # a channel may be in one alone
            worst = max(worst, math.sqrt(np.max(np.nansum(np.square(stacked), axis=0) / seen)))
        return worst <= self.params.adequate

    def enough(self, model: Fitted, base: Fitted) -> bool:
        """Nothing is left that another effect would be worth, or could be seen to close."""
        if self.adequate(model):
            return True
        every = range(len(model.whole))
        pairs = [
            [self.case.masked(m.whole, every, held) for m in (base, model)]
            for held in (True, False)
        ]
        near = max(model.held.rms, model.fit_rms) <= NEAR
        return near and all(evidence.closed_by(*pair) >= self.params.closed for pair in pairs)

    def _ranked(self, base: Fitted) -> list[Fitted]:
        """Models that are better than the one as it came, the best first."""
        worst = self.energy(base)
        better = [m for m in self.fits.values() if self.energy(m) < worst and m.parts]
        return sorted(better, key=lambda m: (self.energy(m) + 0.02 * m.count, m.key))

    def energy(self, model: Fitted) -> float:
        """What a model leaves, as a logarithm: held-out counts as much as fitted."""
        return math.log(model.held.rms) + math.log(model.fit_rms)

    # ---- steps -----------------------------------------------------------------------

    def _tournament(self, wanted: Sequence[tuple], most: int) -> list[Fitted]:
        """Fit roughly, and the best of them to the end."""
        new = [parts for parts in wanted if _key(parts) not in self.fits]
        tasks = [(parts, self.setting) for parts in new]
        tried = sorted(
            ((rms, _key(parts), parts) for rms, parts in self.tasks.each(rough, tasks)),
            key=lambda one: one[:2],
        )
        for rms, key, _ in tried:
            log.info("rough %-50s %8.3f", key, rms)
        near = ALIKE * tried[0][0] if tried else 0.0
        last = [
            parts
            for i, (rms, _, parts) in enumerate(tried)
            if i < most or (i < 2 * most and rms <= near)
        ]
        fitted = self._fit(last)
        best = sorted(fitted, key=lambda m: (self.energy(m), m.key))[: self.params.polished]
        tasks = [(model, self.setting) for model in best]
        for old, model in zip(best, self.tasks.each(polish, tasks), strict=True):
            log.info("polished %-45s %8.3f held %8.3f", model.key, model.fit_rms, model.held.rms)
            if self.energy(model) < self.energy(old):
                self.fits[model.key] = model
        return fitted

    def _fit(self, wanted: Sequence[tuple]) -> list[Fitted]:
        """Fit models, each a tuple of (hypothesis, start), that were not fitted before."""
        new = [parts for parts in wanted if _key(parts) not in self.fits]
        tasks = [(parts, self.setting) for parts in new]
        for parts, fitted in zip(new, self.tasks.each(fit, tasks), strict=True):
            self.fits[_key(parts)] = fitted
            log.info("fit %-50s %8.3f held %8.3f", fitted.key, fitted.fit_rms, fitted.held.rms)
        return [self.fits[_key(parts)] for parts in wanted]

    def _best(self, base: Fitted) -> str:
        """Name of the best model so far."""
        ranked = self._ranked(base)
        return " + ".join(ranked[0].names) if ranked else ""

    def _screen(
        self, model: Fitted, start: float, stop: float, before: Sequence[Screened] = ()
    ) -> list[Screened]:
        """Try every hypothesis on top of a model."""
        starts = {s.hypothesis.key: s.x for s in before}
        hypotheses = [s.hypothesis for s in before if not s.dead] or self.hypotheses
        there = {h.key for h, _ in model.parts}
        wanted = [h for h in hypotheses if h.key not in there]
        found = self._tried(model, wanted, self.only, (start, stop), starts)
        return found if before else self._alone(model, found, stop)

    def _alone(self, model: Fitted, found: list[Screened], at: float) -> list[Screened]:
        """What explains nothing in all records may explain the loudest one.

        A large friction stops a joint in one record; in another one it only shifts a swing, by
        more than was amiss as long as its size is not right.
        """
        loud = self.only[np.argmax([evidence.rms([model.whole[i]]) for i in self.only])]
        idle = [s.hypothesis for s in found if s.share < self.params.screen_share and not s.dead]
        if len(self.only) < 2 or not idle:
            return found
        here, every = (
            float(np.sum(np.square(self.case.vector(model.specs, model.overrides, only))))
            for only in ([loud], self.only)
        )
        better = {}
        for s in self._tried(model, idle, [loud], (at, at), {}):
            better[s.hypothesis.key] = replace(s, share=s.share * here / max(every, 1e-300))
        return [max(s, better.get(s.hypothesis.key, s), key=lambda s: s.share) for s in found]

    def _tried(
        self,
        model: Fitted,
        hypotheses: Sequence[Hypothesis],
        only: Sequence[int],
        span: tuple[float, float],
        starts: Mapping[str, Sequence[float]],
    ) -> list[Screened]:
        """What hypotheses explain of some records on top of a model."""
        specs, overrides = model.specs, model.overrides
        residual = self.case.vector(specs, overrides, only, coarse=True)
        tangent = self._tangent(model, residual, only)
        wanted, (start, stop) = self.bundled(hypotheses), span
        tasks = [
            (
                bundle, specs, overrides, only, residual, tangent,
                [starts.get(h.key) for h in bundle.hypotheses],
            )
            for bundle in wanted
        ]  # fmt: skip
        found = []
        for i, some in enumerate(self.tasks.each(screen, tasks)):
            found += some
            share = start + (stop - start) * (i + 1) / len(tasks)
            self.report(share, f"screening {wanted[i].key}", " + ".join(model.names))
            for one in some:
                log.info("screen %-45s %7.3f cost %d", one.hypothesis.key, one.share, one.cost)
        return found

    def _tangent(
        self, model: Fitted, residual: np.ndarray, only: Sequence[int]
    ) -> np.ndarray | None:
        """Orthonormal columns of what the model's own parameters can do."""
        columns = []
        for i, (hypothesis, x) in enumerate(model.parts):
            for j in range(len(x)):
                moved = list(x)
                moved[j] += 0.1 if hypothesis.coordinates[j].logarithmic else 0.05 * (x[j] or 1.0)
                parts = [*model.parts]
                parts[i] = (hypothesis, tuple(moved))
                specs = [h.term(v).spec for h, v in parts]
                there = self.case.vector(specs, model.overrides, only, coarse=True)
                columns.append(there - residual)
        live = [c / np.linalg.norm(c) for c in columns if np.linalg.norm(c) > 1e-9]
        return np.linalg.qr(np.stack(live, axis=1))[0] if live else None

    def _chosen(self, screened: Sequence[Screened], count: int = 0) -> list[Screened]:
        """Best places of each effect, those effects that explain most."""
        ordered = sorted(screened, key=lambda s: (-s.share, s.hypothesis.key))
        most = ordered[0].share if ordered else 0.0
        least = max(self.params.screen_share, FAR * most)
        chosen: dict[tuple[str, str], list[Screened]] = {}
        for one in ordered:
            places = chosen.setdefault((one.hypothesis.effect, one.hypothesis.variant), [])
            close = not places or (len(places) < PLACES and one.share > CLOSE * places[0].share)
            if one.share >= least and close:
                places.append(one)
        kept = [places for places in chosen.values() if places][: count or self.params.keep]
        return [one for places in kept for one in places]

    def _deepen(self, level: Sequence[Fitted], found: Found, depth: int) -> None:
        """One effect more on each of some models, until one of them leaves nothing."""
        for i, model in enumerate(level):
            at = 0.6 + 0.1 * (depth - 2) + 0.1 * i / max(len(level), 1)
            more = self._screen(model, at, at + 0.05, found.screened)
            chosen = self._chosen(more, AT_LEAST)
            wanted = [(*model.parts, (s.hypothesis, s.x)) for s in chosen]
            fitted = self._tournament(wanted, min(DEEP, self.params.finalists))
            if any(self.enough(m, found.base) for m in fitted):
                break  # rivals of its effects are sought when it is weighed


def _key(parts: Sequence[tuple]) -> str:
    """What is fitted, whatever its values and order."""
    return " + ".join(sorted(hypothesis.key for hypothesis, _ in parts))
