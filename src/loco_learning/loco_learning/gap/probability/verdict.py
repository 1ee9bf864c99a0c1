# SPDX-License-Identifier: Apache-2.0
"""The verdict by probabilities: the finest statement that is probable enough.

It decides nothing: `gap.json` has it beside the verdict of the rules (`verdict.judge`), and the
battery scores both on the same searches. To replace the rules by it:

- `judge` fits the most probable model, instead of the one that the rules select, without each of
  its effects and with others instead, until no other is more probable; models with a weight above
  0.001 are fitted to convergence (`finish`).
- A family without its idle joints (`judge._narrowed`) is one more model, not another judgement.
- `judge._best`, `_pruned`, `_swapped`, `_instead`, `_established`, `beats`, `decide._rule`,
  `lacks`, `serious`, `rivals.ratio`, `sharp`, `elsewhere`, `traded.believed` and the exceptions in
  `leftover` have nothing to decide then. Implausible values stay alarms, other settings a check.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..statistics import evidence
from ..verdict.decide import AMBIGUOUS, LIMITS, MORE, NAMED, NO_GAP, UNKNOWN, adequate, has_gap
from ..verdict.rivals import trifle
from .weights import CRITERION, NOTHING, Criterion, Weights, places, smallest


def statement(
    weights: Weights,
    given: Fitted,
    base: Fitted,
    sliding: set[str],
    enough: np.ndarray | None = None,
    criterion: Criterion = CRITERION,
) -> dict[str, Any]:
    """The verdict by probabilities, with the probabilities of the selected model.

    Args:
        weights: All models with their weights.
        given: The user's own model.
        base: The user's model with nominal values refitted.
        sliding: Prismatic joints, whose positions are lengths.
        enough: Rms over all records [floors] up to which a channel counts as explained, (C,).
        criterion: Free numbers.

    Returns:
        ``verdict``, ``names`` and ``ambiguous`` as in ``gap.json``; ``effects``, ``kinds`` and
        ``places``: probabilities by name.
    """
    model = weights.supported(criterion.confidence)
    sets = [
        smallest(weights.alternatives(model, i), criterion.confidence)
        for i in range(len(model.parts))
    ]
    explains = adequate(base.whole, model.whole, LIMITS, enough)
    negligible = explains and _negligible(weights, base, sliding, criterion)
    if not model.parts or negligible:
        verdict = NO_GAP if negligible or not has_gap(base.whole) else UNKNOWN
    else:
        pairs = (base.whole, model.whole), (given.held.residuals, model.held.residuals)
        closes = all(evidence.closed_by(*pair) >= criterion.closed for pair in pairs)
        verdict = _overall(sets, explains, closes)
    reported = verdict in (NAMED, MORE, AMBIGUOUS)
    names = {s[0] for s in sets if len(s) == 1} if reported else set()
    groups = {tuple(sorted(s)) for s in sets if len(s) > 1} if reported else set()
    kinds = sorted({EFFECTS[n].identity.kind for n in model.names} - {""})
    joints = sorted({p for h, _ in model.parts for p in places(h)} - {""})
    return {
        "verdict": verdict,
        "names": sorted(names),
        "ambiguous": [list(group) for group in sorted(groups)],
        "effects": {name: weights.effect(name) for name in model.names},
        "kinds": {kind: weights.kind(kind) for kind in kinds},
        "places": {place: weights.place(place) for place in joints},
    }


def _overall(sets: Sequence[tuple[str, ...]], explains: bool, closes: bool) -> str:
    """Verdict on a model from the alternatives of its effects.

    Args:
        sets: Smallest probable set of alternatives of each effect.
        explains: Whether the model explains the data.
        closes: Whether the model closes a large share of the gap.
    """
    if any(NOTHING in names for names in sets) or not (explains or closes):
        return UNKNOWN
    if any(len(names) > 1 for names in sets):
        return AMBIGUOUS
    return NAMED if explains else MORE


def _negligible(weights: Weights, base: Fitted, sliding: set[str], criterion: Criterion) -> bool:
    """True if a small gap may be due to effects that are too small to matter on any robot."""
    if np.nanmax(evidence.by_channel(base.whole)) > LIMITS.trifle:
        return False
    small = [
        bool(m.parts) and all(trifle(*part, sliding) for part in m.parts) for m in weights.models
    ]
    return bool(weights.values[small].sum() > 1.0 - criterion.confidence)
