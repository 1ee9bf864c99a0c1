# SPDX-License-Identifier: Apache-2.0
"""The experiment that would tell most next, of the robot's pool."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from loco_sim.plant.model import Model

from ..fitting.fit import Fitted
from ..prediction.case import Case
from ..prediction.forward import Forward
from ..verdict.decide import NO_GAP
from ..verdict.judge import Judged
from . import pool, propose

MOST_PROPOSALS = 3  # experiments that are proposed
HYPOTHESES = 3
ENOUGH = 1000.0  # odds from which on nothing is left to tell apart


def following(model: Model, case: Case, judged: Judged, notes: list[str]) -> list[dict[str, Any]]:
    """Experiments that tell the leading explanations apart, with the odds expected.

    Args:
        model: Model before the search.
        case: Model and data.
        judged: Decision with its evidence; nothing is proposed when it is settled.
        notes: Gets a sentence for each experiment that is not possible.
    """
    leading = hypotheses(judged)
    if judged.decision.verdict == NO_GAP or len(leading) < 2:
        return []
    robots = [case.forward.robot(i) for i in range(len(case.forward.records))]
    records = pool.records(model, pool.alike(model, pool.pool(model, notes), robots), notes)
    forward = Forward(case.forward.model, records)
    floors = _floors(case, forward, judged.best)
    there, every = replace(case, forward=forward), list(range(len(records)))
    said = [there.predicted(m.specs, m.overrides, every, there.step_of(m.specs)) for m in leading]
    predictions = {r.name: [p[i] for p in said] for i, r in enumerate(records)}
    ranked = propose.rank(predictions, [" + ".join(m.names) for m in leading], floors)
    return [
        {"experiment": p.experiment, "separates": list(p.separates), "odds": p.odds}
        for p in ranked[:MOST_PROPOSALS]
    ]


def hypotheses(judged: Judged) -> list[Fitted]:
    """The selected model and what is not excluded beyond doubt, one of each set of names."""
    leading = {judged.best.names: judged.best}
    for model, over in judged.rivals:
        if over.odds < ENOUGH:
            leading.setdefault(model.names, model)
    return list(leading.values())[:HYPOTHESES]


def _floors(case: Case, forward: Forward, best: Fitted) -> np.ndarray:
    """Floor times what the best model leaves, for the channels of a pool's records, (C,)."""
    known = {
        (c.signal, c.name): case.floor[i] * best.held.scale[i]
        for i, c in enumerate(case.forward.channels)
    }
    return np.array([known.get((c.signal, c.name), np.inf) for c in forward.channels])
