# SPDX-License-Identifier: Apache-2.0
"""Choice of the experiment that best discriminates the leading hypotheses.

Expected evidence of hypothesis i over j: half the squared distance of their whitened predictions,
after each was adapted within the uncertainty of its parameters (Box and Hill 1967; without
uncertainty the criterion of Hunter and Reiner 1965). The value of an experiment is the expected
evidence for the true hypothesis against its closest rival, averaged over the hypotheses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..statistics import evidence


@dataclass(frozen=True)
class Proposal:
    """An experiment and its expected result.

    Attributes:
        experiment: Name of the experiment.
        separates: The leading hypothesis and the rival that is hardest to distinguish from it.
        odds: Expected odds between these two after the experiment, whichever is true.
        value: Expected log odds of the true hypothesis against its closest rival [nat].
    """

    experiment: str
    separates: tuple[str, str]
    odds: float
    value: float


def rank(
    predictions: Mapping[str, Sequence[np.ndarray]],
    names: Sequence[str],
    floor: np.ndarray,
    probabilities: Sequence[float] | None = None,
    sensitivities: Mapping[str, Sequence[np.ndarray]] | None = None,
    tau: float = 1.0,
    expected_share: float = 1.0,
) -> list[Proposal]:
    """Experiments ordered by their expected value, the best first.

    Args:
        predictions: Per experiment one (T, C) array for each hypothesis; NaN = not compared.
        names: Names of the hypotheses, two or more.
        floor: Noise floor of each channel, times the residual scale of the best model, (C,).
        probabilities: Current probability of each hypothesis; None is uniform.
        sensitivities: Per experiment and hypothesis (T, C, P): change of the prediction for one
            standard error of each parameter.
        tau: Correlation time of the expected residual [samples].
        expected_share: Share of the expected evidence that the recordings gave so far.
    """
    p = np.ones(len(names)) if probabilities is None else np.asarray(probabilities, dtype=float)
    p = p / p.sum()
    prior = np.log(np.maximum(p, 1e-12))
    proposals = []
    for experiment, values in predictions.items():
        columns = sensitivities[experiment] if sensitivities else [None] * len(names)
        power = _powers([v / floor for v in values], columns, floor, prior, tau / expected_share)
        lowest = power.min(1)
        order = np.argsort(-p, kind="stable")
        rival = int(power[order[0]].argmin())
        proposals.append(
            Proposal(
                experiment,
                (names[order[0]], names[rival]),
                float(min(math.exp(min(lowest[order[0]], 700.0)), evidence.MOST_ODDS)),
                float(p @ lowest),
            )
        )
    return sorted(proposals, key=lambda x: (-x.value, x.experiment))


def expected(
    a: np.ndarray,
    b: np.ndarray,
    columns: np.ndarray | None = None,
    tau: float = 1.0,
) -> float:
    """Expected evidence between two predictions [nat], half their squared distance.

    Args:
        a: (T, C) [floors].
        b: (T, C) [floors].
        columns: (T, C, P), sensitivity to one standard error of every uncertain parameter [floors]:
            a difference in their span counts less.
        tau: Correlation time of the expected residual [samples].
    """
    valid = np.isfinite(a) & np.isfinite(b)
    z = (a - b)[valid] / math.sqrt(tau)
    energy = float(z @ z)
    if columns is not None and columns.shape[-1]:
        j = np.nan_to_num(columns[valid]) / math.sqrt(tau)
        g = j.T @ z
        energy -= float(g @ np.linalg.solve(np.eye(len(g)) + j.T @ j, g))
    return 0.5 * max(energy, 0.0)


def _powers(
    values: Sequence[np.ndarray],
    columns: Sequence[np.ndarray | None],
    floor: np.ndarray,
    prior: np.ndarray,
    tau: float,
) -> np.ndarray:
    """Expected log odds of hypothesis i over j if i is true [nat], (H, H); inf for i = j."""
    count = len(values)
    power = np.full((count, count), math.inf)
    for i in range(count):
        for j in range(count):
            if i == j:
                continue
            both = [c / floor[:, None] for c in (columns[i], columns[j]) if c is not None]
            free = np.concatenate(both, axis=2) if both else None
            gain = expected(values[i], values[j], free, tau)
            deviation = math.sqrt(2.0 * gain)  # standard deviation of the log likelihood ratio
            power[i, j] = math.log(evidence.odds(gain, deviation)) + prior[i] - prior[j]
    return power
