# SPDX-License-Identifier: Apache-2.0
"""Fit hypotheses, one or several together, with the nominal parameters refitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..hypotheses.hypotheses import Hypothesis, Term
from ..params import GapParams
from ..prediction.case import Case
from ..statistics import evidence
from ..statistics.solve import FEW, FIRST, differences, guided, minimise, soft

JACOBIAN_STEP = 0.12  # difference for a Jacobian, in units of a coordinate
SHAPE_UNIT = 0.7  # unit of a logarithmic shape: a factor of two
FACTOR, PART = 0.9, 0.2  # stride of a logarithm, and of a range
SHORT_STRIDE = 0.35  # a short stride over a long one
FREE_RANGE = 3.0  # most that the logarithm of a nominal value may change
AGAIN = 6  # simulations of a fit from another start, and one per parameter
DEVIATIONS, TURNS = 4.0, 4  # of a value in one unit; simulations per number of a joint fit (taste)


@dataclass(frozen=True)
class Fitted:
    """A model with effects whose parameters were fitted.

    Attributes:
        parts: Hypotheses with their coordinates.
        overrides: Nominal values that were refitted.
        fit_rms: Whitened rms on what was fitted.
        held: Score of what it leaves on the data that judge.
        whole: Residual of whole records, (T, C) each.
        cost: Robust cost of the fit.
        seen: Parameters that the data can see, where that was asked (`seen.seen`).
        loose: Values of the robot that suit it best, where all models have them refitted.
        pull: Price of these and of where records begin, which priors ask [nat].
        starts: Change of positions and velocities at the start of each record [rad, rad/s], (2n,).
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

    @cached_property
    def score(self) -> evidence.Score:
        """Score of what it leaves on all data."""
        return evidence.score(self.whole)

    @property
    def settled(self) -> dict[str, Any]:
        """All values of the robot that the model has, as overrides."""
        return {**self.overrides, **self.loose}

    @property
    def terms(self) -> list[Term]:
        """The effects with their parameters."""
        return [term for hypothesis, x in self.parts for term in hypothesis.terms(x)]

    @property
    def specs(self) -> list[dict[str, Any]]:
        """The effects as in an experiment's list."""
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
        """The effects with one of them at other coordinates, as in an experiment's list."""
        parts = [*self.parts]
        parts[index] = (parts[index][0], tuple(x))
        return specs_of(parts)

    @property
    def paid(self) -> int:
        """Parameters that are paid for: those that the data can see, all where nobody asked."""
        return self.count if self.seen is None else self.seen

    @property
    def strain(self) -> float:
        """Price of what priors call unusual [nat], in shapes, values and where records begin."""
        shapes = 0.5 * sum(np.square(_unusual(h, x)).sum() for h, x in self.parts)
        return shapes + self.pull


def specs_of(parts: Sequence[tuple[Hypothesis, Sequence[float]]]) -> list[dict[str, Any]]:
    """Effects at coordinates, as in an experiment's list."""
    return [term.spec for hypothesis, x in parts for term in hypothesis.terms(x)]


