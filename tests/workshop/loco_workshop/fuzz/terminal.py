# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco fuzz`: counts of each target."""

from __future__ import annotations

import argparse
import json

from loco_bringup.terminal import console
from loco_control.exceptions import ParameterError
from loco_control.files import write_whole

from ..reliability.figures import keep
from .fuzz import KINDS, fuzz
from .targets import TARGETS


def show_fuzz(a: argparse.Namespace) -> int:
    """Run `loco fuzz`; returns 1 if there is a finding, else 0.

    Raises:
        ParameterError: The time is not above 0, or the number of inputs is below 0.
        NameUnknownError: There is no such target or kind of damage.
    """
    if not a.minutes > 0.0:
        raise ParameterError(f"--minutes must be above 0, got {a.minutes}")
    names = list(TARGETS) if a.target == "all" else [a.target]
    if a.inputs < 0:
        raise ParameterError(f"--inputs must be 0 or above, got {a.inputs}")
    rows = fuzz(names, 60.0 * a.minutes, a.out, a.seed, a.inputs, a.damage, max(1, a.workers))
    write_whole(a.out / "fuzz.json", json.dumps(rows, indent=1) + "\n")
    kept = {}
    for name, row in rows.items():
        found = sum(row[kind] for kind in KINDS)
        kept[name] = not found, {"damage": a.damage, "inputs": row["inputs"], "finds": found}
        console.print(f"  {name:12} {json.dumps(row)[1:-1]}", markup=False)
    keep(a.out, "fuzz", kept)
    finds = sum(figures["finds"] for _, figures in kept.values())
    total = sum(row["inputs"] for row in rows.values())
    console.print(f"  {total} inputs, {finds} finds: {a.out}", markup=False)
    return int(finds > 0)
