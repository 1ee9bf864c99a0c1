# SPDX-License-Identifier: Apache-2.0
"""Contents of ``gap.json``: what was decided, in plain numbers and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from loco_control.params import to_dict
from loco_sim.model import Model

from ..plain import plain
from . import correction, evidence, identify, kinds, scale
from .candidates import Candidate
from .case import Case
from .channels import ON_SLIDES, Channel, slides
from .decide import AMBIGUOUS, NAMED, NO_GAP, UNKNOWN, Ruling
from .fit import Fitted
from .judge import Judged
from .localise import localise
from .params import GapParams
from .regions import regions

FORMAT = 1
WHERE = 3  # key of a random stream
MOST = 40  # cells that are told


def contents(model: Model, case: Case, judged: Judged, params: GapParams) -> dict[str, Any]:
    """Contents of ``gap.json`` but for the next experiment.

    Args:
        model: As it came.
        case: Model and data.
        judged: What was decided.
        params: Settings.
    """
    decision = judged.decision
    after = judged.base if decision.verdict in (NO_GAP, UNKNOWN) else judged.best
    told = decision.verdict != NO_GAP
    return plain(
        {
            "format": FORMAT,
            "verdict": decision.verdict,
            "evidence": decision.evidence,
            "names": list(decision.names),
            "terms": terms(judged) if told else [],
            "rivals": rivals(judged) if told else [],
            "ambiguous": [list(group) for group in decision.ambiguous],
            "kinds": kinds_of(judged) if told else [],
            "gap": gap(case, judged.base, after),
            "where": where(case, judged.base, params.seed) if told else [],
            "regions": regions_of(case, judged.base) if told else [],
            "alarms": list(decision.alarms),
            "identifiability": told_apart(case, judged) if told else {},
            "next": [],
            "correction": fallback(case, judged.base) if decision.verdict == UNKNOWN else None,
            "align": [f"{r.name}: {note}" for r in case.records for note in r.notes],
            "nuisance": dict(after.overrides),
            "settings": to_dict(params),
            "model": {
                "robot": model.robot,
                "overrides": {**model.overrides, **after.overrides},
                "effects": [*model.effects, *after.specs],
            },
        }
    )


def in_metres(terms: Sequence[Mapping[str, Any]], channels: Sequence[Channel]) -> list[dict]:
    """The terms of ``gap.json`` with the units of slides where that is what their joint does."""
    sliding = slides(channels)
    return [
        {**term, "parameters": {k: _in_metres(p) for k, p in term["parameters"].items()}}
        if sliding.intersection(term["place"].split())
        else dict(term)
        for term in terms
    ]


def _in_metres(parameter: Mapping[str, Any]) -> dict[str, Any]:
    return {**parameter, "unit": ON_SLIDES.get(parameter["unit"], parameter["unit"])}


def terms(judged: Judged) -> list[dict[str, Any]]:
    """Effects of the selected model with their evidence."""
    pairs = zip(judged.candidates, judged.decision.rulings, strict=True)
    return [_term(candidate, ruling) for candidate, ruling in pairs]


def _term(candidate: Candidate, ruling: Ruling) -> dict[str, Any]:
    return {
        "effect": candidate.name,
        "place": candidate.place,
        "places": list(ruling.places),
        "verdict": ruling.verdict,
        "parameters": {
            e.name: {"value": e.value, "low": e.low, "high": e.high, "unit": e.unit}
            for e in candidate.estimates
        },
        "gain": _gain(candidate.gain),
        "odds": ruling.odds,
        "closed": candidate.closed,
        "look_alikes": list(ruling.look_alikes),
        "evidence": ruling.evidence,
    }


def kinds_of(judged: Judged) -> list[dict[str, Any]]:
    """Kinds that are named although their law is not."""
    pairs = zip(judged.candidates, judged.decision.rulings, strict=True)
    found = [kinds.shared(candidate, ruling) for candidate, ruling in pairs]
    return [asdict(one) for one in found if one]


def told_apart(case: Case, judged: Judged) -> dict[str, Any]:
    """What the data can tell of the parameters, of free values and of the scale of the torque."""
    found = identifiability(judged.identifiability) | left_out(judged)
    if judged.decision.verdict in (NAMED, AMBIGUOUS):
        found["scale of the torque"] = scale.words(case, judged.best)
    return found


def left_out(judged: Judged) -> dict[str, Any]:
    """Effects that were not considered, since refitted nominal values do the same."""
    there = {(h.effect, h.place) for h, _ in judged.best.parts}
    rows = [
        {
            "effect": effect,
            "place": place,
            "value": name,
            "goes to": one.model.overrides[name],
            "cosine": cosine,
            "gap would fall to": one.model.held.rms,
        }
        for one in judged.left_out
        for effect, place, cosine in one.effects
        for name in one.values
        if (effect, place) not in there
    ]
    return {"cannot be told from free values": rows} if rows else {}


def rivals(judged: Judged, most: int = 8) -> list[dict[str, Any]]:
    """Models with another effect, the hardest to exclude first."""
    base = judged.base.held.residuals
    return [
        {
            "names": list(model.names),
            "places": [h.place for h, _ in model.parts],
            "odds": over.odds,
            "gain": _gain(over),
            "closed": evidence.closed_by(base, model.held.residuals),
        }
        for model, over in judged.rivals[:most]
    ]


def _gain(found: evidence.Comparison) -> dict[str, float]:
    return {"mean": found.gain, "low": found.low, "high": found.high}


def gap(case: Case, before: Fitted, after: Fitted) -> dict[str, Any]:
    """Whitened rms before and after: on held-out data, per record and per channel."""
    every = range(len(case.records))
    held = [case.masked(m.whole, every, held=True) for m in (before, after)]
    channels = [
        {
            "signal": c.signal,
            "name": c.name,
            "unit": c.unit,
            "floor": float(case.floor[i]),
            "before": evidence.rms([r[:, i] for r in held[0]]),
            "after": evidence.rms([r[:, i] for r in held[1]]),
        }
        for i, c in enumerate(case.forward.channels)
    ]
    records = [
        {
            "name": record.name,
            "role": "fit" if case.fit_rows[i].any() else "held-out",
            "before": evidence.rms([before.whole[i]]),
            "after": evidence.rms([after.whole[i]]),
        }
        for i, record in enumerate(case.records)
    ]
    rms = (evidence.rms(held[0]), evidence.rms(held[1]))
    closed = evidence.closed_by(*held)
    numbers = {"before": rms[0], "after": rms[1], "floor": 1.0, "closed": closed}
    return {**numbers, "records": records, "channels": channels}


def where(case: Case, before: Fitted, seed: int) -> list[dict[str, Any]]:
    """Cells that hold most of the gap before."""
    rng = np.random.default_rng([seed, WHERE])
    found = localise(case.records, case.forward.channels, before.whole, rng)
    return [asdict(cell) for cell in found.cells[: min(found.main, MOST)]]


def regions_of(case: Case, before: Fitted) -> list[str]:
    """States in which the gap before lives, in words."""
    return [str(r) for r in regions(case.records, case.forward.channels, before.whole)]


def fallback(case: Case, before: Fitted) -> dict[str, Any] | None:
    """Correction of a gap without a name, fitted on what is not held out."""
    rows = [np.where(r[:, None], 1.0, np.nan) for r in case.fit_rows]
    left = [-r * case.floor * keep for r, keep in zip(before.whole, rows, strict=True)]
    found = correction.fit(case.records, case.forward.channels, left, case.floor)
    return (
        None
        if found is None
        else {**asdict(found), "channels": [asdict(c) for c in found.channels]}
    )


def identifiability(known: identify.Identifiability | None) -> dict[str, Any]:
    """What the data can tell of the parameters."""
    if known is None:
        return {}
    errors: Sequence[float] = known.errors
    return {
        "worst direction": known.worst,
        "standard errors": dict(zip(known.names, map(float, errors), strict=True)),
        "cannot be told apart": [
            {"a": a, "b": b, "cosine": cosine} for a, b, cosine in known.alike
        ],
        "imitated by nominal values": known.imitated if any(known.imitated.values()) else {},
        "without effect on the data": list(known.dead),
        "hardly determined": list(known.weak),
    }