class Problem:
    """Residual of a case as a function of all free numbers: effects, then nominal values."""

    def __init__(
        self,
        case: Case,
        parts: Sequence[tuple[Hypothesis, Sequence[float]]],
        free: Mapping[str, float],
        nominal: Mapping[str, float],
        spread: float,
        scale: float,
        only: Sequence[int] | None = None,
        coarse: bool = False,
    ):
        """Lay out coordinates.

        Args:
            case: Model and data.
            parts: Hypotheses with the coordinates to start from.
            free: Nominal values that are refitted, and where they start.
            nominal: Nominal values as the model has them.
            spread: Standard deviation of their logarithm.
            scale: Scale of the robust loss [floors].
            only: Records that are fitted; default all.
            coarse: Simulate in the model's own steps.
        """
        self.case, self.parts, self.scale, self.only = case, list(parts), scale, only
        self.coarse = coarse
        self.free, self.nominal, self.spread = dict(free), dict(nominal), spread
        self.units = np.concatenate(
            [_units(h, x) for h, x in self.parts] + [np.full(len(self.free), 0.3)]
        )
        flat = [v for _, x in self.parts for v in x]
        logs = [math.log(self.free[n] / self.nominal[n]) for n in self.free]
        self.start = np.array([*flat, *logs]) / self.units
        bounds = [b for h, _ in self.parts for b in map(_bounds, h.coordinates)]
        bounds += [(-FREE_RANGE, FREE_RANGE)] * len(self.free)
        low, high = np.array(bounds).T.reshape(2, -1)
        self.bounds = low / self.units, high / self.units

    def split(self, z: np.ndarray) -> tuple[list, dict[str, Any]]:
        """Parts with their coordinates, and nominal values, at a point."""
        x, parts, at = z * self.units, [], 0
        for hypothesis, _ in self.parts:
            count = len(hypothesis.coordinates)
            parts.append((hypothesis, tuple(float(v) for v in x[at : at + count])))
            at += count
        logs = zip(self.free, x[at:], strict=True)
        return parts, {n: self.nominal[n] * math.exp(v) for n, v in logs}

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Robust residual of all fitted values, then what the priors say, (N + P,)."""
        parts, overrides = self.split(z)
        pulled = self.case.pulled(specs_of(parts), overrides, self.only, self.coarse)
        return self.line(z, *pulled)

    def line(self, z: np.ndarray, residual: np.ndarray, by: np.ndarray) -> np.ndarray:
        """The same from residuals and deviations of what is refitted, as of `Case.pulled`."""
        parts, overrides = self.split(z)
        priors = [v for hypothesis, x in parts for v in _unusual(hypothesis, x)]
        logs = [math.log(overrides[n] / self.nominal[n]) / self.spread for n in self.free]
        return np.concatenate([soft(residual, self.scale), priors, logs, by])


def _units(hypothesis: Hypothesis, x: Sequence[float]) -> np.ndarray:
    """One unit of each coordinate: the size at the start, a factor of two, or a small angle.

    A strength may be far below what priors call typical: robots differ by orders of magnitude.
    """
    largest = max((abs(x[i]) for i in hypothesis.strengths), default=0.0) or 1.0
    return np.array(
        [
            SHAPE_UNIT
            if c.logarithmic
            else max(abs(v), 0.1 * largest)
            if c.strength
            else min(max(abs(v), 0.3), 1.0)
            for c, v in zip(hypothesis.coordinates, x, strict=True)
        ]
    )


def _unusual(hypothesis: Hypothesis, x: Sequence[float]) -> list[float]:
    """Logarithmic shapes over their prior deviation."""
    return [
        v / max(max(map(abs, c.start)), 0.7)
        for c, v in zip(hypothesis.coordinates, x, strict=True)
        if not c.strength and c.logarithmic
    ]


def _bounds(coordinate: Any) -> tuple[float, float]:
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
        nominal: Nominal values that are refitted, as the model has them.
        free: Nominal values at which fits start.
        scale: Scale of the robust loss [floors].
        only: Records of rough fits.
    """

    params: GapParams
    nominal: dict[str, float]
    free: dict[str, float]
    scale: float
    only: tuple[int, ...]


def rough(case: Case, parts: Parts, setting: Setting) -> tuple[float, tuple]:
    """A few steps on some of the records, simulated in the model's own steps.

    Returns:
        Whitened rms there, and the parts with their coordinates.
    """
    only, params = list(setting.only), setting.params
    problem = Problem(
        case, parts, setting.free, setting.nominal, params.free_spread, setting.scale, only, True
    )
    count = len(problem.start)
    found = minimise(
        problem, problem.start, problem.bounds, JACOBIAN_STEP, params.rough + 2 * count
    )
    moved, overrides = problem.split(found.z)
    specs = specs_of(moved)
    residual = soft(case.vector(specs, overrides, only, True), setting.scale)
    return float(np.sqrt(np.mean(np.square(residual)))), tuple(moved)


def fit(case: Case, parts: Parts, setting: Setting) -> Fitted:
    """Fit hypotheses together and weigh what they leave on the data that judges.

    Args:
        case: Model and data.
        parts: Hypotheses with the coordinates to start from; none is the model as it came.
        setting: Settings that all fits share.
    """
    params = setting.params
    problem = Problem(case, parts, setting.free, setting.nominal, params.free_spread, setting.scale)
    z, cost = problem.start, 0.0
    if len(z):
        limit = params.evaluations + 5 * (len(z) - 1)
        found = minimise(problem, problem.start, problem.bounds, JACOBIAN_STEP, limit)
        z, cost = found.z, found.cost
    parts, overrides = problem.split(z)
    return weigh(case, parts, overrides, cost)


def anew(case: Case, parts: Parts, setting: Setting, about: Sequence[Mapping]) -> Fitted:
    """Fit hypotheses with what is refitted simulated about a model, not about the bare one.

    A large effect changes what masses and drives do. Where straight lines about the bare model
    miss that, what they leave gets the name of an effect that is none.

    Args:
        case: Model and data.
        parts: Hypotheses with the coordinates to start from.
        setting: Settings that all fits share.
        about: Effects of the model.
    """
    return fit(case.relined(about), parts, setting)


