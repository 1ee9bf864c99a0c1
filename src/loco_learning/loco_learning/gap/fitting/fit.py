# SPDX-License-Identifier: Apache-2.0
"""Least-squares fits of one or several hypotheses, with nominal values refitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate

from ..hypotheses.hypotheses import Hypothesis, Term
from ..prediction.case import Case
from ..statistics import evidence
from ..statistics.solve import FIRST, MIN_GAIN, differences, guided, lowest, minimise, soft
from .params import GapParams

JACOBIAN_STEP = 0.12  # finite difference for a Jacobian, in units of a coordinate
SHAPE_UNIT = 0.7  # unit of a logarithmic shape: a factor of two
FACTOR, PART = 0.9, 0.2  # stride of a logarithmic coordinate [log], and of others [range]
SHORT_STRIDE = 0.35  # length of the short stride over that of the long one
FREE_RANGE = 3.0  # largest change of the logarithm of a nominal value
MIN_RATIO = 1e-6  # of a strength on a log scale, over its typical size
STEP = 0.1  # relative stride of a value that is not on a log scale (taste)
EXTRA = 6  # simulations of a fit from another start, and one more per parameter
DEVIATIONS, TURNS = 4.0, 4  # deviations of a value per unit; simulations per parameter (taste)


@dataclass(frozen=True)
class Fitted:
    """A model with effects whose parameters were fitted.

    Attributes:
        parts: Hypotheses with their coordinates.
        overrides: Refitted nominal values by dotted name.
        fit_rms: Whitened rms of the fitted rows [noise floors].
        held: Score of the residual on held-out data.
        whole: Residual of whole records, (T, C) each [noise floors].
        cost: Robust cost of the fit.
        seen: Number of parameters that the data can see (`seen.seen`); None if not known.
        loose: Refitted uncertain values of the robot by dotted name.
        pull: Prior penalty of these values and of the changes of the initial states [nat].
        starts: Change of the initial state of each record [rad, rad/s], (2n,).
        hope: Share of the cost that a fit of these values by simulation may leave; 1 after it.
    """

    parts: tuple[tuple[Hypothesis, tuple[float, ...]], ...]
    overrides: dict[str, Any]
    fit_rms: float
    held: evidence.Score
    whole: tuple[np.ndarray, ...]
    cost: float
    seen: int | None = None
    loose: dict[str, float] = field(default_factory=dict)
    pull: float = 0.0
    starts: tuple[np.ndarray, ...] = ()
    hope: float = 1.0

    @cached_property
    def score(self) -> evidence.Score:
        """Score of the residual on all data."""
        return evidence.score(self.whole)

    @property
    def settled(self) -> dict[str, Any]:
        """All refitted values of the robot, as overrides."""
        return {**self.overrides, **self.loose}

    @property
    def terms(self) -> list[Term]:
        """The effects with their parameters."""
        return [term for hypothesis, x in self.parts for term in hypothesis.terms(x)]

    @property
    def specs(self) -> list[dict[str, Any]]:
        """The effects as in the list of an experiment."""
        return [term.spec for term in self.terms]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects, sorted, each once."""
        return tuple(sorted({hypothesis.effect for hypothesis, _ in self.parts}))

    @property
    def key(self) -> str:
        """Names of the hypotheses, for sorting."""
        return " + ".join(sorted(hypothesis.key for hypothesis, _ in self.parts))

    @property
    def count(self) -> int:
        """Fitted parameters."""
        return sum(len(hypothesis.coordinates) for hypothesis, _ in self.parts)

    def moved(self, index: int, x: Sequence[float]) -> list[dict[str, Any]]:
        """The effects with one of them at other coordinates, as in the list of an experiment."""
        parts = [*self.parts]
        parts[index] = (parts[index][0], tuple(x))
        return specs_of(parts)

    @property
    def paid(self) -> int:
        """Number of parameters that are penalised: those the data can see, all if not known."""
        return self.count if self.seen is None else self.seen

    @property
    def strain(self) -> float:
        """Prior penalty of shapes, of values of the robot and of initial states [nat]."""
        shapes = 0.5 * sum(np.square(_unusual(h, x)).sum() for h, x in self.parts)
        return shapes + self.pull


