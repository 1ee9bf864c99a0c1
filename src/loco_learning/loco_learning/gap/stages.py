# SPDX-License-Identifier: Apache-2.0
"""Two stages for recordings in the air and on the ground: effects found in the air are kept.

In the air no contact masks effects of joints, links and sensors, and a simulation follows a
recording to its end. The gap on the ground is then explained in addition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from loco_sim.plant.model import Model

from .recordings.record import Record
from .verdict.decide import AMBIGUOUS, NAMED, NO_GAP, PARTLY, UNKNOWN

AIR, GROUND = "in the air", "on the ground"
STAGE_KEYS = ("verdict", "names", "probability", "evidence", "gap")
LISTS = ("alarms", "align", "reading", "notes", "not_tried", "rivals", "ambiguous", "kinds",
         "terms", "over_settings")  # fmt: skip


def free(model: Model, record: Record) -> bool:
    """True if the base of the robot was free in a recording."""
    return not model.make_robot(record.overrides).fixed_base


def split(model: Model, records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Records in the air (fixed base), and those on the ground."""
    flags = [free(model, record) for record in records]
    return tuple(
        [r for r, f in zip(records, flags, strict=True) if f is on] for on in (False, True)
    )


def after(model: Model, air: Mapping[str, Any]) -> Model:
    """The model with the effects found in the air; unchanged if none is established.

    Args:
        model: Model before the search.
        air: Contents of ``gap.json`` of the records in the air.
    """
    if air["verdict"] not in (NAMED, PARTLY, AMBIGUOUS):
        return model
    fitted = air["model"]
    return Model(fitted["robot"], dict(fitted["overrides"]), [dict(e) for e in fitted["effects"]])


def merge(air: Mapping[str, Any], ground: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of ``gap.json`` of both stages; all numbers of the gap are those on the ground.

    Each stage has probabilities of its own.

    Args:
        air: Contents for the records in the air.
        ground: Contents for those on the ground, from the model with the effects of the air.
    """
    lists = {key: _without_twins([*air[key], *ground[key]]) for key in LISTS}
    return {
        **ground,
        **lists,
        "verdict": _both(air["verdict"], ground["verdict"]),
        "names": sorted({*air["names"], *ground["names"]}),
        "probability": {},
        "adequate": all(one.get("adequate", True) for one in (air, ground)),
        "evidence": f"In the air: {air['evidence']} On the ground: {ground['evidence']}",
        "stages": [
            {"where": where, **{key: one[key] for key in STAGE_KEYS}}
            for where, one in ((AIR, air), (GROUND, ground))
        ],
    }


def _both(air: str, ground: str) -> str:
    """Combined verdict: the less certain of the two; a stage without gap does not count."""
    verdicts = {air, ground} - {NO_GAP}
    return next((v for v in (UNKNOWN, AMBIGUOUS, PARTLY, NAMED) if v in verdicts), NO_GAP)


def _without_twins(rows: Sequence[Any]) -> list[Any]:
    return [row for i, row in enumerate(rows) if row not in rows[:i]]
