# SPDX-License-Identifier: Apache-2.0
"""Corrected copies of mappings, models and records, with the lines that findings give."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from loco_sim.plant.model import Model

from ..recordings.record import Doubt, Record
from .bench import model_with
from .finding import JOINT, MAPPING, MODEL, SCALE, SIGN, Change, Finding, composed, correct


def changes_of(findings: Sequence[Finding]) -> list[Change]:
    """Lines that correct the findings together, see `composed`."""
    return composed([change for finding in findings for change in finding.mends])


def merge(findings: Sequence[Finding], new: Finding) -> list[Finding]:
    """Findings with a later one; it and an earlier one that it revokes in part become one.

    The earlier one was told by two signals that contradict each other, the later one says which is
    wrong.
    """
    keys = {(c.file, c.key, c.role, c.joint) for c in new.mends if c.key in (SIGN, SCALE)}
    old = [f for f in findings if f.stops is new.stops
           and keys & {(c.file, c.key, c.role, c.joint) for c in f.mends}]  # fmt: skip
    if not old:
        return [*findings, new]
    before = [change for finding in old for change in finding.mends]
    text = "; ".join([new.says, *(finding.says for finding in old)])
    options = dict.fromkeys(tuple(composed([*before, *fix])) for fix in (new.mends, *new.others))
    mends, *rest = options
    one = replace(new, says=text, mends=mends, others=tuple(rest))
    return [*(f for f in findings if f not in old), one]


def mapping_with(values: Mapping[str, Any], changes: Sequence[Change]) -> dict[str, Any]:
    """Contents of a ``mapping.yaml`` with changes of signals appended to its key ``mend``.

    Args:
        values: Contents of the file; empty for a bag without mapping.
        changes: Changes; those of a model are ignored.
    """
    used = [change for change in changes if change.file == MAPPING]
    lines = [
        {"role": c.role, "joint": c.joint, "is" if c.key == JOINT else c.key: c.value} for c in used
    ]
    return {**values, "mend": [*(values.get("mend") or []), *lines]} if lines else dict(values)


def model_mended(model: Model, changes: Sequence[Change]) -> Model | None:
    """The model with the changes that concern it; None if there are none."""
    return model_with(model, changes) if any(c.file == MODEL for c in changes) else None


def noted(records: Sequence[Record], findings: Sequence[Finding]) -> list[Record]:
    """Records with minor mistakes corrected, and a note on each of them.

    A scale of a measured torque that was told from the recordings stays uncertain.
    """
    changes = changes_of(findings)
    warnings = tuple(Doubt(str(finding)) for finding in findings)
    scaled = [c.joint for c in changes if (c.role, c.key) == ("tau", SCALE)]
    return [
        replace(
            correct(r, changes),
            notes=(*r.notes, *warnings),
            unscaled=tuple(dict.fromkeys([*r.unscaled, *scaled])),
        )
        for r in records
    ]
