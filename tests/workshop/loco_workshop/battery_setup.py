# SPDX-License-Identifier: Apache-2.0
"""Mistakes of a set-up that are found in the cases of a battery, where there are none.

loco gap battery --cases 240 --seed 4711 --bags-only --out DIR
PYTHONPATH=tests/workshop .venv/bin/python -m loco_workshop.battery_setup DIR
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

from loco_learning.gap.setup import family
from loco_workshop.battery import trial


def false_findings(battery: Path) -> Iterator[tuple[str, list[str]]]:
    """Name of each case whose bags are there, and what is said about its set-up, a sentence each.

    Args:
        battery: Folder of `loco gap battery --bags-only`.
    """
    for truth in sorted((battery / "truth").glob("*.json")):
        robot = json.loads(truth.read_text())["robot"]
        model, fit, held = trial.read(battery / "bags" / truth.stem, robot)
        yield truth.stem, [str(finding) for finding in family.find_mistakes(model, [*fit, *held])]


def lines(battery: Path) -> Iterator[str]:
    """Line for each finding, then the number of cases with one and that of all cases."""
    cases = false = 0
    for name, findings in false_findings(battery):
        cases, false = cases + 1, false + bool(findings)
        yield from (f"{name}: {finding}" for finding in findings)
    yield f"{false} of {cases} cases have a finding"


if __name__ == "__main__":
    for line in lines(Path(sys.argv[1])):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