def specs_of(parts: Sequence[tuple[Hypothesis, Sequence[float]]]) -> list[dict[str, Any]]:
    """Effects at coordinates, as in the list of an experiment."""
    return [term.spec for hypothesis, x in parts for term in hypothesis.terms(x)]


class Problem:
    """Residual of a case as a function of all free numbers: effects, then nominal values."""

    def __init__(
        self,
        case: Case,
        parts: Parts,
        setting: Setting,
        free: Mapping[str, float] | None = None,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ):
        """Arrange the coordinates of effects and nominal values in one vector.

        Args:
            case: Model and data.
            parts: Hypotheses with the coordinates to start from.
            setting: Settings that all fits share.
            free: Initial guesses of the refitted nominal values, instead of those of `setting`.
            only: Indices of the records that are fitted; default all.
            coarse: Whether to simulate with the larger time steps of the model.
        """
        self.case, self.parts, self.scale, self.only = case, list(parts), setting.scale, only
        self.free, self.coarse = dict(free or setting.free), coarse
        self.nominal, self.spread = setting.nominal, setting.params.free_spread
        self.evaluations = setting.params.evaluations
        self.each = [
            (h, *row)
            for h, x in self.parts
            for row in zip(h.coordinates, x, _units(h, x), strict=True)
        ]
        logs = [math.log(self.free[n] / self.nominal[n]) for n in self.free]
        bounds = [b for h, _ in self.parts for b in map(_bounds, h.coordinates)]
        low, high = np.array([*bounds, *[(-FREE_RANGE, FREE_RANGE)] * len(logs)]).T.reshape(2, -1)
        x = np.array([*(v for _, _, v, _ in self.each), *logs])
        self.units = np.array([*(unit for *_, unit in self.each), *(0.3 for _ in logs)])
        ratios = [*(_ratio(h, c, v) for h, c, v, _ in self.each), *(False for _ in logs)]
        self.ratios = np.array(ratios, dtype=bool)
        low[self.ratios] = np.maximum(low[self.ratios], MIN_RATIO)
        self.start, *self.bounds = (self._scaled(v) for v in (x, low, high))

    def _scaled(self, x: np.ndarray) -> np.ndarray:
        """Coordinates in their units; strengths that are fitted as ratios on a log scale."""
        return np.where(self.ratios, np.log(np.where(self.ratios, x, 1.0)), x) / self.units

    def split(self, z: np.ndarray) -> tuple[list, dict[str, Any]]:
        """Parts with their coordinates, and nominal values, at a point."""
        x, parts, at = z * self.units, [], 0
        x[self.ratios] = np.exp(x[self.ratios])
        for hypothesis, _ in self.parts:
            count = len(hypothesis.coordinates)
            parts.append((hypothesis, tuple(float(v) for v in x[at : at + count])))
            at += count
        logs = zip(self.free, x[at:], strict=True)
        return parts, {n: self.nominal[n] * math.exp(v) for n, v in logs}

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Robust residual of all fitted values, then residuals of the priors, (N + P,)."""
        parts, overrides = self.split(z)
        pulled = self.case.pulled(specs_of(parts), overrides, self.only, self.coarse)
        return self.line(z, *pulled)

    @property
    def budget(self) -> int:
        """Largest number of simulations of a fit."""
        return self.evaluations + 5 * (len(self.start) - 1)

    @property
    def quick(self) -> Problem | None:
        """The problem with the larger steps of the model, if its Jacobian is nearly the same."""
        if self.coarse or not self.case.quickly(specs_of(self.parts)):
            return None
        other = copy(self)
        other.coarse = True
        return other

    def line(self, z: np.ndarray, residual: np.ndarray, by: np.ndarray) -> np.ndarray:
        """As `__call__`, from residuals and deviations of the refitted values (`Case.pulled`)."""
        parts, overrides = self.split(z)
        priors = [v for hypothesis, x in parts for v in _unusual(hypothesis, x)]
        logs = [math.log(overrides[n] / self.nominal[n]) / self.spread for n in self.free]
        return np.concatenate([soft(residual, self.scale), priors, logs, by])


def _units(hypothesis: Hypothesis, x: Sequence[float]) -> np.ndarray:
    """Unit of each coordinate: its initial size, a factor of two, or a small angle.

    Strengths are not scaled by their prior, since robots differ by orders of magnitude.
    """
    largest = max((abs(x[i]) for i in hypothesis.strengths), default=0.0) or 1.0
    return np.array(
        [
            SHAPE_UNIT
            if c.logarithmic or _ratio(hypothesis, c, v)
            else max(abs(v), 0.1 * largest)
            if c.strength
            else min(max(abs(v), 0.3), 1.0)
            for c, v in zip(hypothesis.coordinates, x, strict=True)
        ]
    )


def _is_nonsmooth(hypothesis: Hypothesis) -> bool:
    """True for a non-smooth effect at one place."""
    return not (EFFECTS[hypothesis.effect].identity.smooth or hypothesis.joints)


def _ratio(hypothesis: Hypothesis, c: Coordinate, v: float) -> bool:
    """True for a strength of a single non-smooth effect, which is fitted on a log scale.

    The right stiffness of a stop may be a hundred times the screened one, and has no upper end.
    """
    return _is_nonsmooth(hypothesis) and c.strength and c.one_sided and v > 0.0


def _unusual(hypothesis: Hypothesis, x: Sequence[float]) -> list[float]:
    """Logarithmic shapes divided by their prior standard deviation."""
    return [
        v / max(max(map(abs, c.start)), 0.7)
        for c, v in zip(hypothesis.coordinates, x, strict=True)
        if not c.strength and c.logarithmic
    ]


def _bounds(coordinate: Coordinate) -> tuple[float, float]:
    """Bounds of a coordinate."""
    if coordinate.logarithmic:
        low = coordinate.inverse(max(coordinate.low, 1e-6 * coordinate.size))
        high = coordinate.inverse(min(coordinate.high, 1e6 * coordinate.size))
        return low, high
    return tuple(sorted((coordinate.inverse(coordinate.low), coordinate.inverse(coordinate.high))))


Parts = Sequence[tuple[Hypothesis, Sequence[float]]]


@dataclass(frozen=True)
class Setting:
    """Settings that all fits of a case share.

    Attributes:
        params: Settings of the user.
        nominal: Nominal values that are refitted, before the search.
        free: Initial guesses of these values.
        scale: Scale of the robust loss [floors].
        only: Indices of the records for rough fits.
        hopeless: Cost in the model's own steps from which on a fit ends there.
    """

    params: GapParams
    nominal: dict[str, float]
    free: dict[str, float]
    scale: float
    only: tuple[int, ...]
    hopeless: float = math.inf


def rough_fit(case: Case, parts: Parts, setting: Setting) -> tuple[float, tuple]:
    """Fit with a few iterations on some records, simulated with the larger steps of the model.

    Returns:
        Whitened rms on these records, and the parts with their coordinates.
    """
    only, params = list(setting.only), setting.params
    problem = Problem(case, parts, setting, None, only, True)
    count = len(problem.start)
    solution = minimise(
        problem, problem.start, problem.bounds, JACOBIAN_STEP, params.rough + 2 * count
    )
    moved, overrides = problem.split(solution.z)
    specs = specs_of(moved)
    residual = soft(case.vector(specs, overrides, only, True), setting.scale)
    return float(np.sqrt(np.mean(np.square(residual)))), tuple(moved)


def fit(case: Case, parts: Parts, setting: Setting, seek: bool = True) -> Fitted:
    """Fit hypotheses together and evaluate the residual on held-out data.

    They are fitted in the model's own steps, then with a correction for the error of these or, if
    it is not known, in finer ones.

    Args:
        case: Model and data.
        parts: Hypotheses with their initial coordinates; empty for the initial model.
        setting: Settings that all fits share.
        seek: Whether values of the robot are fitted by simulation where that is needed.
    """
    problem = Problem(case, parts, setting, coarse=True)
    if not len(problem.start):
        return weigh(case, parts, {}, seek=seek)
    limit = problem.budget
    solution = minimise(problem, problem.start, problem.bounds, JACOBIAN_STEP, limit)
    parts, overrides = problem.split(solution.z)
    if solution.cost > setting.hopeless:
        return weigh(case, parts, overrides, solution.cost, seek=False)
    problem.case, problem.coarse = case.corrected(specs_of(parts), overrides), False
    terms = max(4, limit // 2), solution.jacobian, problem.quick
    solution = minimise(problem, solution.z, problem.bounds, JACOBIAN_STEP, *terms)
    return weigh(problem.case, *problem.split(solution.z), solution.cost, seek=seek)


def refit_model(case: Case, parts: Parts, setting: Setting, about: Sequence[Mapping]) -> Fitted:
    """Fit hypotheses; refitted values of the robot are linearised about a model with effects.

    A large effect changes the sensitivities to masses and drives. With sensitivities of the
    initial model, the linearisation error could be attributed to an effect that is not there.

    Args:
        case: Model and data.
        parts: Hypotheses with their initial coordinates.
        setting: Settings that all fits share.
        about: Effects of the model.
    """
    return fit(case.relined(about), parts, setting)


def refine(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Search beyond the local minimum of a model, and fit values of the robot by simulation.

    The model is returned unchanged if no refit lowers the residual.
    """
    if not model.parts and not model.overrides:
        return model
    exact = case.corrected(model.specs, model.overrides)
    candidate = model  # values of the robot are fitted by simulation at the end alone
    for search in (escape, to_minimum):  # with refitted values linearised, which may mislead
        candidate = min((candidate, search(exact, candidate, setting)), key=_expected_rms)
    return min((model, jointly(exact, candidate, setting)), key=_left)


