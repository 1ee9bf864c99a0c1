# SPDX-License-Identifier: Apache-2.0
"""Screening: the share of the residual that each hypothesis may explain, by a few simulations.

Sensitivities to a strength are secants, at a size whose response is about as large as the
residual. A hydraulic leg and a bench therefore need no separate priors of their friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError
from loco_sim.effects import EFFECTS

from ..hypotheses.bundles import Batch
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case

TRIES = 5  # sizes per start
DEAD = 1e-3  # response over residual below which an effect cannot be seen
GROW, SHRINK = 30.0, 0.02  # largest and smallest factor from one tried size to the next
BACK = 1e-3  # smallest ratio of an earlier size for a step back towards it
RUNGS, RUNG = 4, 3.0  # sizes tried after linear steps failed, and the factor between them
# Response over residual above which an effect explains nothing, and share of the residual that
# counts as nothing, both within the branch.
TOO_LOUD, NEGLIGIBLE = 2.0, 0.05
ALL = 1.0  # response over residual of an effect that explains all of it
FAR = 3.0  # response over residual of a smooth effect above which no linear step is taken (taste)
# A branch is skipped if its residual beyond noise is below both shares: of the whole residual, and
# of its own noise (taste). A small residual beside a large gap may be friction, as in two joints
# of an arm.
QUIET, NOISE_SHARE = 0.01, 0.2
SAME = 0.01  # relative difference below which two responses are equal (taste)
NEXT_SIZE = 1.03  # smallest factor between two tried sizes


@dataclass(frozen=True)
class Screened:
    """Result of the screening of a hypothesis.

    Attributes:
        hypothesis: The hypothesis.
        share: Explained share of the residual's energy, at most 1; negative if it increases it.
        x: Coordinates with this share.
        dead: Whether the hypothesis changes no measured signal.
        cost: Number of simulations.
        failed: Reason why the robot cannot be built with it; empty if it can.
    """

    hypothesis: Hypothesis
    share: float
    x: tuple[float, ...]
    dead: bool = False
    cost: int = 0
    failed: str = ""


def smooth(hypothesis: Hypothesis, case: Case) -> bool:
    """True if small changes of the size of an effect act in proportion to it."""
    return EFFECTS[hypothesis.effect].identity.smooth and not case.rounds


def screen(
    case: Case,
    batch: Batch,
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
    tangent: np.ndarray | None = None,
    initial: Sequence[Sequence[float] | None] = (),
) -> list[Screened]:
    """Screen hypotheses in separate branches of the robot together, on top of a model.

    If the robot cannot be built with all of them, they are screened one by one; a hypothesis with
    which it cannot be built explains nothing and reports the reason. A branch of the robot whose
    residual is mostly noise is skipped (`Bundle.passes`).

    Args:
        case: Model and data.
        batch: Hypotheses to add.
        base: Effects that the model has already.
        overrides: Nominal values of that model.
        only: Indices of the records.
        residual: Residual of that model on these records [floors], (N,).
        tangent: Orthonormal columns that the model's own parameters span, (N, k); the part of a
            response in their span is not counted.
        initial: Initial coordinates of hypotheses that were screened before.
    """
    column = case.channel_of(only)
    starts = initial or [None] * len(batch.hypotheses)
    each = list(zip(batch.hypotheses, batch.channels, starts, strict=True))
    trials = []
    for h, mask, at in each:
        rows = None if mask is None else mask[column]
        trials.append(_Trial(h, residual, tangent, rows, at, batch.passes, smooth(h, case)))
    try:
        for k in range(max(len(trial.starts) for trial in trials)):
            for trial in trials:
                trial.begin(k)
            while not all(trial.done for trial in trials):
                columns = _responses(case, trials, base, overrides, only, residual)
                for trial in trials:
                    trial.take(columns)
    except LocoError as error:
        if len(each) == 1:
            h = each[0][0]
            return [Screened(h, 0.0, tuple(h.starts()[0]), dead=True, failed=str(error))]
        model, results = (base, overrides, only, residual, tangent), []
        for h, mask, at in each:
            single = Batch((h,), (mask,), batch.passes)
            results += screen(case, single, *model, (at,) if at else ())
        return results
    return [trial.screened() for trial in trials]


class _Trial:
    """Screening state of one hypothesis."""

    def __init__(
        self,
        hypothesis: Hypothesis,
        residual: np.ndarray,
        tangent: Any,
        rows: Any,
        initial: Any,
        passes: bool,
        smooth: bool,
    ):
        self.hypothesis, self.rows, self.tangent = hypothesis, rows, tangent
        self.left = project(residual, tangent)
        self.whole = max(_square(self.left), 1e-300)
        mask = slice(None) if rows is None else rows  # only this branch's gap decides on sizes
        self.energy = max(_square(residual[mask]), 1e-300)
        masked_square = _square(self.left[mask])
        self.idle = NEGLIGIBLE * masked_square / self.whole
        self.apart = rows is not None and tangent is None  # then values of other branches stay
        self.left, self.rest = (
            (self.left[rows], self.whole - masked_square) if self.apart else (self.left, 0.0)
        )
        quiet = passes and rows is not None and _quiet(residual, rows)
        self.starts = [initial] if initial else [] if quiet else hypothesis.starts()
        self.most = 0 if initial else RUNGS
        self.x, self.done = list(initial or hypothesis.starts()[0]), True
        self.tried: list[tuple[float, tuple[float, ...]]] = []
        self.predicted: list[tuple[float, tuple[float, ...]]] = []  # predicted by a linear step
        self.cost, self.is_visible, self.smooth = 0, quiet, smooth

    def begin(self, k: int) -> None:
        """Start from the k-th initial coordinates, if there are that many."""
        self.done = k >= len(self.starts)
        if self.done:
            return
        self.x = list(self.starts[k])
        self.good: tuple[float, list[float]] | None = None  # best of this start
        self.levels: dict[float, float] = {}  # response over residual by size
        self.last: np.ndarray | None = None  # response to the previous size
        self.steps = self.rungs = 0

    def take(self, columns: np.ndarray) -> None:
        """Evaluate the response to each strength at the present sizes, and choose the next."""
        if self.done:
            return
        self.cost += columns.shape[1]
        if self.rows is not None:
            columns = columns[self.rows] if self.apart else columns * self.rows[:, None]
        if columns.shape[1] == 1:
            (at,) = self.hypothesis.strengths
            self.predicted = []  # replaced by the simulated share
            self.levels[self.x[at]] = float(np.linalg.norm(columns)) / np.sqrt(self.energy)
        if self.rungs:
            self.is_visible |= self.levels[self.x[at]] >= DEAD
            self._note(self._share(project(columns, self.tangent)[:, 0]))
        else:
            if self._step(columns):
                self.done = True
                return
            self.steps += 1
            if any(self.x[at] in self.levels for at in self.hypothesis.strengths):
                # a threshold has no effect or its full effect: linear steps would alternate
                self.done, self.predicted = True, []
            self.done |= self._converged(columns) or self.steps == TRIES
        if self.done or self.rungs:
            self.done = not self._climb()

    def _converged(self, columns: np.ndarray) -> bool:
        """True if the response did not change with the size: the strength has no more influence."""
        last, self.last = self.last, columns
        return last is not None and _square(columns - last) <= SAME**2 * _square(columns)

    def _step(self, columns: np.ndarray) -> bool:
        """Choose the next sizes from a linear model of the responses.

        Returns:
            Whether no other size can explain a share worth mentioning, because the effect is smooth
            and the linear model promises none.
        """
        size, before = np.linalg.norm(columns, axis=0), list(self.x)
        loud = size / np.sqrt(self.energy)
        if loud.max() < DEAD:
            scale = min(GROW, 0.3 / max(loud.max(), 1e-12))
            self.x = _scaled(self.hypothesis, self.x, [scale] * len(size))
            self.done = scale < 1.5 or self.x == before
            return False
        self.is_visible = True
        if self.smooth and loud.max() > FAR:
            for at, level in zip(self.hypothesis.strengths, loud, strict=True):
                shrunk = self.x[at] * ALL / max(level, ALL)
                self.x[at] = self.hypothesis.coordinates[at].clipped(shrunk)
            self.done = self.x == before
            return False
        moves = project(columns, self.tangent)
        factors = _solve(moves, self.left)
        share, factors = self._judged(moves, factors)
        if len(size) == 1 and self._overshot(self._share(moves[:, 0])):
            return False
        self.x = _scaled(self.hypothesis, self.x, factors)
        live = factors[size > 0.0]
        if share <= 0.0 or self.x == before or np.allclose(live, 1.0, atol=0.3):
            self.done = True
        promise = share * (0.9 if len(size) > 1 else 0.5)
        self.predicted.append((float(promise), tuple(self.x)))
        return self.smooth and share < self.idle

    def _climb(self) -> bool:
        """Set the next size of a strength that explained nothing so far; False if there is none.

        A limit has no effect until it is reached and its full effect a tenth beyond; friction that
        stops a joint is not a multiple of friction that slows it. The response of the right size is
        about as large as the residual, so larger sizes need not be tried. If even the smallest size
        responds too strongly, smaller ones are tried: with a quantised encoder the response to a
        tenth does not predict that to a third. If a size has no effect, sizes up to the one whose
        response equals the residual are tried: the next step may respond elsewhere.
        """
        sizes = [x for x in self.levels if x]
        top = ALL if any(self.levels[x] < DEAD for x in sizes) else TOO_LOUD
        quiet = [x for x in sizes if self.levels[x] < top]
        best = max((share for share, _ in (*self.tried, *self.predicted)), default=0.0)
        reached = any(ALL <= self.levels[x] for x in quiet)
        if not sizes or best >= self.idle or reached or not self.most:
            return False
        (at,) = self.hypothesis.strengths
        x, loud = max(quiet, key=abs, default=0.0), []
        if x:
            loud = [abs(y) for y, level in self.levels.items() if level >= top and abs(y) > abs(x)]
            factor = np.sqrt(min(loud) / abs(x)) if loud else RUNG
        else:
            x, factor = min(sizes, key=abs), 1.0 / RUNG
        if not any(self.levels.values()):
            self.rungs, factor = self.most - 1, RUNG**self.most  # a stop out of reach stays so
        if self.rungs >= self.most and not loud:
            return False
        self.rungs += 1
        self.x[at] = self.hypothesis.coordinates[at].clipped(x * factor)
        return max(factor, 1.0 / factor) > NEXT_SIZE and self.x[at] not in self.levels

    def _overshot(self, share: float) -> bool:
        """Note the share of the present size; halve the step if an earlier size was better."""
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

    def _share(self, change: np.ndarray) -> float:
        """Share of the residual's energy that a change explains."""
        return 1.0 - (self.rest + _square(self.left + change)) / self.whole

    def _note(self, share: float) -> None:
        self.tried.append((float(share), tuple(self.x)))

    def _judged(self, columns: np.ndarray, factors: np.ndarray) -> tuple[float, np.ndarray]:
        """Share that a linear step explains, and its factors, 0 where the sign is forbidden."""
        forbidden = [
            f < 0.0 and self.hypothesis.coordinates[i].one_sided
            for f, i in zip(factors, self.hypothesis.strengths, strict=True)
        ]
        factors = np.where(forbidden, 0.0, factors)
        if any(forbidden) and not np.any(factors):
            return 0.0, factors
        return self._share(columns @ factors), factors

    def screened(self) -> Screened:
        """Best result over all tried sizes."""
        start = (0.0, tuple(self.hypothesis.starts()[0]))
        share, x = max((*self.tried, *self.predicted), default=start)
        return Screened(self.hypothesis, share, x, not self.is_visible, self.cost)


