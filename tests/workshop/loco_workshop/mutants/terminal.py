# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco mutants`."""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_bringup.cli.clone import root
from loco_bringup.terminal import console
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.files import check_writable
from loco_learning.jobs.journal import Journal

from ..reliability.figures import keep
from .run import BY_HAND, PROTECTING, Verdict, count, counts, score, survey, write


def show_mutants(a: argparse.Namespace) -> int:
    """Test mutants of the protecting modules; returns 1 if fewer than 90 % are detected, else 0.

    Raises:
        NameUnknownError: No protecting module has this name.
        ParameterError: A number is out of range.
    """
    if a.limit < 0 or a.workers < 1:
        raise ParameterError(
            f"--limit must be at least 0 and --workers at least 1, got {a.limit} and {a.workers}"
        )
    selected = [m for m in (BY_HAND if a.by_hand else PROTECTING) if a.only in m]
    if not selected:
        raise NameUnknownError("protecting module", a.only, list(PROTECTING))
    check_writable(a.out)
    journal = Journal(a.out / "mutants.jsonl", {"kind": "mutants", "format": 1}, new=True)
    try:
        verdicts = survey(root(), selected, a.limit, a.seed, a.workers, journal, _tell,
                          a.survivors, a.by_hand)  # fmt: skip
    finally:
        journal.close()
    write(verdicts, a.out)
    found = {a.only: count(verdicts)} if a.limit else counts(verdicts)
    subject = "mutants by hand" if a.by_hand else "mutants drawn" if a.limit else "mutants"
    keep(a.out, subject, {name: (row["noticed %"] >= 90, row) for name, row in found.items()})
    share = score(verdicts)
    console.print(f"  {len(verdicts)} mutants, {100 * share:.0f} % noticed: {a.out}", markup=False)
    return int(share < 0.9)


def _tell(verdict: Verdict) -> None:
    where = f"{Path(verdict.module).name}:{verdict.line}"
    console.print(f"  {verdict.end:10} {where:20} {verdict.change}", markup=False)