def to_minimum(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """The model at a minimum that half or twice a value of a non-smooth effect does not lower.

    Motion against a stop, or friction that sticks, depends on such values in steps, and finite
    differences about one of them may point nowhere.
    """
    params, problem = setting.params, Problem(case, model.parts, setting, model.overrides)
    strides = _halves(problem)
    if not strides:
        return model
    budgets = params.beyond, problem.budget
    terms = problem.bounds, JACOBIAN_STEP, strides, budgets, problem.quick
    solution = lowest(problem, problem.start, *terms)
    if np.array_equal(solution.z, problem.start):
        return model
    return weigh(case, *problem.split(solution.z), solution.cost, seek=False)


def _halves(problem: Problem) -> list[tuple[int, float]]:
    """Indices of the coordinates of single non-smooth effects, and strides along them."""
    return [
        (i, (math.log(2.0) if c.logarithmic or problem.ratios[i] else STEP * abs(v)) / unit)
        for i, (h, c, v, unit) in enumerate(problem.each)
        if _is_nonsmooth(h) and v
    ]


def jointly(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Fit effects and uncertain values of the robot together, by simulation.

    Where the data are linear in the uncertain values, the earlier fit has done this. Otherwise
    the first steps use sensitivities about the fitted model; if the residual does not fall as they
    predict, each value is perturbed in a simulation.
    """
    if not model.loose or case.straight(model.specs, model.overrides):
        return model
    problem = Problem(case, model.parts, setting, model.overrides)
    start = case.loose.deviations(model.loose) / DEVIATIONS
    count, reach = len(start), [limits / DEVIATIONS for limits in case.loose.reach]
    problem.case = case.at(DEVIATIONS * start)
    extrapolate = problem.case.extrapolated(model.specs, model.overrides, case.fitted)

    def promise(z: np.ndarray) -> np.ndarray:
        return problem.line(problem.start, *case.flat(*extrapolate(DEVIATIONS * z), case.fitted))

    def residual(z: np.ndarray, of: Problem = problem) -> np.ndarray:
        of.case = case.at(DEVIATIONS * z[:count])
        return of(z[count:])

    r, highest = promise(start), problem.bounds[1]
    robot = differences(promise, start, r, np.full(count, JACOBIAN_STEP), reach[1])
    coarse, steps = problem.quick, np.full(len(highest), JACOBIAN_STEP)
    other = coarse or problem
    effects = differences(other, problem.start, other(problem.start), steps, highest, np.inf)
    bounds = [np.r_[x, y] for x, y in zip(reach, problem.bounds, strict=True)]
    z, slopes = np.r_[start, problem.start], np.hstack([robot, effects])
    budgets = FIRST + len(problem.start), TURNS * len(z) + EXTRA
    fast = partial(residual, of=coarse) if coarse else None
    solution = guided(residual, z, bounds, JACOBIAN_STEP, budgets, slopes, model.cost, fast)
    parts, overrides = problem.split(solution.z[count:])
    values = case.loose.values(DEVIATIONS * solution.z[:count])
    refit = weigh(case, parts, overrides, solution.cost, fixed=values)
    return min((model, refit), key=_left)


def converge(case: Case, parts: Parts, overrides: Mapping[str, Any], cost: float = 0.0) -> Fitted:
    """Model with refitted values of the robot, corrected for its own step error (see `weigh`)."""
    return weigh(case.corrected(specs_of(parts), overrides), parts, overrides, cost)


def escape(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Search for a lower minimum, one coordinate and one stride at a time, while it improves.

    A shape such as a time constant or a radius has several minima. So has an angle where a drive
    quantises its encoder: the motion is nearly the same one encoder step further on. Models of
    several effects are not searched: they start from fits of single effects. The steps of the
    model tell minima apart; only from the one that is found on, finer ones are taken.
    """
    if len(model.parts) > 1:
        return model
    params = setting.params
    problem = Problem(case, model.parts, setting, model.overrides, coarse=True)
    strides = _strides(problem)
    if not strides:
        return model
    r = problem(problem.start)
    z, cost, left = problem.start, 0.5 * float(r @ r), params.beyond
    for index, stride in strides:
        for share in (1.0, -1.0, SHORT_STRIDE, -SHORT_STRIDE):
            while left > 0:
                moved = z.copy()
                moved[index] += share * stride
                if not problem.bounds[0][index] <= moved[index] <= problem.bounds[1][index]:
                    break
                solution = minimise(problem, moved, problem.bounds, JACOBIAN_STEP, len(z) + EXTRA)
                left -= solution.evaluations
                if not solution.cost < cost - MIN_GAIN:
                    break
                z, cost = solution.z, solution.cost
    if z is problem.start:
        return model
    parts, overrides = problem.split(z)
    if case.step_of(specs_of(parts)) == 1.0:
        return weigh(case, parts, overrides, cost, seek=False)
    reduced = replace(setting, params=params.replace(evaluations=EXTRA), free=overrides)
    refitted = fit(case, parts, reduced, seek=False)
    return min((model, refitted), key=lambda m: m.fit_rms * math.sqrt(m.hope))


def _strides(problem: Problem) -> list[tuple[int, float]]:
    """Indices of coordinates that may have several minima, and the distance between these."""
    step, strides = problem.case.forward._robot(0, {}, 1.0).encoder_step, []
    for i, (_, c, v, unit) in enumerate(problem.each):
        if c.logarithmic:
            strides.append((i, FACTOR / unit))
        elif not c.strength:
            width = np.ptp(c.start) if len(c.start) > 1 else PART * (c.high - c.low) / c.size
            strides.append((i, float(width) / unit))
        elif step > 0.0 and c.unit == "rad":
            width = step / c.size
            strides.append((i, (math.log1p(width / v) if problem.ratios[i] else width) / unit))
    return strides


def _left(model: Fitted) -> float:
    return model.fit_rms * model.held.rms


def _expected_rms(model: Fitted) -> float:
    """As `_left`, after a fit of the robot's values by simulation that keeps its promise."""
    return model.hope * _left(model)


def weigh(
    case: Case,
    parts: Parts,
    overrides: Mapping[str, Any],
    cost: float = 0.0,
    initial: bool = False,
    fixed: Mapping[str, float] | None = None,
    seek: bool = True,
) -> Fitted:
    """Residuals of a model on all data; with `initial`, nothing of the user's model is refitted.

    `fixed` holds uncertain values of the robot that were fitted together with the effects.
    """
    specs = specs_of(parts)
    basis = case.kept() if initial else case
    residuals, loose, pull, starts, hope = basis.suited(specs, overrides, fixed, seek)
    held = case.judged(residuals)
    rms = evidence.rms(case.masked(residuals, range(len(residuals)), held=False))
    return Fitted(
        tuple(parts), dict(overrides), rms, held, tuple(residuals), cost, None, loose, pull, starts,
        hope,
    )  # fmt: skip