def _quiet(residual: np.ndarray, rows: np.ndarray) -> bool:
    """True if the residual of a branch is mostly noise, by `QUIET` and `NOISE_SHARE`."""
    excess = _square(residual[rows]) - rows.sum()
    return excess < min(QUIET * _square(residual), NOISE_SHARE * rows.sum())


def _square(values: np.ndarray) -> float:
    return float(np.vdot(values, values))


def project(values: np.ndarray, tangent: np.ndarray | None) -> np.ndarray:
    """Values minus their projection onto orthonormal columns."""
    return values if tangent is None else values - tangent @ (tangent.T @ values)


def _responses(
    case: Case,
    trials: Sequence[_Trial],
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
) -> np.ndarray:
    """Change of the residual by each strength alone, all hypotheses at once, (N, s)."""
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
    """Factors of the columns that lower the residual most; 0 for columns without effect."""
    norms = np.linalg.norm(columns, axis=0)
    live = norms > 1e-6 * norms.max()
    factors = np.zeros(columns.shape[1])
    if live.any():
        scaled = columns[:, live] / norms[live]
        factors[live] = -np.linalg.lstsq(scaled, residual, rcond=1e-3)[0] / norms[live]
    return factors


def _scaled(hypothesis: Hypothesis, x: Sequence[float], factors: Sequence[float]) -> list[float]:
    """Coordinates of a hypothesis with each strength times its factor.

    Factors lie between `SHRINK` and `GROW`, and strengths within their bounds.
    """
    x = list(x)
    for strength, factor in zip(hypothesis.strengths, factors, strict=True):
        size = min(max(abs(factor), SHRINK), GROW) if factor else 0.0
        x[strength] = hypothesis.coordinates[strength].clipped(
            x[strength] * size * (1.0 if factor >= 0.0 else -1.0)
        )
    return x
