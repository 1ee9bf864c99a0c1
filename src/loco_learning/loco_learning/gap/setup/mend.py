# SPDX-License-Identifier: Apache-2.0
"""Mappings and models with the lines that mend a set-up; the old ones stay as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from loco_sim.plant.model import Model

from ..recordings.record import Doubt, Record
from .bench import model_with
from .finding import JOINT, MAPPING, MODEL, Change, Finding, mended


def changes_of(findings: Sequence[Finding]) -> list[Change]:
    """Lines that mend what was found, in order."""
    return [change for finding in findings for change in finding.mends]


def mapping_with(values: Mapping[str, Any], changes: Sequence[Change]) -> dict[str, Any]:
    """Contents of a ``mapping.yaml`` with its key ``mend`` grown by changes of signals.

    Args:
        values: Contents as they are; empty for a bag that needed no mapping.
        changes: Changes; those of a model are left out.
    """
    mine = [change for change in changes if change.file == MAPPING]
    lines = [
        {"role": c.role, "joint": c.joint, "is" if c.key == JOINT else c.key: c.value} for c in mine
    ]
    return {**values, "mend": [*(values.get("mend") or []), *lines]} if lines else dict(values)


def model_mended(model: Model, changes: Sequence[Change]) -> Model | None:
    """The model with changes of it; None if there are none."""
    return model_with(model, changes) if any(c.file == MODEL for c in changes) else None


def noted(records: Sequence[Record], findings: Sequence[Finding]) -> list[Record]:
    """Records as they are read with mistakes that stop nothing mended, and told as doubts."""
    changes = changes_of(findings)
    doubts = tuple(Doubt(str(finding)) for finding in findings)
    return [replace(mended(r, changes), notes=(*r.notes, *doubts)) if doubts else r
            for r in records]  # fmt: skip
