# SPDX-License-Identifier: Apache-2.0
"""Table of a fleet (``recordings.csv``): the robot and the day of each recording."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.reading import parse_csv, read_text, shown

FILE = "recordings.csv"
COLUMNS = ("file", "robot", "day")


class Recording(NamedTuple):
    """A row of the table.

    Attributes:
        file: Path, relative to the folder of the fleet.
        robot: Name of the robot.
        day: Name of the day or session.
    """

    file: str
    robot: str
    day: str


def in_order(text: str) -> tuple[tuple[int, int, str], ...]:
    """Key by which days are sorted: numbers in a name count by their value (day 2 < day 10)."""
    parts = re.findall(r"\d+|\D+", text)
    return tuple((0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts)


def by_place(row: Recording) -> tuple:
    """Key by which recordings are sorted: robot, day, file."""
    return in_order(row.robot), in_order(row.day), in_order(row.file)


def scan(folder: Path, is_recording: Callable[[Path], bool]) -> list[Recording]:
    """Recordings of a folder with the layout ROBOT/DAY/RECORDING.

    Args:
        folder: Folder of the fleet.
        is_recording: Whether a file, or a folder with the files of a bag, is a recording.

    Raises:
        MissingFileError: There is no recording at that depth.
    """
    rows = [
        Recording(str(path.relative_to(folder)), path.parts[-3], path.parts[-2])
        for path in sorted(folder.glob("*/*/*"))
        if is_recording(path)
    ]
    if not rows:
        raise MissingFileError(
            f"{folder} has neither a {FILE} with the columns {', '.join(COLUMNS)}, nor recordings "
            "as ROBOT/DAY/FILE"
        )
    return rows


def by_day(rows: Iterable[Recording]) -> dict[tuple[str, str], list[Recording]]:
    """Recordings by robot and day, in their order."""
    groups: dict[tuple[str, str], list[Recording]] = {}
    for row in rows:
        groups.setdefault((row.robot, row.day), []).append(row)
    return groups


def dumps(columns: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Text of a CSV file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    return text.getvalue()


def load(path: Path, folder: Path) -> list[Recording]:
    """Rows of a table, sorted by robot, day and file.

    Args:
        path: The table.
        folder: Folder that its files are relative to.

    Raises:
        ParameterError: A column, cell or file is missing, or a file is listed twice.
    """
    head, *lines = parse_csv(read_text(path, "table").splitlines(), path) or [[]]
    if missing := [name for name in COLUMNS if name not in head]:
        raise ParameterError(
            f"{path} has no column {' and '.join(missing)}; it needs {', '.join(COLUMNS)}"
        )
    indices, rows = [head.index(name) for name in COLUMNS], list[Recording]()
    for number, cells in enumerate(lines, start=2):
        row = Recording(*(cells[i].strip() if i < len(cells) else "" for i in indices))
        for name, cell in zip(COLUMNS, row, strict=True):
            if not cell:
                raise ParameterError(f"{path}, row {number}, names no {name}; fill it or remove it")
        if not (folder / row.file).exists():
            raise ParameterError(
                f"{path}, row {number}: there is no recording {shown(row.file)} in {folder}"
            )
        rows.append(row)
    if not rows:
        raise ParameterError(f"{path} lists no recording")
    file, count = Counter(row.file for row in rows).most_common(1)[0]
    if count > 1:
        raise ParameterError(f"{path} lists {shown(file)} twice; remove one of the rows")
    return sorted(rows, key=by_place)


def stamp(path: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, size and time of change of the files of a recording, to notice that it changed."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    stats = [(file.name, file.stat()) for file in files]
    return tuple((name, about.st_size, about.st_mtime_ns) for name, about in stats)
