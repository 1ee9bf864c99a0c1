# SPDX-License-Identifier: Apache-2.0
"""Texts that ``ros2 topic echo`` and ``rostopic echo`` print, as rows of named values."""

from __future__ import annotations

import re
from collections.abc import Sequence

END = re.compile(r"^---[ \t]*\r?$", re.MULTILINE)  # line between two messages
_FIRST = re.compile(r"(?:.*\n){0,5}?[A-Za-z]\w*:(?:[ \t].*)?\r?\n")  # below a few warnings
_FIELD = re.compile(r"([A-Za-z]\w*):(?:\s+(.*))?")
STAMP = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
ARRAYS = ("position", "velocity", "effort")  # of a JointState, in their order


def is_echo(text: str) -> bool:
    """True if a text consists of messages with ``---`` between them, a field in each line."""
    return bool(_FIRST.match(text) and END.search(text))


def messages(text: str) -> list[dict[str, str]]:
    """Values of each message under dotted names and indices: ``position[2]``."""
    rows = [_fields(part) for part in END.split(text)]
    return [row for row in rows if row]


def _fields(text: str) -> dict[str, str]:
    """Values of one message; lines that are neither a field nor an item are warnings."""
    values: dict[str, str] = {}
    sizes: dict[str, int] = {}  # items of each list
    parents: list[tuple[float, str]] = []  # indentation and path of the fields around a line
    for line in text.splitlines():
        rest = line.strip()
        column: float = len(line) - len(line.lstrip())
        while rest == "-" or rest.startswith("- "):  # an item, which may be as far left as its key
            parents = [p for p in parents if p[0] <= column]
            path = parents[-1][1] if parents else ""
            sizes[path] = sizes.get(path, -1) + 1
            path = f"{path}[{sizes[path]}]"
            parents.append((column + 0.5, path))
            rest, column = rest[1:].strip(), column + 2
            if rest and not _FIELD.fullmatch(rest):
                values[path] = _scalar(rest)
        field = _FIELD.fullmatch(rest)
        if not field:
            continue
        parents = [p for p in parents if p[0] < column]
        path = f"{parents[-1][1]}.{field[1]}" if parents else field[1]
        parents.append((column, path))
        value = (field[2] or "").strip()
        if value.startswith(("[", "(")):
            items = filter(None, map(str.strip, value.strip("[]()").split(",")))
            values |= {f"{path}[{i}]": _scalar(item) for i, item in enumerate(items)}
        elif value:
            values[path] = _scalar(value)
    return values


def _scalar(text: str) -> str:
    """Text without quotation marks; numbers that are none as other tables write them."""
    text = text.strip("'\"")
    return {".nan": "nan", ".inf": "inf", "-.inf": "-inf"}.get(text.lower(), text)


def names_of_joint_states(row: Sequence[str]) -> list[str]:
    """Names of the cells of ``ros2 topic echo --csv`` on a JointState, which writes none.

    They are seconds and nanoseconds, a frame, the names of n joints, and n positions, or n
    positions, velocities and efforts. Empty if a row is no such.
    """
    cells = [cell.strip() for cell in row]
    is_number = [bool(re.fullmatch(r"[-+]?[\d.]+(?:e[-+]?\d+)?|-?(?:nan|inf)", x)) for x in cells]
    last = len(cells) - is_number[::-1].index(False) if False in is_number else 0
    n = last - len(STAMP)
    width = len(cells) - last
    is_one = (
        n > 0 and width in (n, 3 * n) and all(map(str.isdigit, cells[:2])) and len(cells[1]) < 10
        and not any(is_number[2:last]) and len({*cells[3:last], ""}) == n + 1
    )  # fmt: skip
    if not is_one:
        return []
    names = [f"name[{i}]" for i in range(n)]
    return [*STAMP, *names, *(f"{x}[{i}]" for x in ARRAYS[: width // n] for i in range(n))]
