# SPDX-License-Identifier: Apache-2.0
"""Next experiment: the one of the robot's pool that best discriminates the explanations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from loco_sim.plant.model import Model

from ..fitting.fit import Fitted
from ..prediction.case import Case
from ..prediction.forward import Forward
from ..recordings.record import Record
from ..statistics import evidence
from ..statistics.leftover import LIMITS
from ..verdict.decide import NO_GAP
from ..verdict.judge import Outcome
from ..verdict.sensitivity import sensitivities
from . import pool, propose

MOST_PROPOSALS = 3  # experiments that are proposed
HYPOTHESES = 3
DECISIVE_RATIO = 1000.0  # ratio of probabilities above which an explanation is excluded
NEGLIGIBLE_EVIDENCE = 0.5  # evidence that is negligible [nat] (taste)


def following(model: Model, case: Case, outcome: Outcome, notes: list[str]) -> list[dict[str, Any]]:
    """Experiments that discriminate the leading explanations, with the expected odds.

    Args:
        model: Model before the search.
        case: Model and data.
        outcome: Decision with its evidence; without two explanations nothing is proposed.
        notes: List to which a sentence is appended for each impossible experiment.
    """
    leading = hypotheses(outcome)
    if outcome.decision.verdict == NO_GAP or len(leading) < 2:
        return []
    robots = [case.forward.robot(i) for i in range(len(case.forward.records))]
    records = pool.records(model, pool.usable(model, pool.pool(model, notes), robots), notes, True)
    records = [r for r in records if not any(pool.same_motion(r, one) for one in case.records)]
    if not records:
        notes.append("every experiment of the pool was recorded already")
        return []
    extended, every = along(case, records), list(range(len(records)))
    floors = _floors(case, extended.forward, outcome.best)
    runs = [_predict(extended, m, every) for m in leading]
    free = [_columns(case, extended, m, base, every) for m, base in zip(leading, runs, strict=True)]
    predictions, deviations = (
        {r.name: [each[i] for each in both] for i, r in enumerate(records)} for both in (runs, free)
    )
    names, tau = [" + ".join(m.names) for m in leading], float(np.median(outcome.best.score.tau))
    probability = {m.key: p for m, p in [(outcome.best, outcome.probability), *outcome.rivals]}
    weights = [probability[m.key] for m in leading]
    ranked = propose.rank(
        predictions, names, floors, weights, deviations, tau, _expected_share(outcome, leading, tau)
    )
    return [
        {"experiment": p.experiment, "separates": list(p.separates), "odds": p.odds}
        for p in ranked[:MOST_PROPOSALS]
    ]


def along(case: Case, records: Sequence[Record]) -> Case:
    """The case along other records, whose motion is simulated even if torques are compared."""
    return replace(case, forward=Forward(case.forward.model, records), records=list(records))


def hypotheses(outcome: Outcome) -> list[Fitted]:
    """The selected model and the rivals that are not excluded, one per set of names.

    Models that close almost nothing of the gap are omitted: what discriminates causes of a small
    part of the gap does not help with its main cause.
    """
    base, floor = outcome.base.held.residuals, outcome.probability / DECISIVE_RATIO
    models = [outcome.best, *(model for model, value in outcome.rivals if value > floor)]
    leading: dict[tuple[str, ...], Fitted] = {}
    for model in models:
        if evidence.closed_by(base, model.held.residuals) >= LIMITS.least:
            leading.setdefault(model.names, model)
    return list(leading.values())[:HYPOTHESES]


def _predict(case: Case, model: Fitted, every: list[int]) -> list[np.ndarray]:
    """Predictions of a model, (T, C) for each experiment; all have the same error of the step."""
    return case.predicted(model.specs, model.overrides, every, 1.0)


def _columns(
    case: Case, extended: Case, model: Fitted, predictions: list[np.ndarray], every: list[int]
) -> list[np.ndarray]:
    """Change of predictions by one standard error of each parameter, (T, C, P) each.

    Args:
        case: Model and data, from which the standard errors are computed.
        extended: The case with the experiments in place of the records.
        model: Fitted model.
        predictions: Predictions of the model.
        every: Indices of the experiments.
    """
    analysis = sensitivities(case, model)[1]
    columns, errors = [], iter(analysis.errors if analysis else ())
    for index, (_, x) in enumerate(model.parts):
        for j, error in zip(range(len(x)), errors, strict=False):
            by = min(float(error), max(1.0, abs(x[j])))  # at most a typical size
            specs = model.moved(index, [v + by * (k == j) for k, v in enumerate(x)])
            moved = extended.predicted(specs, model.overrides, every, 1.0)
            columns.append([a - b for a, b in zip(moved, predictions, strict=True)])
    if not columns:
        return [np.zeros((*each.shape, 0)) for each in predictions]
    return [np.stack(each, axis=-1) for each in zip(*columns, strict=True)]


def _expected_share(outcome: Outcome, leading: list[Fitted], tau: float) -> float:
    """Ratio of the evidence that the recordings gave to what was expected of them, at most 1.

    For the rivals to be discriminated. The part of the gap that no model explains makes every
    expectation too large, for an experiment as for the recordings.
    """
    probabilities, shares = {model.key: p for model, p in outcome.rivals}, []
    for rival in leading:
        if rival.key not in probabilities:
            continue
        pairs = zip(outcome.best.whole, rival.whole, strict=True)
        scale = outcome.best.held.scale
        hoped = sum(propose.expected(a / scale, b / scale, tau=tau) for a, b in pairs)
        gained = math.log(max(outcome.probability / max(probabilities[rival.key], 1e-300), 1.0))
        shares.append(max(gained, NEGLIGIBLE_EVIDENCE) / max(hoped, NEGLIGIBLE_EVIDENCE))
    return min([1.0, *shares])


def _floors(case: Case, forward: Forward, best: Fitted) -> np.ndarray:
    """Floor times residual scale of the best model, for the channels of an experiment, (C,)."""
    by_channel = {
        (c.signal, c.name): case.floor[i] * best.held.scale[i]
        for i, c in enumerate(case.forward.channels)
    }
    return np.array([by_channel.get((c.signal, c.name), np.inf) for c in forward.channels])
