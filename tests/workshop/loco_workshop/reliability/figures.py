# SPDX-License-Identifier: Apache-2.0
"""Figures of reliability: what a command measured, with command, date, commit and machine.

Each command that measures keeps its newest figures of each part in a file of its results
folder. `loco reliability` collects these files.
"""

from __future__ import annotations

import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from loco_bringup.cli.clone import root
from loco_control.checks import check
from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_control.reading import read_json

NAME = "figures.json"


@dataclass(frozen=True)
class Figure:
    """Figures of one part of a subject.

    Attributes:
        subject: Name of the subject, a key of `subjects.SUBJECTS`.
        part: Name of what was measured, such as a target, a module or a command.
        values: Figures by name.
        holds: Whether they are as required.
        command: Command line that measured them; empty if not measured.
        date: End of the measurement, ISO 8601 in UTC; empty if not measured.
        commit: Commit of the code; ``+`` if files had been changed.
        machine: Processor, number of cores, version of Python.
    """

    subject: str
    part: str
    values: dict[str, Any] = field(default_factory=dict)
    holds: bool = False
    command: str = ""
    date: str = ""
    commit: str = ""
    machine: str = ""


def keep(folder: Path, subject: str, by_part: Mapping[str, tuple[bool, Mapping[str, Any]]]) -> None:
    """Keep the figures of a command that has just measured.

    Args:
        folder: Results folder of the command; figures of its other parts remain.
        subject: Name of the subject.
        by_part: Whether the figures are as required, and the figures, by part.
    """
    words = iter(sys.argv[1:])
    words = [word for word in words if word != "--out" or not next(words)]
    about = {
        "command": f"./loco {shlex.join(words)}",
        "date": datetime.now(UTC).isoformat(timespec="minutes").removesuffix("+00:00"),
        "commit": _commit(),
        "machine": f"{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}",
    }
    figures = [
        Figure(subject, part, dict(values), holds, **about)
        for part, (holds, values) in by_part.items()
    ]
    path = folder / NAME
    write(path, newest([*(read(path) if path.exists() else ()), *figures]))


def read(path: Path) -> list[Figure]:
    """Figures of a file.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file does not hold figures.
    """
    rows = read_json(path, "figures")
    try:
        check(rows, list[dict[str, Any]], "")
        return [Figure(**row) for row in rows]
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{path}: {error}; remove it and measure again") from None


def write(path: Path, figures: Iterable[Figure]) -> None:
    """Write figures, one line each."""
    lines = ",\n".join(json.dumps(asdict(each)) for each in figures)
    write_whole(path, f"[\n{lines}\n]\n")


def newest(figures: Iterable[Figure]) -> list[Figure]:
    """The newest figures of each subject and part; of the same minute, the later in the order."""
    found: dict[tuple[str, str], Figure] = {}
    for each in figures:
        key = each.subject, each.part
        if key not in found or each.date >= found[key].date:
            found[key] = each
    return list(found.values())


def _commit() -> str:
    commit, changes = (
        subprocess.run(
            ["git", "-C", str(root()), *words], capture_output=True, text=True, check=False
        ).stdout.strip()
        for words in (("rev-parse", "--short=8", "HEAD"), ("status", "--porcelain", "-uno"))
    )
    return f"{commit or 'no repository'}{'+' * bool(changes)}"


def _processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