def polish(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Fit a model again with its own step error, and look past the minimum it ended in.

    The fit stays as it is where nothing explains more.
    """
    if not model.parts and not model.overrides:
        return model
    exact, params = case.corrected(model.specs, model.overrides), setting.params
    if exact is not case:
        few = params.replace(evaluations=max(4, params.evaluations // 2))
        free = model.overrides or setting.free
        again = fit(exact, model.parts, replace(setting, params=few, free=free))
        model = min((again, model), key=_left)
    model = min((model, beyond(exact, model, setting)), key=_left)
    return jointly(exact, model, setting)


def jointly(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Effects and what nobody knows exactly of the robot, fitted together by simulation.

    Where straight lines about the robot as it came tell the truth, the fit has done that. Where
    they do not, they say at first what each value of the robot does, about the fitted model; only
    where that does not lead to what they promised, each value is changed in a simulation.
    """
    if not model.loose or case.straight(model.specs, model.overrides):
        return model
    params, free = setting.params, model.overrides or setting.free
    problem = Problem(case, model.parts, free, setting.nominal, params.free_spread, setting.scale)
    start = case.loose.deviations(model.loose) / DEVIATIONS
    count, reach = len(start), [ends / DEVIATIONS for ends in case.loose.reach]
    problem.case = case.at(DEVIATIONS * start)
    told = problem.case.extrapolated(model.specs, model.overrides, case.fitted)

    def promise(z: np.ndarray) -> np.ndarray:
        return problem.line(problem.start, *case.flat(*told(DEVIATIONS * z), case.fitted))

    def residual(z: np.ndarray) -> np.ndarray:
        problem.case = case.at(DEVIATIONS * z[:count])
        return problem(z[count:])

    r, highest = promise(start), problem.bounds[1]
    robot = differences(promise, start, r, JACOBIAN_STEP, reach[1])
    effects = differences(problem, problem.start, r, JACOBIAN_STEP, highest)
    bounds = [np.r_[mine, own] for mine, own in zip(reach, problem.bounds, strict=True)]
    z, slopes = np.r_[start, problem.start], np.hstack([robot, effects])
    budgets = FIRST + len(problem.start), TURNS * len(z) + AGAIN
    found = guided(residual, z, bounds, JACOBIAN_STEP, budgets, slopes, model.cost)
    parts, overrides = problem.split(found.z[count:])
    known = case.loose.values(DEVIATIONS * found.z[:count])
    again = weigh(case, parts, overrides, found.cost, known=known)
    return min((model, again), key=_left)


def beyond(case: Case, model: Fitted, setting: Setting) -> Fitted:
    """Look for a deeper minimum, one coordinate and one stride at a time, as far as it helps.

    A shape such as a time or a radius has several minima. So has an angle where a drive rounds
    its encoder: the motion is nearly the same a step of the encoder further on. Models of
    several effects start where those of one ended.
    """
    if len(model.parts) > 1:
        return model
    params, free = setting.params, model.overrides or setting.free
    problem = Problem(case, model.parts, free, setting.nominal, params.free_spread, setting.scale)
    strides = _strides(case, model.parts, problem.units)
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
                found = minimise(problem, moved, problem.bounds, JACOBIAN_STEP, len(z) + AGAIN)
                left -= found.evaluations
                if not found.cost < cost - FEW:
                    break
                z, cost = found.z, found.cost
    if z is problem.start:
        return model
    parts, overrides = problem.split(z)
    return weigh(case, parts, overrides, cost)


def _strides(case: Case, parts: Parts, units: np.ndarray) -> list[tuple[int, float]]:
    """Coordinates that may have several minima, and how far apart these may be."""
    robot = case.forward._robot(0, {}, 1.0)
    step = max((getattr(d, "resolution", 0.0) for d in robot.drives.values()), default=0.0)
    found = []
    for i, c in enumerate(c for hypothesis, _ in parts for c in hypothesis.coordinates):
        if c.logarithmic:
            found.append((i, FACTOR / units[i]))
        elif not c.strength:
            spread = np.ptp(c.start) if len(c.start) > 1 else PART * (c.high - c.low) / c.size
            found.append((i, float(spread) / units[i]))
        elif step > 0.0 and c.unit == "rad":
            found.append((i, step / c.size / units[i]))
    return found


def _left(model: Fitted) -> float:
    return model.fit_rms * model.held.rms


def weigh(
    case: Case,
    parts: Parts,
    overrides: Mapping[str, Any],
    cost: float = 0.0,
    given: bool = False,
    known: Mapping[str, float] | None = None,
) -> Fitted:
    """Residuals of a model on everything; `given` is the user's own, with nothing refitted.

    `known` are values of the robot from which those that suit the model are sought, too.
    """
    specs = specs_of(parts)
    own = case.kept() if given else case
    whole, loose, pull, starts = own.suited(specs, overrides, known)
    held = case.judged(whole)
    rms = evidence.rms(case.masked(whole, range(len(whole)), held=False))
    return Fitted(
        tuple(parts), dict(overrides), rms, held, tuple(whole), cost, None, loose, pull, starts
    )
