# SPDX-License-Identifier: Apache-2.0
"""Uncertain values, refitted with every model by linear least squares instead of simulations.

These are values of the robot (`nominal`), the initial states of records, and the times at which
their readings were taken. The sensitivity of the
residual to each is simulated once. The values that fit a model best, within their priors, then
solve a linear least-squares problem. Torques along a given motion are linear in masses, centres and
inertias. A motion is linear for small changes only: there no value deviates by more than `RANGE`
standard deviations, and the sensitivities are simulated about the values that fit the robot.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..statistics import evidence
from .nominal import legal, nominal_value, reading_scales
from .running import WINDING

PART = 0.5  # simulated change, in standard deviations; the rest is taken as linear (taste)
ROUNDS = 3  # updates of the weights, each from the residual of the previous one (taste)
TIMES, SHIFT = 4, 0.5  # most linearisations, and deviations that need no further one (taste)
RANGE = 2.5  # largest deviation of a value where a motion is compared: beyond, it is an effect
MIN_RATIO = 0.2  # smallest ratio of a refitted inertia, mass or gain to its nominal value (taste)
ON_BOUND = 1e-6  # tolerance of deviations on their bound (theory: rounding)
CHANCE = 2.0  # increase of the cost that chance explains [nat] (theory: 95 % of one value)
LEVELS, SAME = 8, 0.9  # updates of residual levels per channel, until they fall by less (taste)
CHANGES = 20  # most changes of the active set per coordinate; one or two are usual (taste)
# Standard deviation of delays of readings and of drives beside all effects [s]: half a period of
# a drive that computes its torque at 10 kHz; those of robots do at 1 to 40 kHz (judgement).
CLOCK = 5e-5


class Block(NamedTuple):
    """Channels of a record that depend on the same deviations."""

    channels: np.ndarray  # their indices, (c,)
    moved: np.ndarray  # indices of the deviations, (k,)
    values: np.ndarray  # sensitivities, (c, T, k)


class Response(NamedTuple):
    """Sensitivity of the residual of a record to one deviation."""

    moved: np.ndarray  # channels in which it is not 0, (C,) flags
    values: np.ndarray  # sensitivity of these, (T, c)

    @classmethod
    def of(cls, change: np.ndarray) -> Response:
        """Channels of a change, (T, C), that it moves."""
        moved = change.any(axis=0)
        return cls(moved, change[:, moved])


@dataclass(frozen=True)
class Columns:
    """Sensitivity of the residual of a record [floors] per deviation, as its parts that are not 0.

    A mass in one leg moves no joint of the others: a dense matrix of a quadruped is mostly 0.

    Attributes:
        shape: Times, channels and deviations: T, C, K.
        blocks: Parts; no two have a channel in common.
    """

    shape: tuple[int, int, int]
    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, shape: tuple[int, int], parts: Sequence[Response]) -> Columns:
        """Sensitivities of a record of T times and C channels to each deviation.

        Args:
            shape: T and C.
            parts: Response to each deviation.
        """
        acts = np.array([moved for moved, _ in parts], dtype=bool).reshape(-1, shape[1]).T
        place, blocks = acts.cumsum(axis=0) - 1, []
        for pattern in np.unique(acts, axis=0):
            channels, moved = np.flatnonzero((acts == pattern).all(1)), np.flatnonzero(pattern)
            values = np.empty((len(channels), shape[0], len(moved)))
            for j, k in enumerate(moved):
                values[:, :, j] = parts[k].values[:, place[channels, k]].T
            blocks.append(Block(channels, moved, values))
        return cls((*shape, len(parts)), tuple(blocks))

    def by(self, deviations: np.ndarray) -> np.ndarray:
        """Change of the residual by deviations, (K,): (T, C)."""
        result = np.empty(self.shape[:2])
        for channels, moved, values in self.blocks:
            result[:, channels] = (values @ deviations[moved]).T
        return result

    def moment(self, residual: np.ndarray) -> np.ndarray:
        """Sum over time of the sensitivities times a residual, (T, C): (C, K)."""
        result = np.zeros(self.shape[1:])
        for channels, moved, values in self.blocks:
            result[np.ix_(channels, moved)] = (residual.T[channels, None] @ values)[:, 0]
        return result

    def gram(self, used: np.ndarray) -> np.ndarray:
        """Sum of products of the sensitivities over used times, (T, C) flags: (C, K, K)."""
        _, count, width = self.shape
        result = np.zeros((count, width, width))
        for channels, moved, values in self.blocks:
            weighted = values * used.T[channels, :, None]
            result[np.ix_(channels, moved, moved)] = weighted.transpose(0, 2, 1) @ weighted
        return result


class Products(NamedTuple):
    """Sums over time of a residual, for each channel."""

    square: np.ndarray  # sum of its squares at all times, (C,)
    moment: np.ndarray  # products with the sensitivities to values and starts, in used rows, (C, K)
    every: np.ndarray  # same as `moment`, at all times, (C, K)


@dataclass(frozen=True)
class Loose:
    """Linear nuisance parameters: V values of the robot, and S of each record.

    Those of a record are its initial state and the times of its readings.

    Attributes:
        names: Dotted names of N values of the robot.
        nominal: Nominal value of each, (N,).
        spread: Standard deviation of each, (N,).
        legal: Smallest and largest value of each, (N, 2).
        of: Index of each among the V values; names that change together have the same, (N,).
        columns: Sensitivities of V + S deviations for each record, with S deviations of its own;
            0 where nothing was measured.
        weight: Information of a residual of 1 floor in each channel, (C,).
        rows: Rows of each record that are fitted, (T,) flags.
        judges: Held-out rows; they determine the initial state of a record without fitted rows.
        most: Largest deviation.
        at: Deviations of the values about which models are simulated, (V,).
        stated: Flags of the values that robot.yaml declares uncertain and may be large, (V,).
        held: Whether values are fixed and only the initial states are refitted.
        level: Whether channels with larger residuals have less weight, as for a motion.
        scaling: Share by which a deviation of a value scales the readings of a channel, (V, C).
        grams: Products of the columns in each channel, in used rows and at all times, (C, K, K),
            and number of used values, (C,), by record.
    """

    names: tuple[str, ...]
    nominal: np.ndarray
    spread: np.ndarray
    legal: np.ndarray
    of: np.ndarray
    columns: tuple[Columns, ...]
    weight: np.ndarray
    rows: tuple[np.ndarray, ...]
    judges: tuple[np.ndarray, ...]
    most: float
    at: np.ndarray
    stated: np.ndarray
    held: bool = False
    level: bool = False
    scaling: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    grams: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(
        default_factory=dict, compare=False, repr=False
    )

    @property
    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest deviations of the values, (V,) each."""
        high = np.where(self.stated, self.most, RANGE)
        low = -high
        if math.isfinite(self.most):
            bounds = (self.legal - self.nominal[:, None]) / self.spread[:, None]
            np.maximum.at(low, self.of, bounds[:, 0])
            np.minimum.at(high, self.of, bounds[:, 1])
        return low, high

    def best(self, residuals: Sequence[np.ndarray], only: Sequence[int]) -> list[np.ndarray]:
        """Deviations with the lowest cost: of values, (V,), and of each initial state, (S,).

        Args:
            residuals: Residuals of the model [floors], (T, C) each, simulated at `at`.
            only: Indices of their records.
        """
        terms = [self._products(i, r) for i, r in zip(only, residuals, strict=True)]
        if not self.level:
            return self._solved(terms, only, self.weight)
        by, before = self.unmoved(only), np.inf
        count = np.maximum(np.sum([np.isfinite(r).sum(0) for r in residuals], axis=0), 1)
        for _ in range(LEVELS):
            power = self._power(terms, only, by) / count
            if np.all(power > SAME * before):
                break
            by = self._solved(terms, only, self.weight / np.maximum(power, 1.0), power)
            before = power
        return by

    def unmoved(self, only: Sequence[int]) -> list[np.ndarray]:
        """Values as in `at`, and no change of initial states; as `best`."""
        count = len(self.at)
        return [self.at, *(np.zeros(self.columns[i].shape[2] - count) for i in only)]

    def _products(self, index: int, residual: np.ndarray) -> Products:
        """Sums over time that the fit needs from the residual of a record, in one pass."""
        columns = self.columns[index]
        valid = np.isfinite(residual)
        rows = self.rows[index] if self.rows[index].any() else self.judges[index]
        values = np.where(valid, residual, 0.0)
        selected = values * rows[:, None]
        moment = columns.moment(selected)
        every = moment if rows.all() else moment + columns.moment(values - selected)
        if index not in self.grams:  # the measured rows are the same for every model
            used = columns.gram(valid & rows[:, None])
            total = used if rows.all() else used + columns.gram(valid & ~rows[:, None])
            self.grams[index] = used, total, (valid & rows[:, None]).sum(axis=0)
        return Products(np.sum(np.square(values), axis=0), moment, every)

    def _power(
        self, terms: Sequence[Products], only: Sequence[int], by: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Sum of squares of the residual in each channel at deviations `by`, (C,)."""
        power, moved = np.zeros(len(self.weight)), by[0] - self.at
        for i, products, start in zip(only, terms, by[1:], strict=True):
            x = np.concatenate([moved, start])
            square = products.square + (2.0 * products.every + self.grams[i][1] @ x) @ x
            power += np.maximum(square, 0.0)
        return power

    def _solved(
        self,
        terms: Sequence[Products],
        only: Sequence[int],
        weight: np.ndarray,
        power: np.ndarray | float = 1.0,
    ) -> list[np.ndarray]:
        """Deviations with the lowest cost: values by fitted records, then starts of all by values.

        Held-out records do not determine the robot, but they begin as it does. Readings that are
        scaled by s have noise that is scaled as well: residuals count over 1 + s, to second order.
        """
        count = len(self.at)
        parts = [
            (np.tensordot(weight, self.grams[i][0], axes=1), -weight @ products.moment)
            for i, products in zip(only, terms, strict=True)
        ]
        fitted = [part for i, part in zip(only, parts, strict=True) if self.rows[i].any()]
        if not self.held and self.scaling.any():
            used = np.sum([self.grams[i][2] for i in only if self.rows[i].any()], axis=0)
            energy = (self.scaling != 0.0) @ (weight * used * power)
            slope = energy * self.scaling.sum(axis=1)
            gram = np.diag(slope * self.scaling.sum(axis=1))
            fitted.append((gram, slope - gram @ self.at))
        values, starts = self.at if self.held else self._values(fitted), []
        for gram, moment in parts:
            moment = moment[count:] - gram[count:, :count] @ (values - self.at)
            high = np.full(len(moment), self.most)
            inner = np.eye(len(moment)) + gram[count:, count:]
            starts.append(_within(inner, moment, (-high, high)))
        return [values, *starts]

    def _values(self, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """Deviations of values with the lowest cost over all starts, (V,).

        Args:
            parts: Products of the columns of each fitted record, (K, K), and products of these
                with its negative residual, (K,).
        """
        count = len(self.at)
        offsets = np.cumsum([count, *(len(moment) - count for _, moment in parts)])
        total, right = np.eye(offsets[-1]), np.zeros(offsets[-1])
        for (gram, moment), *ends in zip(parts, offsets[:-1], offsets[1:], strict=True):
            block = np.r_[np.arange(count), np.arange(*ends)]
            total[np.ix_(block, block)] += gram
            right[block] += moment + gram[:, :count] @ self.at
        starts = np.full(offsets[-1] - count, self.most)
        low, high = self.reach
        return _within(total, right, (np.r_[low, -starts], np.r_[high, starts]))[:count]

    def far(self, by: Sequence[np.ndarray], exact: bool = False) -> bool:
        """True if values are too far from `at` for the linearisation.

        Args:
            by: Deviations, as from `best`.
            exact: Whether values that are known to a few percent count as well.
        """
        shift = np.abs(by[0] - self.at)[self.stated | exact]
        return math.isfinite(self.most) and bool(np.max(shift, initial=0.0) > SHIFT)

    def about(self, values: np.ndarray) -> Loose:
        """Copy for models that are simulated at other deviations."""
        return replace(self, at=values)

    def left(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], by: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """Residuals with everything at deviations `by`, (T, C) each, in floors of the readings."""
        scale = 1.0 + by[0] @ self.scaling if self.scaling.any() else 1.0
        return [r / scale for r in self.moved(residuals, only, by)]

    def moved(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], by: Sequence[np.ndarray]
    ) -> list[np.ndarray]:
        """As `left`, in floors of scaled readings, in which it is linear in the deviations."""
        moved = by[0] - self.at
        return [
            r + self.columns[i].by(np.concatenate([moved, start]))
            for i, r, start in zip(only, residuals, by[1:], strict=True)
        ]

    def deviations(self, values: Mapping[str, float]) -> np.ndarray:
        """Deviations of values of ``robot.yaml``, (V,): the inverse of `values`."""
        first = [int(np.argmax(self.of == k)) for k in range(len(self.at))]
        by = [(values[self.names[i]] - self.nominal[i]) / self.spread[i] for i in first]
        return np.array(by)

    def bound(self, by: np.ndarray) -> np.ndarray:
        """Flags of values whose deviations are on a bound, (V,)."""
        low, high = self.reach
        return (by <= low + ON_BOUND) | (by >= high - ON_BOUND)

    def idle(
        self, by: np.ndarray, residuals: Sequence[np.ndarray], weight: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Flags of values that, all together, may as well be nominal, (V,).

        Args:
            by: Deviations, (V,).
            residuals: Residuals of the model with these deviations [floors], (T, C) per record.
            weight: Information of a residual of 1 floor, (C,) per record.
        """
        count, gram = len(by), np.eye(len(by))
        for columns, rows, r, each in zip(self.columns, self.rows, residuals, weight, strict=True):
            total = np.tensordot(each, columns.gram(np.isfinite(r) & rows[:, None]), axes=1)
            inner, both = np.eye(len(total) - count) + total[count:, count:], total[:count, count:]
            gram += total[:count, :count] - both @ np.linalg.solve(inner, both.T)
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
        """Values of ``robot.yaml`` at deviations, clipped to their legal range."""
        clipped = np.clip(self.nominal + self.spread * at[self.of], *self.legal.T)
        return dict(zip(self.names, map(float, clipped), strict=True))


def _within(
    gram: np.ndarray, moment: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Minimum of ``x gram x / 2 - moment x`` within bounds, by a primal active-set method.

    It goes towards the minimum over the free coordinates up to the first bound, which is fixed;
    where no bound is met, the coordinate whose bound raises the cost most is freed.
    """
    low, high = bounds
    x = np.linalg.solve(gram, moment)
    if np.all((x >= low) & (x <= high)):
        return x
    x = np.clip(x, low, high)
    fixed = (x <= low) | (x >= high)
    for _ in range(CHANGES * len(x)):
        best, free = x.copy(), ~fixed
        rest = moment[free] - gram[np.ix_(free, fixed)] @ x[fixed]
        best[free] = np.linalg.solve(gram[np.ix_(free, free)], rest)
        end = np.clip(best, low, high)
        outside = best != end
        if outside.any():
            shares = np.divide(end - x, best - x, out=np.ones(len(x)), where=outside)
            k = int(np.argmin(shares))
            x = np.clip(x + shares[k] * (best - x), low, high)
            x[k], fixed[k] = end[k], True
            continue
        x, slope = best, gram @ best - moment
        inward = np.where(fixed, np.where(x >= high, slope, -slope), -np.inf)
        k = int(np.argmax(inward))
        if inward[k] <= ON_BOUND * np.max(np.abs(moment)):
            break
        fixed[k] = False
    return x


def prepare(
    case: Any,
    std: Mapping[str, float],
    robot: Any,
    linear: bool,
    further: Sequence[Mapping[str, float]] = (),
) -> Loose | None:
    """Simulate the sensitivities to all values and initial states; None if there are none.

    Args:
        case: Model and data, without nuisance parameters.
        std: Standard deviation of each value that robot.yaml declares uncertain, by dotted name.
        robot: The initial robot, with drives as in its file.
        linear: Whether residuals are linear in the values for changes of any size; channels are
            then weighted by their joint residual, if there are uncertain values, which may be far
            off. Otherwise `level` sets the weights; on the ground they depend on the correlation
            time, since errors of contacts are no white noise.
        further: Standard deviations of further values; one mapping for values that change together.
    """
    groups = [*({n: s} for n, s in std.items()), *further]
    starts = [] if linear else case.forward.doubtful()
    if not groups and not any(len(s) for s in starts):
        return None
    items = [(n, s, k) for k, group in enumerate(groups) for n, s in group.items()]
    names = tuple(n for n, _, _ in items)
    nominal = np.array([nominal_value(robot, name) for name in names])
    sizes, of = np.array([s for _, s, _ in items]), np.array([k for _, _, k in items], dtype=int)
    min_ratio = 0.0 if linear else MIN_RATIO
    bounds = np.array([legal(robot, name, min_ratio) for name in names]).reshape(-1, 2)
    none, rows, width = np.zeros(len(groups)), tuple(case.fit_rows), len(case.forward.channels)
    stated, level = np.arange(len(groups)) < len(std), not linear or not std
    scaling = np.zeros((len(groups), width))
    np.add.at(scaling, of, reading_scales({n: s for n, s, _ in items}, case.forward.channels))
    loose = Loose(
        names, nominal, sizes, bounds, of, (), np.ones(width), rows, tuple(case.held_rows),
        np.inf if linear else RANGE, none, stated, level=level,
        scaling=scaling,
    )  # fmt: skip
    for _ in range(TIMES):
        loose = _about(case, loose, starts)
        ref = case.bare([], loose.values(loose.at))
        if not level or case.ground:
            loose = _weighted(case, loose, ref)
        best = loose.best(ref, range(len(case.records)))
        if not loose.far(best):
            break
        loose = loose.about(np.where(stated, best[0], 0.0))
    return loose


def _weighted(case: Any, loose: Loose, ref: Sequence[np.ndarray]) -> Loose:
    """Copy with channels weighted by correlation time and, without `level`, by residual."""
    every = range(len(case.records))
    for _ in range(ROUNDS):
        left = case.masked(loose.left(ref, every, loose.best(ref, every)), every, held=False)
        used = zip(left, loose.rows, strict=True)
        score = evidence.score([r for r, rows in used if rows.any()])
        wide = 1.0 if loose.level else np.square(score.scale)
        weight = 1.0 / (np.max(score.tau, axis=0) * wide)
        loose = replace(loose, weight=weight, grams={})
    return loose


def of_model(case: Any, specs: Sequence[Mapping[str, Any]]) -> Loose:
    """Sensitivities to values and initial states of a model with effects, which may alter them."""
    return _about(case, case.loose, case.forward.doubtful(), specs)


def _about(
    case: Any,
    loose: Loose,
    starts: Sequence[np.ndarray],
    specs: Sequence[Mapping[str, Any]] = (),
) -> Loose:
    """Copy with sensitivities about the deviations `at`, for a model with the given effects."""
    ref = case.bare(specs, loose.values(loose.at), coarse=True)
    responses: list[list[Response]] = [[] for _ in ref]  # by record

    def add(of: Any, values: Mapping[str, float], step: float, moved: Sequence[bool]) -> None:
        runs = of.bare(specs, values, coarse=True)
        for of_record, new, old, is_moved in zip(responses, runs, ref, moved, strict=True):
            if is_moved:
                of_record.append(Response.of(np.nan_to_num(new - old) / step))

    for k in range(len(loose.at)):
        at = loose.at.copy()
        at[k] += PART if at[k] <= 0.0 else -PART
        add(case, loose.values(at), at[k] - loose.at[k], [True] * len(ref))
    count = max((len(s) for s in starts), default=0)
    for k in range(count):
        part = 1.0 if k < 2 * len(case.forward.robot().joints) else WINDING
        by = [part * s * (np.arange(count) == k)[: len(s)] for s in starts]
        other = replace(case, forward=case.forward.begun_at(by), loose=None)
        add(other, loose.values(loose.at), part, [k < len(s) for s in starts])
    # Of drives that round their encoders, these times are in `floors.limit_cycle_errors`.
    if math.isfinite(loose.most) and not case.ground and not case.rounds:
        for of_record, changes in zip(responses, _timed(case, specs, loose), strict=True):
            of_record += map(Response.of, np.moveaxis(changes, -1, 0))
    columns = [Columns.of(r.shape, responses[i]) for i, r in enumerate(ref)]
    return replace(loose, columns=tuple(columns), grams={})


def _timed(case: Any, specs: Sequence[Mapping[str, Any]], loose: Loose) -> Iterator[np.ndarray]:
    """Sensitivities to four deviations of the times of readings and drives, (T, C, 4) each.

    Stamps whose delays have a deviation are late by an unknown time: of delays from 0 to any size
    the mean is sqrt(3) deviations, and an even clock below them is as early.
    """
    delays = [math.hypot(CLOCK, math.sqrt(3.0) * deviation) for deviation in case.times]
    changes = case.forward.reading_times(specs, loose.values(loose.at), CLOCK, delays)
    for change, m, f in zip(changes, case.forward.measured, case.floors, strict=True):
        yield np.where(np.isfinite(m)[..., None], -change / f[..., None], 0.0)
