# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco reliability`: collect figures, measure missing ones, write the page."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from loco_bringup.cli.clone import root
from loco_bringup.terminal import console
from loco_control.exceptions import NameUnknownError

from .figures import NAME, Figure, newest, read, write
from .page import FILE, PAGE, page
from .subjects import SUBJECTS, complete, missing


def show_reliability(a: argparse.Namespace) -> int:
    """Collect all figures and write file and page; returns 1 if one is not as required, else 0.

    Raises:
        NameUnknownError: There is no such subject.
        ParameterError: A file of figures is broken.
    """
    for name in a.run or ():
        if name not in SUBJECTS:
            raise NameUnknownError("subject", name, SUBJECTS)
    figures = collect()
    if a.run is not None:
        for name in a.run or missing(figures):
            words = SUBJECTS[name].command.split()
            console.print(f"  {name}: ./loco {' '.join(words)}", markup=False)
            subprocess.run([sys.executable, "-m", "loco_bringup.cli.main", *words], check=False)
        figures = collect()
    write(root() / "docs" / FILE, figures)
    (root() / "docs" / PAGE).write_text(page(figures))
    measured = [each for each in figures if each.date]
    wrong = [each for each in measured if not each.holds]
    for each in wrong:
        console.print(f"  not as required: {each.subject}: {each.part}", markup=False)
    for name in missing(figures):
        console.print(f"  not measured: {name}: ./loco {SUBJECTS[name].command}", markup=False)
    console.print(
        f"  {len(measured)} of {len(figures)} measured, {len(wrong)} not as required: docs/{PAGE}",
        markup=False,
    )
    return int(bool(wrong))


def collect() -> list[Figure]:
    """Newest figures of the page and of all commands, which have folders in ``results``."""
    kept = root() / "docs" / FILE
    paths = [*([kept] if kept.exists() else []), *sorted(Path("results").glob(f"*/{NAME}"))]
    return complete(newest(figure for path in paths for figure in read(path)))
