# SPDX-License-Identifier: Apache-2.0
"""Confidence intervals for systematic residuals, with uncertain values of the robot.

Residuals of an inexact model are correlated in time and within a record. The gradient of a whole
record with respect to a parameter is therefore one draw, or that of a piece that restarts from
measurements: the sandwich estimator over these clusters (White 1980; Liang and Zeger 1986), with
Student's law for the number of draws.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from .identify import DEAD, inverse

MIN_CLUSTERS = 4  # smallest number of clusters: Student's law of one draw is useless (taste)


def clusters(residuals: Sequence[np.ndarray], starts: Sequence[Sequence[int]]) -> np.ndarray:
    """Cluster of each value of `identify.flat`, (N,); -1 after the last used row of a record.

    A cluster is a record, or each of its pieces that restarts from a measured state; if there are
    fewer than `MIN_CLUSTERS` in all, each is divided evenly.

    Args:
        residuals: Residuals of each record, (T, C), NaN where not used.
        starts: First row of each of its pieces but the first, for each record.
    """
    edges = []
    for r, rows in zip(residuals, starts, strict=True):
        end = int(np.max(np.flatnonzero(np.isfinite(r).any(axis=1)), initial=-1)) + 1
        edges.append(np.array([0, *(row for row in rows if row < end), end]))
    parts = -(-MIN_CLUSTERS // max(sum(len(e) - 1 for e in edges if e[-1]), 1))
    groups, before = [], 0
    for r, e in zip(residuals, edges, strict=True):
        group = np.full(len(r), -1)
        if e[-1]:
            segment = np.repeat(np.arange(len(e) - 1), np.diff(e))
            part = (np.arange(e[-1]) - e[segment]) * parts // np.diff(e)[segment]
            group[: e[-1]] = before + parts * segment + part
            before += parts * (len(e) - 1)
        groups.append(np.repeat(group, r.shape[1]))
    return np.concatenate(groups)


def half_widths(
    columns: np.ndarray,
    extra: np.ndarray,
    residual: np.ndarray,
    groups: np.ndarray,
    weight: np.ndarray,
    at: np.ndarray | None = None,
) -> np.ndarray:
    """Half of the 95 % interval of each parameter, (P,); inf where the data do not determine it.

    It adds three variances: of the clusters' gradients, of noise with all uncertain values free
    within their priors, and of the change of the fit if these values were refitted.

    Args:
        columns: (N, P) change of the residual [floors] per unit of a parameter, at the fit.
        extra: (N, K) the same per standard deviation of each uncertain value.
        residual: (N,) predicted minus measured [floors], NaN = not measured.
        groups: (N,) cluster of each row.
        weight: (N,) information of each row (`identify.weights`).
        at: (K,) current deviations of the uncertain values; 0 by default.
    """
    both = np.concatenate([columns, extra], axis=1)
    used = np.isfinite(both).all(1) & np.isfinite(residual) & (weight > 0.0)
    count, root = columns.shape[1], np.sqrt(weight[used])
    j, r, groups = both[used] * root[:, None], residual[used] * root, groups[used]
    widths = np.full(count, np.inf)
    live = np.linalg.norm(j[:, :count], axis=0) > DEAD
    keys = np.unique(groups)
    if len(keys) < 2 or not live.any():
        return widths
    fit, free = j[:, :count][:, live], np.concatenate([j[:, :count][:, live], j[:, count:]], 1)
    prior = np.diag([0.0] * fit.shape[1] + [1.0] * (free.shape[1] - fit.shape[1]))
    alone, joint = inverse(fit.T @ fit), inverse(free.T @ free + prior)
    pulls = np.array([alone @ (fit[groups == k].T @ r[groups == k]) for k in keys])
    variance = len(keys) / (len(keys) - 1.0) * np.square(pulls).sum(0)
    pull = free.T @ r
    pull[fit.shape[1] :] += 0.0 if at is None else at
    noise, moved = np.diag(joint)[: len(variance)], (joint @ pull)[: len(variance)]
    quantile = stdtrit(len(keys) - 1, 0.975)
    widths[live] = quantile * np.sqrt(variance + noise + np.square(moved))
    return widths
