# SPDX-License-Identifier: Apache-2.0
"""Contents of ``gap.json`` if the set-up is wrong, so that no effect was sought."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from loco_control.params import Params, to_dict
from loco_sim.plant.model import Model

from ...plain import plain
from ..recordings.record import HELD_OUT, Doubt, Record
from .finding import Finding

SETUP = "set-up"  # the verdict
FORMAT = 1
EVIDENCE = (
    "The set-up is checked before any effect is tested, because such mistakes look like effects. "
    "Correct it and search again. If it is right as it is, search with --set setup=false."
)


def contents(
    model: Model, records: Sequence[Record], findings: Sequence[Finding], params: Params
) -> dict[str, Any]:
    """Contents of ``gap.json`` for a set-up that must be corrected first.

    Args:
        model: Robot, overrides and effects, copied to the result.
        records: Recordings to fit and held-out ones.
        findings: Mistakes of the set-up.
        params: Settings.
    """
    empty: dict[str, Any] = {
        key: []
        for key in ("names", "terms", "rivals", "over_settings", "ambiguous", "kinds", "notes",
                    "not_tried", "where", "regions", "next")
    }  # fmt: skip
    return plain(
        {
            **empty,
            "probability": {},
            "format": FORMAT,
            "verdict": SETUP,
            "evidence": EVIDENCE,
            "setup": [finding.plain() for finding in findings],
            "gap": {"before": None, "after": None, "floor": 1.0, "closed": None,
                    "channels": [], "records": [
                        {"name": r.name, "role": "held-out" if r.role == HELD_OUT else "fit",
                         "before": None, "after": None} for r in records]},
            "alarms": [f"{r.name}: {warning}" for r in records for warning in r.warnings],
            "align": [f"{r.name}: {note}" for r in records for note in r.notes],
            "reading": [f"{r.name}: {n}" for r in records for n in r.notes if isinstance(n, Doubt)],
            "settings": to_dict(params),
            "pieces": 0.0, "compared": "", "nuisance": {}, "identifiability": {},
            "correction": None, "residual": None,
            "model": {"robot": model.robot, "overrides": dict(model.overrides),
                      "effects": list(model.effects)},
        }
    )  # fmt: skip
