# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco export-model`: files, what is not exported, errors of the replay."""

from __future__ import annotations

import argparse
import sys

from ..terminal import console, table
from .write import export_model


def show_export(a: argparse.Namespace) -> int:
    """Write the files and print the result; returns the exit code."""
    done = export_model(a.model, a.to, a.out, a.replay, a.mapping, a.gear)
    for text in done.lost:
        sys.stdout.write(f"not in it: {text}\n")
    if done.compared:
        rows = [
            (one.name, f"{one.ours:.4g}", f"{one.theirs:.4g}", f"{one.theirs / one.ours:.3f}")
            for one in done.compared
        ]
        columns = ("recording", "rms here [rad or m]", "rms in MuJoCo alone", "ratio")
        console.print(table("Replay", columns, rows))
    for note in done.notes:
        sys.stdout.write(f"note: {note}\n")
    sys.stdout.write(f"{done.folder}: {', '.join(done.files)}\n")
    return 0
