# SPDX-License-Identifier: Apache-2.0
"""Header of exported files: origin, and properties of the model that the format lacks."""

from __future__ import annotations

from collections.abc import Sequence

COMPLETE = "nothing of the model is missing here"


def lines(robot: str, lost: Sequence[str]) -> list[str]:
    """Sentences of the header."""
    missing = ["not in this file:", *(f"  - {text}" for text in lost)] if lost else [COMPLETE]
    return [f"Model of robot {robot}, written by `loco export-model`; SI units.", *missing]


def xml(text: str, robot: str, lost: Sequence[str]) -> str:
    """XML with the header as a comment, without double hyphens."""
    head = "\n".join(lines(robot, lost)).replace("--", "- -")
    return f"<!--\n{head}\n-->\n{text}\n"


def python(text: str, robot: str, lost: Sequence[str]) -> str:
    """Python code with the header as a comment."""
    return "".join(f"# {line}\n" for line in lines(robot, lost)) + text
