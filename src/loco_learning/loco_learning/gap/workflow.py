# SPDX-License-Identifier: Apache-2.0
"""Find the gap between a model and measurements, name its cause, and prove it.

`find` takes a model and records and returns the contents of ``gap.json``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from loco_control.params import to_dict
from loco_sim.model import Model

from . import case as cases
from . import evidence
from .fit import Fitted
from .forward import Forward
from .hypotheses import offer
from .parallel import Tasks
from .params import GapParams
from .record import Record
from .search import Found, Search
from .structured import Hints

FORMAT = 1


def find(
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record] = (),
    params: GapParams | None = None,
    progress: Callable[[float, str, str], Any] | None = None,
    workers: int = 1,
) -> dict[str, Any]:
    """Compare a model with measurements and name what it lacks.

    Args:
        model: Robot, overrides and effects.
        records: To fit.
        held_out: To judge on; without any, the last third of each record judges.
        params: Settings.
        progress: Called with the share done, the stage and the best name so far.
        workers: Processes; the result is the same for any number.

    Returns:
        Contents of ``gap.json``.
    """
    params = params or GapParams()
    report = progress or (lambda fraction, stage, best: None)
    report(0.0, "reading the model", "")
    robot = model.make_robot()
    forward = Forward(model, [*records, *held_out])
    case = cases.prepare(forward, records, held_out)
    hypotheses = offer(robot, case.signals, hints(case, robot))
    wanted = params.effects
    hypotheses = [h for h in hypotheses if any(fnmatchcase(h.effect, w) for w in wanted)]
    tasks = Tasks(case, workers)
    try:
        search = Search(case, hypotheses, params, tasks, report, {})
        found = search.run()
        result = summary(model, case, search, found, params)
    finally:
        tasks.close()
    report(1.0, "done", " + ".join(result["names"]))
    return result


def hints(case: cases.Case, robot: Any) -> Hints:
    """What the data say before any fit: ranges of the joints."""
    n = len(robot.joints)
    low, high = np.full(n, np.nan), np.full(n, np.nan)
    for record in case.records:
        q = record.joints_of(robot, "q")
        with np.errstate(all="ignore"):
            for j in range(n):
                values = q[np.isfinite(q[:, j]), j]
                if len(values):
                    low[j], high[j] = np.fmin(low[j], values.min()), np.fmax(high[j], values.max())
    return Hints(low, high)


def summary(
    model: Model, case: cases.Case, search: Search, found: Found, params: GapParams
) -> dict[str, Any]:
    """Contents of ``gap.json``."""
    base, best = found.base, found.best
    if search.adequate(base):
        verdict, names = "no gap", []
    elif best.parts and search.adequate(best):
        verdict, names = "named", sorted({t.effect for t in best.terms})
    else:
        verdict, names = "unknown", []
    terms = [term(h, x, verdict) for h, x in best.parts] if names else []
    closed = evidence.closed(base.held.rms, best.held.rms)
    after = best if names else base
    return {
        "format": FORMAT,
        "verdict": verdict,
        "names": names,
        "terms": terms,
        "rivals": [rival(m, base) for m in found.models[1:6]],
        "ambiguous": [],
        "gap": {
            "before": base.held.rms,
            "after": after.held.rms,
            "floor": 1.0,
            "closed": closed if names else 0.0,
            "records": [
                {
                    "name": record.name,
                    "role": "fit" if case.fit_rows[i].all() else "held-out",
                    "before": evidence.rms([base.whole[i]]),
                    "after": evidence.rms([after.whole[i]]),
                }
                for i, record in enumerate(case.records)
            ],
            "channels": [],
        },
        "where": [],
        "regions": [],
        "alarms": [],
        "identifiability": {},
        "next": [],
        "correction": None,
        "align": [note for record in case.records for note in record.notes],
        "nuisance": {},
        "settings": {key: value for key, value in to_dict(params).items()},
        "model": {
            "robot": model.robot,
            "overrides": {**model.overrides, **after.overrides},
            "effects": [*model.effects, *(after.specs if names else [])],
        },
    }


def term(hypothesis: Any, x: Sequence[float], verdict: str) -> dict[str, Any]:
    """Entry of ``terms``."""
    made = hypothesis.term(x)
    parameters = {}
    for c, at in zip(hypothesis.coordinates, x, strict=True):
        value = c.value(at)
        parameters[c.label] = {"value": value, "low": value, "high": value, "unit": c.unit}
    return {
        "effect": made.effect,
        "place": made.place,
        "verdict": verdict,
        "parameters": parameters,
        "gain": {"mean": 0.0, "low": 0.0, "high": 0.0},
        "odds": 1.0,
        "closed": 0.0,
        "look_alikes": [],
        "evidence": "",
    }


def rival(model: Fitted, base: Fitted) -> Mapping[str, Any]:
    """Entry of ``rivals``."""
    return {
        "names": list(model.names),
        "places": [t.place for t in model.terms],
        "odds": 1.0,
        "gain": 0.0,
        "closed": evidence.closed(base.held.rms, model.held.rms),
    }
