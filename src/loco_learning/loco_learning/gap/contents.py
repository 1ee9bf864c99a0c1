# SPDX-License-Identifier: Apache-2.0
"""Contents of ``gap.json``: the verdict and its evidence as plain numbers and text."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from loco_control.params import to_dict
from loco_sim.effects.base import EFFECTS
from loco_sim.effects.places import members
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ..plain import plain
from .fitting import residual
from .fitting.fit import Fitted
from .fitting.params import GapParams
from .localisation import correction
from .localisation.localise import localise
from .localisation.regions import regions
from .prediction import horizon
from .prediction.case import Case
from .prediction.channels import ON_SLIDES, Channel, slides
from .prediction.nominal import written
from .probability.weights import CRITERION, Weights, locations
from .proposals.following import following
from .recordings.record import Doubt, Record
from .statistics import evidence, identify
from .statistics.leftover import LIMITS
from .verdict import rounding, scale
from .verdict.decide import AMBIGUOUS, NAMED, NO_GAP, PARTLY, UNKNOWN, Decision
from .verdict.judge import Outcome
from .verdict.traded import put_right

FORMAT = 1
WHERE, LEARNED = 3, 6  # keys of random streams
FEW_JOINTS = 3  # joints listed by name
MAX_RIVALS, MOST_CELLS = 8, 40  # rival models and cells listed at most
COMPENSATION = "friction_compensation"
LISTED = 0.01  # probability of a place from which on it is listed
EMPTY = {"where": [], "regions": [], "identifiability": {}, "correction": None,
         "residual": None, "next": []}  # fmt: skip

NOT_LEARNED = (
    "No learned correction: what is left does not hang on positions, speeds and torques of the "
    "joints."
)

log = logging.getLogger(__name__)


def contents(
    model: Model,
    case: Case,
    outcome: Outcome,
    params: GapParams,
    not_tried: Sequence[tuple[str, str]] = (),
) -> dict[str, Any]:
    """Contents of ``gap.json`` that hold the verdict, without the parts that `details` adds.

    Args:
        model: Robot, overrides and effects before the search.
        case: Model and data.
        outcome: Decision with its evidence.
        params: Settings.
        not_tried: Name and reason of each effect that the search did not test.
    """
    decision = outcome.decision
    after = outcome.after
    with_gap = decision.verdict != NO_GAP
    warnings = [f"{r.name}: {warning}" for r in case.records for warning in r.warnings]
    reading = reading_warnings(case.records)
    return plain(
        {
            "format": FORMAT,
            "verdict": decision.verdict,
            "evidence": decision.evidence,
            "adequate": decision.adequate,
            "names": list(decision.names),
            "terms": in_metres(terms(outcome, case.forward.given()), case.forward.channels)
            if with_gap
            else [],
            "rivals": rival_models(outcome) if with_gap else [],
            "over_settings": [row.plain for row in outcome.over_settings],
            "ambiguous": [list(group) for group in decision.ambiguous],
            "kinds": kinds_of(outcome.weights, decision) if with_gap else [],
            "probability": probabilities(outcome.weights, outcome.best) if with_gap else {},
            "gap": gap(case, outcome.given, after),
            "alarms": [
                *outcome.alarms,
                *less_friction(case.forward.given(), outcome.best),
                *warnings,
            ],
            "align": [f"{r.name}: {note}" for r in case.records for note in r.notes],
            "reading": reading,
            "notes": [
                *reading,
                *horizon.messages(case.forward),
                *rounding.notes(case.records, case.forward.robot()),
                *scale.currents(after.loose),
            ],
            "pieces": case.forward.params.ground,
            "not_tried": [{"effect": name, "reason": reason} for name, reason in not_tried],
            "compared": case.forward.how,
            "nuisance": {**after.overrides, **after.loose},
            "settings": to_dict(params),
            "model": {
                "robot": model.robot,
                "overrides": {
                    **model.overrides,
                    **written(case.forward.given(), put_right(case, after)),
                },
                "effects": [*model.effects, *after.specs],
            },
            **EMPTY,
        }
    )


def probabilities(weights: Weights, model: Fitted) -> dict[str, dict[str, float]]:
    """Probabilities of the effects of a model, of their kinds and of their places, by name."""
    categories = sorted({EFFECTS[name].identity.kind for name in model.names} - {""})
    where = sorted({p for h, _ in model.parts for p in locations(h)} - {""})
    return {
        "effects": {name: weights.effect(name) for name in model.names},
        "kinds": {kind: weights.kind(kind) for kind in categories},
        "places": {place: weights.place(place) for place in where},
    }


def less_friction(robot: Robot, model: Fitted) -> list[str]:
    """A sentence if compensated friction may as well be too much friction in the URDF; else none.

    Args:
        robot: Robot of the model.
        model: Selected model.
    """
    text = Description(robot.urdf)
    compensated = [p for h, _ in model.parts if h.effect == COMPENSATION for p in locations(h)]
    joints = {joint for place in compensated for joint in members(robot, place)}
    rubs = [j for j in robot.joints if j in joints and text.friction(j) + text.damping(j) > 0.0]
    return [
        f"{COMPENSATION} in {joint}: less friction than the URDF has there moves as it does; turn "
        "the joint by hand with its drive off"
        for joint in rubs
    ]


def reading_warnings(records: Sequence[Record]) -> list[str]:
    """Import notes on conditions that can look like a gap, each once with its records."""
    names: dict[str, list[str]] = {}
    for record in records:
        for note in record.notes:
            if isinstance(note, Doubt):
                names.setdefault(note, []).append(record.name)
    return [f"{', '.join(of)}: {note}" for note, of in names.items()]


@dataclass(frozen=True)
class Detail:
    """A part of ``gap.json`` that the verdict does not need.

    Attributes:
        key: Key of the part.
        stage: Name of the work on it, for progress messages.
        make: Function that computes the part; it may append sentences to a list of notes.
    """

    key: str
    stage: str
    make: Callable[[list[str]], Any]


def details(
    model: Model, case: Case, outcome: Outcome, params: GapParams, each: residual.Each
) -> list[Detail]:
    """Parts of ``gap.json`` that are computed after the verdict was written, in order.

    Args:
        model: Robot, overrides and effects before the search.
        case: Model and data.
        outcome: Decision with its evidence.
        params: Settings.
        each: Runs functions of the case in parallel, in any number of processes.
    """
    verdict, items = outcome.decision.verdict, []
    if verdict != NO_GAP:
        items += [
            Detail("where", "locating the gap", lambda notes: where(case, outcome, params.seed)),
            Detail("regions", "locating the gap", lambda notes: regions_of(case, outcome.given)),
            Detail("identifiability", "asking what can be told apart",
                   lambda notes: told_apart(case, outcome)),
        ]  # fmt: skip
    if verdict == UNKNOWN:
        items.append(
            Detail("correction", "fitting a correction", lambda notes: fallback(case, outcome.base))
        )
    if verdict in (UNKNOWN, PARTLY) and params.residual:
        items.append(Detail("residual", "fitting a learned correction",
                            lambda notes: learned(case, outcome, params.seed, each)))  # fmt: skip
    return [*items, Detail("next", "looking for the next experiment",
                           lambda notes: following(model, case, outcome, notes))]  # fmt: skip


def add(result: Mapping[str, Any], detail: Detail) -> dict[str, Any]:
    """Contents of ``gap.json`` with a detail, or with a note that says why it is missing.

    Every exception is caught: a failed detail must not discard the result of the search.
    """
    notes: list[str] = []
    try:
        entry = {detail.key: plain(detail.make(notes))}
    except Exception as error:
        log.exception("%s failed", detail.stage)
        entry, notes = {}, [f"{detail.stage} failed: {error}"]
    return {**result, **entry, "notes": [*result["notes"], *notes]}


def in_metres(terms: Sequence[Mapping[str, Any]], channels: Sequence[Channel]) -> list[dict]:
    """Terms of ``gap.json``; where the joint is prismatic, with linear units instead of angular."""
    sliding = slides(channels)
    return [
        {
            **term,
            "parameters": {k: _in_metres(p) for k, p in term["parameters"].items()},
            **{
                key: term[key].replace(" N·m", " N").replace(" rad", " m")
                for key in ("evidence", "amount")
                if key in term
            },
        }
        if sliding.intersection(term["place"].split())
        else dict(term)
        for term in terms
    ]


def _in_metres(parameter: Mapping[str, Any]) -> dict[str, Any]:
    return {**parameter, "unit": ON_SLIDES.get(parameter["unit"], parameter["unit"])}


def terms(outcome: Outcome, robot: Robot) -> list[dict[str, Any]]:
    """Effects of the selected model with their evidence; the robot is that of the given model."""
    return [_term(outcome, robot, index) for index in range(len(outcome.decision.rulings))]


def _term(outcome: Outcome, robot: Robot, index: int) -> dict[str, Any]:
    term, model = outcome.decision.rulings[index], outcome.best
    without = outcome.without[index] if outcome.without else outcome.base
    closed = evidence.closed_by(without.whole, model.whole)
    text = (
        f"without {'it' if outcome.without else 'any effect'} the rms is {without.held.rms:.3g} "
        f"noise floors on held-out data and {evidence.rms(without.whole):.3g} on all, with it "
        f"{model.held.rms:.3g} and {evidence.rms(model.whole):.3g}"
    )
    estimates = outcome.estimates[model.parts[index][0].key]
    for e in estimates:
        if e.excludes_absent and e.low <= e.absent <= e.high:
            size = f"{e.value:.3g} ± {e.with_shapes:.2g}" + f" {e.unit}" * (e.unit != "-")
            text += f"; {e.name} is known only together with its other values: {size} with these"
    hypothesis, x = model.parts[index]
    first = EFFECTS[term.name](**hypothesis.terms(x)[0].params)
    amount = "" if hypothesis.joints else first.amount(robot)
    text += f"; {amount}" * bool(amount)
    return {
        "effect": term.name,
        "place": term.place,
        "places": list(term.places),
        "verdict": term.verdict,
        "probability": term.probability,
        "parameters": {
            e.name: {"value": e.value, "low": e.low, "high": e.high, "unit": e.unit}
            for e in estimates
        },
        "amount": amount,
        "closed": closed,
        "look_alikes": list(term.look_alikes),
        "evidence": text + ".",
    }


def kinds_of(weights: Weights, decision: Decision) -> list[dict[str, Any]]:
    """Kinds of effects that the data establish although they do not establish the law."""
    rows = []
    for term in decision.rulings:
        probability = weights.kind(term.kind) if term.kind else 0.0
        if probability >= CRITERION.confidence:
            names = sorted({term.name, *term.look_alikes})
            where = {p for name in names for p, v in weights.places_of(name).items() if v > LISTED}
            rows.append({
                "kind": term.kind, "places": sorted(where | {term.place}), "effects": names,
                "probability": probability,
            })  # fmt: skip
    return rows


def told_apart(case: Case, outcome: Outcome) -> dict[str, Any]:
    """Identifiability of the parameters, of refitted nominal values and of the torque scale."""
    result = identifiability(outcome.identifiability)
    if outcome.decision.verdict in (NAMED, PARTLY, AMBIGUOUS):
        result["scale_of_the_torque"] = scale.scale_messages(case, outcome.best)
    return result


def rival_models(outcome: Outcome) -> list[dict[str, Any]]:
    """Models with another effect, the most probable first."""
    base = outcome.base.held.residuals
    return [
        {
            "names": list(model.names),
            "places": [h.place for h, _ in model.parts],
            "probability": probability,
            "closed": evidence.closed_by(base, model.held.residuals),
        }
        for model, probability in outcome.rivals[:MAX_RIVALS]
    ]


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


def where(case: Case, outcome: Outcome, seed: int) -> list[dict[str, Any]]:
    """Cells (joint, signal, phase, frequency band) with most of the gap before the search."""
    rng = np.random.default_rng([seed, WHERE])
    result = localise(case.records, case.forward.channels, outcome.given.whole, rng)
    return [asdict(cell) for cell in result.cells[: min(result.main, MOST_CELLS)]]


def regions_of(case: Case, before: Fitted) -> list[str]:
    """Regions of the state space in which the gap before the search is large, in words."""
    return [str(r) for r in regions(case.records, case.forward.channels, before.whole)]


def fallback(case: Case, before: Fitted) -> dict[str, Any] | None:
    """Correction of a gap that no effect explains, fitted to the rows that are not held out."""
    rows = [np.where(r[:, None], 1.0, np.nan) for r in case.fit_rows]
    left = [-r * case.floor * keep for r, keep in zip(before.whole, rows, strict=True)]
    result = correction.fit(case.records, case.forward.channels, left, case.floor)
    return (
        None
        if result is None
        else {**asdict(result), "channels": [asdict(c) for c in result.channels]}
    )


def learned(case: Case, outcome: Outcome, seed: int, each: residual.Each) -> dict[str, Any]:
    """Learned correction of the remaining residual, judged by the same rules as an effect.

    Args:
        case: Model and data.
        outcome: Decision with the selected model.
        seed: Seed of the resampling.
        each: Runs functions of the case in parallel, in any number of processes.
    """
    result = residual.fit(case, outcome.after, each)
    if result is None:
        return {"kind": correction.KIND, "used": False, "effects": [], "says": NOT_LEARNED}
    rng = np.random.default_rng([seed, LEARNED])
    logs = evidence.log_weights((result.after, result.before), 0, (0.0, 0.0), rng)
    probability = float(1.0 / np.exp(np.logaddexp(*logs)))
    closed = evidence.closed_by(result.before.residuals, result.after.residuals)
    before, after = result.before.rms, result.after.rms
    against = []
    if probability < CRITERION.confidence:
        against.append(f"its gain may be chance (probability {probability:.2f})")
    if closed < LIMITS.least:
        against.append(f"it closes only {closed:.0%} of the gap")
    names, count = ", ".join(result.joints), len(result.joints)
    where = names if count <= FEW_JOINTS else f"{count} joints"
    text = (
        f"A learned correction of the torque in {where} closes {closed:.0%} of the rms above noise "
        f"on held-out data: {before:.3g} noise floors without it, {after:.3g} with it. It "
        "explains nothing."
    )
    return {
        "kind": correction.KIND,
        "used": not against,
        "effects": [] if against else result.effects,
        "joints": list(result.joints),
        "explained": result.explained,
        "before": before,
        "after": after,
        "closed": closed,
        "probability": probability,
        "records": [
            {
                "name": case.records[i].name,
                "before": evidence.rms([result.before.residuals[i]]),
                "after": evidence.rms([result.after.residuals[i]]),
            }
            for i in case.judging
        ],
        "says": text if not against else f"A learned correction is left out: {'; '.join(against)}.",
    }


def identifiability(analysis: identify.Identifiability | None) -> dict[str, Any]:
    """Identifiability of the parameters of the selected model."""
    if analysis is None:
        return {}
    errors: Sequence[float] = analysis.errors
    return {
        "worst_direction": analysis.worst,
        "standard_errors": dict(zip(analysis.names, map(float, errors), strict=True)),
        "cannot_be_told_apart": [
            {"a": a, "b": b, "cosine": cosine} for a, b, cosine in analysis.alike
        ],
        "imitated_by_nominal_values": analysis.imitated if any(analysis.imitated.values()) else {},
        "without_effect_on_the_data": list(analysis.dead),
        "hardly_determined": list(analysis.weak),
    }
