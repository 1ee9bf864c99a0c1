# SPDX-License-Identifier: Apache-2.0
"""The head of each exported file: what it is, and what it cannot say."""

from __future__ import annotations

from collections.abc import Sequence

NOTHING = "nothing of the model is missing here"


def lines(robot: str, lost: Sequence[str]) -> list[str]:
    """Sentences on top of a file."""
    missing = ["not in this file:", *(f"  - {text}" for text in lost)] if lost else [NOTHING]
    return [f"Model of robot {robot}, written by `loco export-model`; SI units.", *missing]


def xml(text: str, robot: str, lost: Sequence[str]) -> str:
    """XML under its head; a comment may hold no two hyphens in a row."""
    head = "\n".join(lines(robot, lost)).replace("--", "- -")
    return f"<!--\n{head}\n-->\n{text}\n"


def python(text: str, robot: str, lost: Sequence[str]) -> str:
    """Python code under its head."""
    return "".join(f"# {line}\n" for line in lines(robot, lost)) + text
