# SPDX-License-Identifier: Apache-2.0
"""Values that nobody knows exactly, refitted to every model without a simulation.

These are values of the robot (`nominal`) and the states in which records begin. The change of the
residual by each is simulated once. From then on those that suit a model best, within their
priors, are linear least squares. Torques along a given motion are linear in masses, centres and
inertias. A motion is so for small changes alone: there nothing moves by more than `MOST`
deviations, and the changes are simulated about the values that suit the robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..statistics import evidence
from .nominal import legal, nominal_value

PART = 0.5  # of a deviation that is simulated; the rest is taken as linear (taste)
ROUNDS = 3  # of the weights, each with what the one before leaves (taste)
TIMES, NEAR = 4, 0.5  # that changes are simulated, at most; deviations that need no more (taste)
MOST = 2.5  # deviations that a value may be off where a motion is compared: beyond is an effect
LEAST = 0.2  # of an inertia, mass or gain that must be left where a motion is compared (taste)
ON_BOUND = 1e-6  # deviations from the largest that count as there (theory: rounding)
CHANCE = 2.0  # cost of values as they were that chance explains [nat] (theory: 95 % of one value)
LEVELS, SAME = 8, 0.9  # rounds of what is left in each channel, until that falls by less (taste)
CHANGES = 20  # of what lies on a bound, at most


class Products(NamedTuple):
    """Sums over time of a residual, for each channel."""

    square: np.ndarray  # of its squares, at all times, (C,)
    moment: np.ndarray  # with what each value and start does, where it is used, (C, K)
    every: np.ndarray  # the same at all times, (C, K)


@dataclass(frozen=True)
class Loose:
    """Linear nuisance: V values of the robot, then what each record begins with.

    Attributes:
        names: Values by dotted name, N of them.
        nominal: Value of each as the robot says it, (N,).
        spread: Standard deviation of each, (N,).
        legal: Smallest and largest value of each, (N, 2).
        of: Index among the V of each; values that change together have the same, (N,).
        columns: Change of the residual [floors] per deviation, (T, C, V + S) per record, with S
            deviations of its own start; 0 where nothing was measured.
        weight: Information of a residual of 1 floor in each channel, (C,).
        rows: Rows of each record that are fitted, (T,) flags.
        judges: Rows that only judge: there a record's own start is found where none is fitted.
        most: Largest deviations.
        at: Deviations of the values about which models are simulated, (V,).
        stated: Flags of the V that robot.yaml calls uncertain: these may be large, (V,).
        held: Values stay as they are, and the starts alone are refitted.
        level: A channel in which more is left counts less, as in a motion.
        grams: Products of the columns in each channel, where they are used and at all times,
            (C, K, K), by record.
    """

    names: tuple[str, ...]
    nominal: np.ndarray
    spread: np.ndarray
    legal: np.ndarray
    of: np.ndarray
    columns: tuple[np.ndarray, ...]
    weight: np.ndarray
    rows: tuple[np.ndarray, ...]
    judges: tuple[np.ndarray, ...]
    most: float
    at: np.ndarray
    stated: np.ndarray
    held: bool = False
    level: bool = False
    grams: dict[int, tuple[np.ndarray, np.ndarray]] = field(
        default_factory=dict, compare=False, repr=False
    )

    @property
    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest deviations that values may have, (V,) each."""
        high = np.full(len(self.at), self.most)
        low = -high
        if math.isfinite(self.most):
            ends = (self.legal - self.nominal[:, None]) / self.spread[:, None]
            np.maximum.at(low, self.of, ends[:, 0])
            np.minimum.at(high, self.of, ends[:, 1])
        return low, high

    def best(self, residuals: Sequence[np.ndarray], only: Sequence[int]) -> list[np.ndarray]:
        """Deviations that suit a model best: of the values, (V,), and of each start, (S,) each.

        Args:
            residuals: Residuals of the model [floors], (T, C) each, simulated at `at`.
            only: Their records.
        """
        seen = [self._products(i, r) for i, r in zip(only, residuals, strict=True)]
        if not self.level:
            return self._solved(seen, only, self.weight)
        by, before = self._none(only), np.inf
        count = np.maximum(np.sum([np.isfinite(r).sum(0) for r in residuals], axis=0), 1)
        for _ in range(LEVELS):
            power = self._power(seen, only, by) / count
            if np.all(power > SAME * before):
                break
            by, before = self._solved(seen, only, self.weight / np.maximum(power, 1.0)), power
        return by

    def _none(self, only: Sequence[int]) -> list[np.ndarray]:
        count = len(self.at)
        return [self.at, *(np.zeros(self.columns[i].shape[2] - count) for i in only)]

    def _products(self, index: int, residual: np.ndarray) -> Products:
        """All that is asked of the residual of a record, so that it is gone through once."""
        columns = self.columns[index]
        known = np.isfinite(residual)
        rows = self.rows[index] if self.rows[index].any() else self.judges[index]
        values = np.where(known, residual, 0.0)
        own = values * rows[:, None]
        moment = _moment(columns, own)
        every = moment if rows.all() else moment + _moment(columns, values - own)
        if index not in self.grams:  # what was measured is so for every model
            used = _gram(columns, known & rows[:, None])
            whole = used if rows.all() else used + _gram(columns, known & ~rows[:, None])
            self.grams[index] = used, whole
        return Products(np.sum(np.square(values), axis=0), moment, every)

    def _power(
        self, seen: Sequence[Products], only: Sequence[int], by: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Squares of what is left in each channel with everything at deviations `by`, (C,)."""
        power, moved = np.zeros(len(self.weight)), by[0] - self.at
        for i, products, start in zip(only, seen, by[1:], strict=True):
            x = np.concatenate([moved, start])
            square = products.square + (2.0 * products.every + self.grams[i][1] @ x) @ x
            power += np.maximum(square, 0.0)
        return power

    def _solved(
        self, seen: Sequence[Products], only: Sequence[int], weight: np.ndarray
    ) -> list[np.ndarray]:
        count = len(self.at)
        sizes = [len(by) for by in self._none(only)]
        ends = np.cumsum(sizes)
        gram, moment = np.eye(ends[-1]), np.zeros(ends[-1])
        for k, (i, products) in enumerate(zip(only, seen, strict=True)):
            mine = np.r_[np.arange(count), np.arange(ends[k], ends[k + 1])]
            some = weight @ products.moment
            whole = np.tensordot(weight, self.grams[i][0], axes=1)
            if not self.rows[i].any():  # what judges says nothing of the robot
                whole[:count], whole[:, :count], some[:count] = 0.0, 0.0, 0.0
            gram[np.ix_(mine, mine)] += whole
            moment[mine] -= some
            moment[mine] += whole[:, :count] @ self.at
        if self.held:
            free = np.arange(count, ends[-1])
            found = np.concatenate([self.at, np.zeros(len(free))])
            moment = moment[free] - gram[np.ix_(free, np.arange(count))] @ self.at
            starts = np.full(len(free), self.most)
            found[free] = _within(gram[np.ix_(free, free)], moment, (-starts, starts))
        else:
            starts = np.full(ends[-1] - count, self.most)
            low, high = self.reach
            found = _within(gram, moment, (np.r_[low, -starts], np.r_[high, starts]))
        return np.split(found, ends[:-1])

    def far(self, by: Sequence[np.ndarray], exact: bool = False) -> bool:
        """Whether values lie so far from `at` that what they do is no straight line.

        Args:
            by: Deviations, as `best` gives them.
            exact: Whether those count as well that are known to a few percent.
        """
        apart = np.abs(by[0] - self.at)[self.stated | exact]
        return math.isfinite(self.most) and bool(np.max(apart, initial=0.0) > NEAR)

    def about(self, values: np.ndarray) -> Loose:
        """The same for models that are simulated at other deviations."""
        return replace(self, at=values)

    def left(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], by: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Residuals with everything at deviations `by`, (T, C) each."""
        moved = by[0] - self.at
        return [
            r + self.columns[i] @ np.concatenate([moved, start])
            for i, r, start in zip(only, residuals, by[1:], strict=True)
        ]

    def deviations(self, values: Mapping[str, float]) -> np.ndarray:
        """Deviations of values of ``robot.yaml``, (V,): the inverse of `values`."""
        first = [int(np.argmax(self.of == k)) for k in range(len(self.at))]
        by = [(values[self.names[i]] - self.nominal[i]) / self.spread[i] for i in first]
        return np.array(by)

    def bound(self, by: np.ndarray) -> np.ndarray:
        """Flags of values whose deviations are the largest that they may have, (V,)."""
        low, high = self.reach
        return (by <= low + ON_BOUND) | (by >= high - ON_BOUND)

    def idle(
        self, by: np.ndarray, residuals: Sequence[np.ndarray], weight: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Flags of values that could as well be the robot's own, all of them together, (V,).

        Args:
            by: Deviations, (V,).
            residuals: Residuals of the model that they suit [floors], (T, C) for each record.
            weight: Information of a residual of 1 floor, (C,) for each record.
        """
        count, gram = len(by), np.eye(len(by))
        for columns, rows, r, each in zip(self.columns, self.rows, residuals, weight, strict=True):
            whole = np.tensordot(each, _gram(columns, np.isfinite(r) & rows[:, None]), axes=1)
            own, both = np.eye(len(whole) - count) + whole[count:, count:], whole[:count, count:]
            gram += whole[:count, :count] - both @ np.linalg.solve(own, both.T)
        back = np.zeros(count, dtype=bool)
        for _ in range(count):
            costs = np.full(count, np.inf)
            for k in np.flatnonzero(~back):
                moved = np.where(back | (np.arange(count) == k), by, 0.0)
                costs[k] = 0.5 * moved @ gram @ moved
            if not np.min(costs, initial=np.inf) <= CHANCE:
                break
            back[int(np.argmin(costs))] = True
        return back

    def values(self, at: np.ndarray) -> dict[str, float]:
        """Values of ``robot.yaml`` at deviations, none beyond what is legal."""
        found = np.clip(self.nominal + self.spread * at[self.of], *self.legal.T)
        return dict(zip(self.names, map(float, found), strict=True))


def _moment(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sum over time of columns, (T, C, K), times values, (T, C): (C, K)."""
    return (values.T[:, None, :] @ columns.transpose(1, 0, 2))[:, 0]


def _gram(columns: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Sum over the times that are used, (T, C) flags, of columns times columns: (C, K, K)."""
    own = (columns * used[:, :, None]).transpose(1, 0, 2)
    return own.transpose(0, 2, 1) @ own


def _within(
    gram: np.ndarray, moment: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Minimum of ``x gram x / 2 - moment x`` within bounds, by active sets."""
    low, high = bounds
    x = np.linalg.solve(gram, moment)
    if np.all((x >= low) & (x <= high)):
        return x
    x = np.clip(x, low, high)
    for _ in range(CHANGES):
        slope = gram @ x - moment
        fixed = ((x >= high) & (slope <= 0.0)) | ((x <= low) & (slope >= 0.0))
        new, free = x.copy(), ~fixed
        if free.any():
            rest = moment[free] - gram[np.ix_(free, fixed)] @ x[fixed]
            best = np.linalg.solve(gram[np.ix_(free, free)], rest)
            new[free] = np.clip(best, low[free], high[free])
        if np.allclose(new, x):
            break
        x = new
    return x


def prepare(
    case: Any,
    spread: Mapping[str, float],
    robot: Any,
    linear: bool,
    likely: Sequence[Mapping[str, float]] = (),
) -> Loose | None:
    """Simulate what each value and each start does.

    Args:
        case: Model and data, without any nuisance yet.
        spread: Standard deviation of each value that robot.yaml calls uncertain, by dotted name.
        robot: The robot as it came, with drives as its file has them.
        linear: Whether residuals are linear in the values, however large their changes; channels
            are then weighed by what all of them together leave. On the ground they are weighed by
            how long that hangs together: errors of contacts and engines are no noise.
        likely: Deviations of further values, of those that change together in one mapping.
    """
    groups = [*({n: s} for n, s in spread.items()), *likely]
    starts = [] if linear else case.forward.doubtful()
    if not groups and not any(len(s) for s in starts):
        return None
    flat = [(n, s, k) for k, group in enumerate(groups) for n, s in group.items()]
    names = tuple(n for n, _, _ in flat)
    nominal = np.array([nominal_value(robot, name) for name in names])
    sizes, of = np.array([s for _, s, _ in flat]), np.array([k for _, _, k in flat], dtype=int)
    least = 0.0 if linear else LEAST
    ends = np.array([legal(robot, name, least) for name in names]).reshape(-1, 2)
    every, none = range(len(case.records)), np.zeros(len(groups))
    rows, width = tuple(case.fit_rows), len(case.forward.channels)
    stated = np.arange(len(groups)) < len(spread)
    loose = Loose(
        names, nominal, sizes, ends, of, (), np.ones(width), rows, tuple(case.held_rows),
        np.inf if linear else MOST, none, stated, level=not linear,
    )  # fmt: skip
    for _ in range(1 if linear else TIMES):
        loose = _about(case, loose, starts)
        here = case.bare([], loose.values(loose.at))
        for _ in range(ROUNDS if linear or case.ground else 0):
            left = loose.left(here, every, loose.best(here, every))
            fitted = case.masked(left, every, held=False)
            score = evidence.score([r for r, used in zip(fitted, rows, strict=True) if used.any()])
            wide = np.square(score.scale) if linear else 1.0  # else `level` sees to it
            weight = 1.0 / (np.max(score.tau, axis=0) * wide)
            loose = replace(loose, weight=weight, grams={})
        best = loose.best(here, every)
        if not loose.far(best):
            break
        loose = loose.about(np.where(stated, best[0], 0.0))
    return loose


def of_model(case: Any, specs: Sequence[Mapping[str, Any]]) -> Loose:
    """The changes that values and starts make to a model with effects: large ones alter them."""
    return _about(case, case.loose, case.forward.doubtful(), specs)


def _about(
    case: Any,
    loose: Loose,
    starts: Sequence[np.ndarray],
    specs: Sequence[Mapping[str, Any]] = (),
) -> Loose:
    """The same with what each value does about the deviations `at`, and each start."""
    here = case.bare(specs, loose.values(loose.at), coarse=True)
    columns: list[list[np.ndarray]] = []
    for k in range(len(loose.at)):
        moved = loose.at.copy()
        moved[k] += PART if moved[k] <= 0.0 else -PART
        there = case.bare(specs, loose.values(moved), coarse=True)
        columns.append(_per(there, here, moved[k] - loose.at[k]))
    count = max((len(s) for s in starts), default=0)
    for k in range(count):
        by = [s * (np.arange(count) == k)[: len(s)] for s in starts]
        other = replace(case, forward=case.forward.begun_at(by), loose=None)
        columns.append(_per(other.bare(specs, loose.values(loose.at), coarse=True), here, 1.0))
    found = [np.stack(each, axis=-1) for each in zip(*columns, strict=True)]
    values = len(loose.at)
    for i, own in enumerate(starts):  # a start of its own is known to no deviation: not refitted
        found[i] = found[i][..., : values + len(own)]
    return replace(loose, columns=tuple(found), grams={})


def _per(there: Sequence[np.ndarray], here: Sequence[np.ndarray], step: float) -> list[np.ndarray]:
    return [np.nan_to_num(a - b) / step for a, b in zip(there, here, strict=True)]
