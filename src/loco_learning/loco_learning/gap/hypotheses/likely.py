# SPDX-License-Identifier: Apache-2.0
"""Preselection of hypotheses for robots on the ground, where one simulation costs seconds.

Each hypothesis is tested on a few pieces of the recordings: at a typical size and at the size that
would explain most if the model were linear, and once more if the residual does not fall as
predicted. One with a place, as of a payload on the trunk, is then moved to where it would explain
most. An effect in a joint shows in that joint first, so only joints with a conspicuous
residual are tested one by one, if they are few.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError

from ..prediction.case import Case
from ..statistics import evidence
from .hypotheses import Hypothesis

CONSPICUOUS = 0.5  # share of the largest gap of a joint above which a joint is tested by itself
MOST_JOINTS = 4  # conspicuous joints; with more of them, none is tested by itself
MAX_HYPOTHESES = 24  # hypotheses that are kept
MIN_PLACES = 1  # places of each effect that are kept, at least
MIN_EVIDENCE = 3.0  # smallest evidence for it [nat]; a useless parameter gains half a nat (theory)
ROUNDS, KEEPS = 2, 0.7  # linear steps; share of their predicted decrease that is enough (taste)
GROW, SHRINK = 30.0, 0.03  # largest and smallest factor from one tried size to the next
STEPS, MOVE = 3, 0.1  # linear steps of a place, and finite difference along it (taste)
NOTHING = 0.02  # increase of a share below which a place is good enough (taste)
JOINT_SIGNALS = ("q", "dq", "tau")

Each = Callable[[Callable, Sequence[tuple]], Iterator[Any]]


def likely_hypotheses(
    case: Case, hypotheses: Sequence[Hypothesis], each: Each
) -> tuple[list[Hypothesis], list[tuple[str, str]], list[tuple]]:
    """Hypotheses that are worth a search.

    Args:
        case: Model and data.
        hypotheses: Hypotheses to choose from.
        each: Runs a function of the case with many arguments in parallel, results in order.

    Returns:
        The kept hypotheses; the effects without a kept hypothesis, each with the reason; and a list
        of the hypothesis that explains most with its coordinates, empty if none explains anything.
    """
    joints = {c.name for c in case.forward.channels if c.signal in JOINT_SIGNALS}
    loud_joints = conspicuous(case)
    candidates = [h for h in hypotheses if h.place not in joints or h.place in loud_joints]
    results = list(each(share, [(h,) for h in candidates]))
    shares = [result for result, _ in results]
    order = sorted(range(len(candidates)), key=lambda i: (-shares[i], candidates[i].key))
    retained = set(order[:MAX_HYPOTHESES])
    for effect in {h.effect for h in candidates}:
        ranked = [i for i in order if candidates[i].effect == effect and shares[i] > 0.0]
        retained |= set(ranked[:MIN_PLACES])
    left = [
        _started(h, x)
        for i, (h, (_, x)) in enumerate(zip(candidates, results, strict=True))
        if i in retained and shares[i] > 0.0
    ]
    unused = {h.effect for h in hypotheses} - {h.effect for h in left}
    notes = [(name, "it explains nothing of a few pieces on the ground") for name in sorted(unused)]
    first = order[0] if order and shares[order[0]] > 0.0 else None
    return left, notes, [] if first is None else [(candidates[first], results[first][1])]


def _started(hypothesis: Hypothesis, x: Sequence[float]) -> Hypothesis:
    """The hypothesis with its places where they explain most, from where a search starts."""
    coordinates = [
        c if c.strength or c.logarithmic else replace(c, start=(float(v),))
        for c, v in zip(hypothesis.coordinates, x, strict=True)
    ]
    return replace(hypothesis, coordinates=tuple(coordinates))


def conspicuous(case: Case) -> set[str]:
    """Joints whose residual is much larger than that of the others; none if most are alike."""
    whitened = [np.where(r[:, None], w, np.nan) for r, w in _rows(case)]
    power: dict[str, float] = {}
    for i, channel in enumerate(case.forward.channels):
        if channel.signal in JOINT_SIGNALS:
            excess = evidence.excess([w[:, [i]] for w in whitened])
            power[channel.name] = power.get(channel.name, 0.0) + excess
    peak = max(power.values(), default=0.0)
    loud = {name for name, value in power.items() if value > CONSPICUOUS * peak}
    return loud if len(loud) <= MOST_JOINTS else set()


def _rows(case: Case) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    return zip(case.fit_rows, case.whitened([]), strict=True)


def share(case: Case, hypothesis: Hypothesis) -> tuple[float, list[float]]:
    """Share of the residual's energy that a hypothesis explains at the best of a few sizes.

    Returns:
        The share, and the coordinates there.
    """
    subset = case.sparse
    before = subset.vector([], coarse=True)
    starts = hypothesis.starts()
    both_ways = [s for s in starts[1:] if _opposite(hypothesis, s, starts[0])]
    try:
        tries = [_share(subset, hypothesis, list(x), before) for x in (starts[0], *both_ways)]
    except LocoError:
        return 0.0, list(starts[0])
    best = _placed(subset, hypothesis, *max(tries, key=itemgetter(0)), before)
    return best if best[0] * _square(before) > 2.0 * MIN_EVIDENCE else (0.0, best[1])


def _opposite(hypothesis: Hypothesis, x: Sequence[float], first: Sequence[float]) -> bool:
    return any(x[i] * first[i] < 0.0 for i in hypothesis.strengths)


def _share(
    case: Case, hypothesis: Hypothesis, x: list[float], before: np.ndarray
) -> tuple[float, list[float]]:
    best, energy = (0.0, x), _square(before)
    for _ in range(ROUNDS):
        columns = _columns(case, hypothesis, x, before)
        factors = _factors(hypothesis, columns, before)
        predicted = 1.0 - _square(before + columns @ factors) / energy
        if len(factors) == 1:
            best = max(best, (1.0 - _square(before + columns[:, 0]) / energy, x), key=itemgetter(0))
        if not np.any(factors):
            break
        x = _scaled(hypothesis, x, factors)
        residual = case.vector([hypothesis.term(x).spec], coarse=True)
        best = max(best, (1.0 - _square(residual) / energy, x), key=itemgetter(0))
        if best[0] > KEEPS * predicted:
            break
    return best


def _placed(
    case: Case, hypothesis: Hypothesis, share: float, x: list[float], before: np.ndarray
) -> tuple[float, list[float]]:
    """Share and coordinates after linear steps along places and strengths, while these help."""
    coordinates = hypothesis.coordinates
    linear = [i for i, c in enumerate(coordinates) if not c.logarithmic]
    if share <= 0.0 or all(coordinates[i].strength for i in linear):
        return share, x

    def moved(by: np.ndarray) -> list[float]:
        at = np.array(x)
        at[linear] += by
        return [c.clipped(float(v)) for c, v in zip(coordinates, at, strict=True)]

    def residual(at: Sequence[float]) -> np.ndarray:
        return case.vector([hypothesis.term(at).spec], coarse=True)

    for _ in range(STEPS):
        at_start = residual(x)
        columns = [(residual(moved(MOVE * axis)) - at_start) / MOVE for axis in np.eye(len(linear))]
        at_solution = moved(-np.linalg.lstsq(np.stack(columns, axis=1), at_start, rcond=1e-6)[0])
        after = 1.0 - _square(residual(at_solution)) / _square(before)
        if after < share + NOTHING:
            break
        share, x = after, at_solution
    return share, x


def _columns(
    case: Case, hypothesis: Hypothesis, x: Sequence[float], before: np.ndarray
) -> np.ndarray:
    """Change of the residual by each strength alone, (N, s)."""
    columns = []
    for strength in hypothesis.strengths:
        at = [v if i == strength or i not in hypothesis.strengths else 0.0 for i, v in enumerate(x)]
        specs: list[Mapping] = [hypothesis.term(at).spec]
        columns.append(case.vector(specs, coarse=True) - before)
    return np.stack(columns, axis=1)


def _factors(hypothesis: Hypothesis, columns: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Factors of the strengths that explain most in a linear model; 0 of a forbidden sign."""
    factors = -np.linalg.lstsq(columns, before, rcond=1e-6)[0]
    allowed = [not hypothesis.coordinates[i].one_sided for i in hypothesis.strengths]
    return np.where((factors > 0.0) | np.array(allowed), factors, 0.0)


def _scaled(hypothesis: Hypothesis, x: Sequence[float], factors: np.ndarray) -> list[float]:
    x = list(x)
    for i, factor in zip(hypothesis.strengths, factors, strict=True):
        size = float(np.clip(abs(factor), SHRINK, GROW)) * np.sign(factor)
        x[i] = hypothesis.coordinates[i].clipped(x[i] * size)
    return x


def _square(values: np.ndarray) -> float:
    return max(float(values @ values), 1e-300)
