# SPDX-License-Identifier: Apache-2.0
"""Table of docs/robots_tried.md: results of `loco robot new` and its experiment, file by file.

.venv/bin/python tests/workshop/loco_workshop/foreign_robots.py FILE ...
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from loco_bringup.robot.terminal import tried
from loco_control.exceptions import LocoError
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout


def outcome(file: Path) -> tuple[str, str]:
    """Result of `loco robot new` for a file, and of the experiment that it writes.

    Args:
        file: URDF, xacro or MJCF.

    Returns:
        `stands`, `swings`, `falls` or `refused`; notes about the file, or the error.
    """
    with tempfile.TemporaryDirectory() as place:
        try:
            result = tried(file, Path(place) / "robot")
            log = rollout(load(str(result.folder / "experiment.yaml")))
        except LocoError as error:
            return "refused", str(error).removeprefix(f"{file}: ")
    word = "falls" if log.fall else "stands" if result.stands else "swings"
    return word, "; ".join(note.partition(":")[0] for note in result.notes)


def rows(files: list[Path]) -> Iterator[str]:
    """Row of Markdown for each file, then the number of robots that stand or swing."""
    good = 0
    for file in files:
        word, text = outcome(file)
        good += word in ("stands", "swings")
        yield f"| `{file}` | {word} | {text} |"
    yield f"{good} of {len(files)} stand or swing"


if __name__ == "__main__":
    for row in rows([Path(name) for name in sys.argv[1:]]):
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()
