# SPDX-License-Identifier: Apache-2.0
"""Course of an effect over the days: absent, always there, or from or until one day.

All courses with at most one change are compared by their marginal likelihoods: in each part the
size is one normal value, near zero where the effect is absent.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

ABSENT, ALWAYS, APPEARS, DISAPPEARS, CHANGES = "absent", "always", "begins", "ends", "changes"
_PRESENT = {ABSENT: (False,), ALWAYS: (True,), APPEARS: (False, True), DISAPPEARS: (True, False),
          CHANGES: (True, True)}  # fmt: skip


class _Path(NamedTuple):
    """One possible course: kind, and first day after the change (0 without one)."""

    kind: str
    change: int


@dataclass(frozen=True)
class Course:
    """Most probable course of an effect over D days.

    Attributes:
        kind: `ABSENT`, `ALWAYS`, `APPEARS`, `DISAPPEARS` or `CHANGES`.
        present: Probability that the effect is there on any day.
        probability: Probability of the kind.
        change: Index of the first day after the change; None without one.
        date: Probability of that day among the days on which this kind of change is possible.
        sizes: Size on each day, (D,); 0 while the effect is absent.
        variances: Variance of the size, (D,).
    """

    kind: str
    present: float
    probability: float
    change: int | None
    date: float
    sizes: np.ndarray
    variances: np.ndarray


def course(
    sizes: np.ndarray, variances: np.ndarray, scale: float, tolerance: float, absent: float
) -> Course:
    """The most probable course of an effect.

    Args:
        sizes: Size on each day, (D,).
        variances: Variance of each, with that of the true sizes between days, (D,).
        scale: Standard deviation of the size of an effect that is there.
        tolerance: Standard deviation of the size that errors of the model imitate.
        absent: Probability, before the data, that the effect is absent on all days.
    """
    paths = list(_paths(len(sizes)))
    labels = [path.kind for path in paths]
    n_present = len(set(labels) - {ABSENT})
    prior = [
        math.log(absent if k == ABSENT else (1.0 - absent) / n_present) - math.log(labels.count(k))
        for k in labels
    ]
    logs = np.array([
        p + sum(
            _likelihood(sizes[part], variances[part], tolerance**2 + present * scale**2)
            for part, present in _parts(path, len(sizes))
        )
        for p, path in zip(prior, paths, strict=True)
    ])  # fmt: skip
    share = np.exp(logs - logsumexp(logs))
    of_kind = {k: float(share[[kind == k for kind in labels]].sum()) for k in dict.fromkeys(labels)}
    kind = max(of_kind, key=of_kind.__getitem__)
    best = max((i for i, k in enumerate(labels) if k == kind), key=share.__getitem__)
    level, error = np.zeros(len(sizes)), np.zeros(len(sizes))
    for part, present in _parts(paths[best], len(sizes)):
        if present:
            weight = 1.0 / variances[part]
            level[part], error[part] = weight @ sizes[part] / weight.sum(), 1.0 / weight.sum()
    change, total = paths[best].change or None, of_kind[kind]
    date = float(share[best] / total) if total > 0.0 else 0.0
    return Course(kind, 1.0 - of_kind[ABSENT], total, change, date, level, error)


def _paths(days: int) -> Iterator[_Path]:
    for kind, parts in _PRESENT.items():
        yield from (_Path(kind, k) for k in (range(1, days) if len(parts) > 1 else (0,)))


def _parts(path: _Path, days: int) -> Iterator[tuple[slice, bool]]:
    """Parts of a course, and whether the effect is there."""
    edges = [0, path.change, days] if path.change else [0, days]
    parts = zip(edges[:-1], edges[1:], _PRESENT[path.kind], strict=True)
    yield from ((slice(a, b), present) for a, b, present in parts)


def _likelihood(sizes: np.ndarray, variances: np.ndarray, prior: float) -> float:
    """Log likelihood of sizes of one normal value with mean 0 and variance `prior`."""
    weight = 1.0 / variances
    total = weight.sum() + 1.0 / prior
    fit = float(weight @ np.square(sizes) - (weight @ sizes) ** 2 / total)
    logs = np.log(2.0 * math.pi * variances).sum() + math.log(prior * total)
    return -0.5 * (fit + float(logs))
