# SPDX-License-Identifier: Apache-2.0
"""Screening of hypotheses that can explain the residual at all: a few simulations of each.

The response to a strength is taken at a size whose response is about as large as the
residual (secant), so that friction of a hydraulic leg and of a bench need no separate priors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError

from ..hypotheses.bundles import Bundle
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case

TRIES = 5  # sizes per start
DEAD = 1e-3  # response over residual below which an effect cannot be seen
GROW, SHRINK = 30.0, 0.02  # most that a size changes from one try to the next
BACK = 1e-3  # smallest part of a size to which it goes back
RUNGS, RUNG = 4, 3.0  # sizes tried of what a linear step does not find, and factor between two
# Response over residual that explains nothing, and share of it that is nothing, both in the branch.
TOO_LOUD, IDLE = 2.0, 0.05
ALL = 1.0  # response over residual of what explains all of it
# Share of the residual beyond noise, and of the noise itself, below both of which nothing is sought
# in a branch (taste). Little beside a loud gap may be friction, as in two joints of an arm.
QUIET, NOISY = 0.01, 0.2
SAME = 0.01  # part of a response by which another one differs that is the same (taste)
NEXT_SIZE = 1.03  # factor between two sizes that need none between them


@dataclass(frozen=True)
class Screened:
    """Share of the residual that a hypothesis may explain.

    Attributes:
        hypothesis: The hypothesis.
        share: Share of the residual's energy, as simulated, at most 1; below 0 it does harm.
        x: Coordinates at which that was.
        dead: It changes nothing that was measured.
        wrong_sign: It would explain something with a sign that physics forbids.
        cost: Simulations.
        failed: Why the robot cannot be built with it; empty if it can.
    """

    hypothesis: Hypothesis
    share: float
    x: tuple[float, ...]
    dead: bool = False
    wrong_sign: float = 0.0
    cost: int = 0
    failed: str = ""


def screen(
    case: Case,
    bundle: Bundle,
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
    tangent: np.ndarray | None = None,
    known: Sequence[Sequence[float] | None] = (),
) -> list[Screened]:
    """`try_bundle`, and one by one where the robot cannot be built with all of them.

    What it cannot be built with alone explains nothing, and says why.
    """
    given = case, base, overrides, only, residual, tangent
    try:
        return try_bundle(bundle, *given, known)
    except LocoError as error:
        if len(bundle.hypotheses) == 1:
            (h,) = bundle.hypotheses
            return [Screened(h, 0.0, tuple(h.starts()[0]), dead=True, failed=str(error))]
    starts = known or [None] * len(bundle.hypotheses)
    found = []
    for h, mask, at in zip(bundle.hypotheses, bundle.channels, starts, strict=True):
        found += screen(case, Bundle((h,), (mask,), bundle.passes), *given[1:], (at,) if at else ())
    return found


def try_bundle(
    bundle: Bundle,
    case: Case,
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
    tangent: np.ndarray | None = None,
    known: Sequence[Sequence[float] | None] = (),
) -> list[Screened]:
    """Try hypotheses that do not touch each other on top of a model.

    Args:
        bundle: Hypotheses to add.
        case: Model and data.
        base: Effects that the model has already.
        overrides: Nominal values of that model.
        only: Records to look at.
        residual: Residual of that model on these records [floors], (N,).
        tangent: Orthonormal columns that the model's own parameters span, (N, k); what they
            explain is not counted.
        known: The only coordinates to start from, for hypotheses that were screened before.

    In a branch of the robot that is as quiet as its noise nothing is sought (`Bundle.passes`).
    """
    column = case.channel_of(only)
    starts = known or [None] * len(bundle.hypotheses)
    trials = [
        _Trial(h, residual, tangent, None if mask is None else mask[column], at, bundle.passes)
        for h, mask, at in zip(bundle.hypotheses, bundle.channels, starts, strict=True)
    ]
    for k in range(max(len(trial.starts) for trial in trials)):
        for trial in trials:
            trial.begin(k)
        while not all(trial.done for trial in trials):
            columns = _responses(case, trials, base, overrides, only, residual)
            for trial in trials:
                trial.take(columns)
    return [trial.screened() for trial in trials]


class _Trial:
    """One hypothesis while sizes of it are tried."""

    def __init__(
        self,
        hypothesis: Hypothesis,
        residual: np.ndarray,
        tangent: Any,
        rows: Any,
        known: Any,
        passes: bool,
    ):
        self.hypothesis, self.rows, self.tangent = hypothesis, rows, tangent
        self.left = project(residual, tangent)
        self.whole = max(_square(self.left), 1e-300)
        own = slice(None) if rows is None else rows  # a gap elsewhere says nothing of sizes here
        self.energy = max(_square(residual[own]), 1e-300)
        self.idle = IDLE * _square(self.left[own]) / self.whole
        quiet = passes and rows is not None and _quiet(residual, rows)
        self.starts = [known] if known else [] if quiet else hypothesis.starts()
        self.most = 0 if known else RUNGS
        self.x, self.done = list(known or hypothesis.starts()[0]), True
        self.tried: list[tuple[float, tuple[float, ...]]] = []
        self.promised: list[tuple[float, tuple[float, ...]]] = []  # by a linear step
        self.cost, self.wrong, self.alive = 0, 0.0, quiet

    def begin(self, k: int) -> None:
        """Start from the k-th coordinates, if there are so many."""
        self.done = k >= len(self.starts)
        if self.done:
            return
        self.x = list(self.starts[k])
        self.good: tuple[float, list[float]] | None = None  # best of this start
        self.levels: dict[float, float] = {}  # response over residual by size
        self.last: np.ndarray | None = None  # response to the size before
        self.steps = self.rungs = 0

    def take(self, columns: np.ndarray) -> None:
        """Judge the response to each strength at the present sizes, and choose the next."""
        if self.done:
            return
        self.cost += columns.shape[1]
        if self.rows is not None:
            columns = np.where(self.rows[:, None], columns, 0.0)
        if columns.shape[1] == 1:
            (at,) = self.hypothesis.strengths
            self.promised = []  # it is simulated now
            self.levels[self.x[at]] = float(np.linalg.norm(columns)) / np.sqrt(self.energy)
        if self.rungs:
            self.alive |= self.levels[self.x[at]] >= DEAD
            self._note(1.0 - _square(self.left + project(columns, self.tangent)[:, 0]) / self.whole)
        else:
            self._step(columns)
            self.steps += 1
            if any(self.x[at] in self.levels for at in self.hypothesis.strengths):
                # a limit that is not reached, then all there is: linear steps go round in circles
                self.done, self.promised = True, []
            self.done |= self._settled(columns) or self.steps == TRIES
        if self.done or self.rungs:
            self.done = not self._climb()

    def _settled(self, columns: np.ndarray) -> bool:
        """The size before did just that: what is left of an effect without its strength."""
        last, self.last = self.last, columns
        return last is not None and _square(columns - last) <= SAME**2 * _square(columns)

    def _step(self, columns: np.ndarray) -> None:
        """Choose the next sizes as if responses were linear."""
        size, before = np.linalg.norm(columns, axis=0), list(self.x)
        if size.max() < DEAD * np.sqrt(self.energy):
            scale = min(GROW, 0.3 * np.sqrt(self.energy) / max(size.max(), 1e-12))
            self.x = _scaled(self.hypothesis, self.x, [scale] * len(size))
            self.done = scale < 1.5 or self.x == before
            return
        self.alive = True
        bare = project(columns, self.tangent)
        factors = _solve(bare, self.left)
        share, factors = self._judged(bare, factors)
        if len(size) == 1 and self._overshot(1.0 - _square(self.left + bare[:, 0]) / self.whole):
            return
        self.x = _scaled(self.hypothesis, self.x, factors)
        live = factors[size > 0.0]
        if share <= 0.0 or self.x == before or np.allclose(live, 1.0, atol=0.3):
            self.done = True
        promise = share * (0.9 if len(size) > 1 else 0.5)
        self.promised.append((float(promise), tuple(self.x)))

    def _climb(self) -> bool:
        """Set the next size of a strength that explained nothing so far; False if there is none.

        A limit does nothing until it is reached, and all there is a tenth later; friction that
        stops a joint is not a large part of one that slows it. The right size does as much as
        was amiss: beyond that there is nothing to seek. Where even the least is too loud, a drive
        that rounds its encoder does something else at each size: what a tenth does says nothing
        of a third. What does nothing at one size is sought below the one that does as much: a step
        further it may do that much elsewhere.
        """
        sizes = [x for x in self.levels if x]
        most = ALL if any(self.levels[x] < DEAD for x in sizes) else TOO_LOUD
        quiet = [x for x in sizes if self.levels[x] < most]
        best = max((share for share, _ in (*self.tried, *self.promised)), default=0.0)
        reached = any(ALL <= self.levels[x] for x in quiet)
        if not sizes or best >= self.idle or reached or not self.most:
            return False
        (at,) = self.hypothesis.strengths
        x, loud = max(quiet, key=abs, default=0.0), []
        if x:
            loud = [abs(y) for y, level in self.levels.items() if level >= most and abs(y) > abs(x)]
            factor = np.sqrt(min(loud) / abs(x)) if loud else RUNG
        else:
            x, factor = min(sizes, key=abs), 1.0 / RUNG
        if self.rungs >= self.most and not loud:
            return False
        self.rungs += 1
        self.x[at] = self.hypothesis.coordinates[at].clipped(x * factor)
        return max(factor, 1.0 / factor) > NEXT_SIZE and self.x[at] not in self.levels

    def _overshot(self, share: float) -> bool:
        """Note what the present size explains; go half way back where another did more."""
        self._note(share)
        if self.good is None or share >= self.good[0]:
            self.good = share, list(self.x)
            return False
        (at,) = self.hypothesis.strengths
        ratio = self.good[1][at] / self.x[at] if self.x[at] else 0.0
        if not BACK < ratio < 1.0:
            return False
        self.x[at] *= np.sqrt(ratio)
        return True

    def _note(self, share: float) -> None:
        self.tried.append((float(share), tuple(self.x)))

    def _judged(self, columns: np.ndarray, factors: np.ndarray) -> tuple[float, np.ndarray]:
        """Share that a linear step explains, and its factors; none of a forbidden sign."""
        share = 1.0 - _square(self.left + columns @ factors) / self.whole
        forbidden = [
            f < 0.0 and self.hypothesis.coordinates[i].one_sided
            for f, i in zip(factors, self.hypothesis.strengths, strict=True)
        ]
        if not any(forbidden):
            return share, factors
        self.wrong = max(self.wrong, share)
        factors = np.where(forbidden, 0.0, factors)
        if not np.any(factors):
            return 0.0, factors
        return 1.0 - _square(self.left + columns @ factors) / self.whole, factors

    def screened(self) -> Screened:
        """The result of all sizes that were tried."""
        start = (0.0, tuple(self.hypothesis.starts()[0]))
        share, x = max((*self.tried, *self.promised), default=start)
        return Screened(self.hypothesis, share, x, not self.alive, self.wrong, self.cost)


def _quiet(residual: np.ndarray, rows: np.ndarray) -> bool:
    """Whether a branch shows next to nothing beyond noise, of the whole and beside its noise."""
    beyond = _square(residual[rows]) - rows.sum()
    return beyond < min(QUIET * _square(residual), NOISY * rows.sum())


def _square(values: np.ndarray) -> float:
    return float(np.vdot(values, values))


def project(values: np.ndarray, tangent: np.ndarray | None) -> np.ndarray:
    """Values without what orthonormal columns explain."""
    return values if tangent is None else values - tangent @ (tangent.T @ values)


def _responses(
    case: Case,
    trials: Sequence[_Trial],
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
) -> np.ndarray:
    """Change of the residual by each strength alone, of all hypotheses at once, (N, s)."""
    columns = []
    for strength in trials[0].hypothesis.strengths:
        specs = list(base)
        for trial in (trial for trial in trials if not trial.done):
            coordinates = trial.hypothesis.coordinates
            at = [0.0 if c.strength else v for c, v in zip(coordinates, trial.x, strict=True)]
            at[strength] = trial.x[strength]
            specs += [term.spec for term in trial.hypothesis.terms(at)]
        columns.append(case.vector(specs, overrides, only, coarse=True) - residual)
    return np.stack(columns, axis=1)


def _solve(columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Factors of the columns that lower the residual most, dead ones 0."""
    norms = np.linalg.norm(columns, axis=0)
    live = norms > 1e-6 * norms.max()
    factors = np.zeros(columns.shape[1])
    if live.any():
        scaled = columns[:, live] / norms[live]
        factors[live] = -np.linalg.lstsq(scaled, residual, rcond=1e-3)[0] / norms[live]
    return factors


def _scaled(hypothesis: Hypothesis, x: Sequence[float], factors: Sequence[float]) -> list[float]:
    """Coordinates with the strengths multiplied, within reason and bounds."""
    x = list(x)
    for strength, factor in zip(hypothesis.strengths, factors, strict=True):
        size = min(max(abs(factor), SHRINK), GROW) if factor else 0.0
        x[strength] = hypothesis.coordinates[strength].clipped(
            x[strength] * size * (1.0 if factor >= 0.0 else -1.0)
        )
    return x
