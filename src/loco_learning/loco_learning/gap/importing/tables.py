# SPDX-License-Identifier: Apache-2.0
"""CSV files, JSON logs and binary tables, compressed or not, as named columns of numbers."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import as_text, parse_csv, parse_json, read_bytes, understood

from ..recordings import units
from ..recordings.record import Doubt
from . import echoed, foreign, joint_rows

BINARY = {
    ".pt": foreign.torch_columns, ".parquet": foreign.parquet_columns,
    ".npz": foreign.numpy_columns, ".mat": foreign.matlab_columns,
}  # fmt: skip
SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".json", ".jsonl", *BINARY)
CONTROL = {*range(9)}  # bytes that no text has
EMPTY = ("", "none", "null", "nan", "na")
PREAMBLE = 50  # lines in which the first row of numbers is looked for (taste)
RUN = 4  # rows of numbers one below the other that are samples, and no lines of a header (taste)
SEPARATORS = (";", "\t", ",", "|", " ")
HALF_DAY = 43200.0  # [s]; a time of day that falls by more has passed midnight
# After a date whose order of day and month is not known, which the time between rows does not need.
_TIME_OF_DAY = re.compile(
    r"(?:\d{1,4}[./-]\d{1,2}[./-]\d{1,4},?[T ] *)?(\d+):(\d\d):(\d\d(?:[.,]\d+)?)"
)
_DURATION = re.compile(r"([-+\d.eE]+) ?(s|sec|ms|us|ns)")  # as MATLAB writes it
_DATE = re.compile(
    r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d+))? ?(?:Z|([+-]\d\d):?(\d\d))?", re.IGNORECASE
)
_MARK = re.compile(r"(%+|//+)(\s+|$)")  # of a comment that has the names
_KEYED = re.compile(r"([A-Za-z]\w*)\s*[:=]\s*([-+.\d]\S*)")  # a cell such as pos:0.5
# Columns of the seconds and nanoseconds of one time stamp.
_SECONDS = re.compile(r"(.*?)[._/ ]*(?:secs?|seconds)", re.IGNORECASE)
_NANOSECONDS = re.compile(r"(.*?)[._/ ]*n(?:ano)?(?:secs?|seconds)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one file.

    Attributes:
        path: File of the table.
        columns: Numbers by name, all of one length; NaN for an empty field and a text. Dates and
            times of day are in seconds.
        header: Other fields of a JSON log.
        texts: Reason why a column holds no numbers, by name; an error if it is used.
        labels: Different texts of each column of texts, in their order; by name.
        cell_texts: Texts among the numbers of a column, each (T,), empty for a number; by name.
        clocks: Columns that are times by their content: dates, times of day, stamps of two columns.
        notes: Sentences on rows that are no samples.
    """

    path: Path
    columns: dict[str, np.ndarray]
    header: dict[str, Any] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    labels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    cell_texts: dict[str, np.ndarray] = field(default_factory=dict)
    clocks: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def column(self, name: str, missing: Sequence[str] = ()) -> np.ndarray:
        """A column by name.

        Args:
            name: Name of the column.
            missing: Texts that mean no reading.

        Raises:
            NameUnknownError: The file has no such column.
            ParameterError: The column does not hold numbers, or has another text among them.
        """
        for text in (name, name.split("[")[0]):
            if text in self.texts:
                raise ParameterError(self.texts[text])
        if name not in self.columns:
            raise NameUnknownError(f"column in {self.path.name}", name, self.columns)
        for text, rows in self.text_rows(name).items():
            if text not in missing:
                raise ParameterError(
                    f"{self.path.name}: column {name!r} has the text {text!r} in {len(rows)} of "
                    f"{len(self)} rows, the first in row {rows[0]}; if it means that there is no "
                    f'reading, say missing: "{text}" at the column'
                )
        return self.columns[name]

    def text_rows(self, name: str) -> dict[str, list[int]]:
        """Rows of each text among the numbers of a column."""
        text_cells: dict[str, list[int]] = {}
        for row, text in enumerate(self.cell_texts.get(name, ())):
            if text:
                text_cells.setdefault(text, []).append(row)
        return text_cells


def episodes(table: Table) -> list[Table]:
    """The table divided into its episodes, with their number in the header."""
    numbers = table.columns.get(foreign.EPISODE)
    if numbers is None:
        return [table]
    result = []
    for number in np.unique(numbers[np.isfinite(numbers)]):
        rows = numbers == number
        columns, cells = ({name: values[rows] for name, values in by_name.items()}
                          for by_name in (table.columns, table.cell_texts))  # fmt: skip
        header = {**table.header, foreign.EPISODE: int(number)}
        result.append(replace(table, columns=columns, header=header, cell_texts=cells))
    return result


def is_table(path: Path) -> bool:
    """True if the extension of the file is that of a table."""
    return _kind(path) in SUFFIXES


@understood("table of samples")
def read(path: str | Path, samples: str = "") -> Table:
    """Read a file, by the extension of its name with or without ``.gz``.

    Args:
        path: Text of rows separated by comma, semicolon, tab, bar or spaces, JSON, JSON lines,
            ``.pt``, ``.parquet``, ``.npz`` or ``.mat``. Columns without a line of names have their
            numbers from 1.
        samples: Field of a JSON log that is its list of samples; empty: the only list.

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The content does not match the extension.
    """
    path = Path(path)
    kind = _kind(path)
    text, encoding = ("", ()) if kind in BINARY else _text(path)
    if kind in BINARY:
        table = Table(path, BINARY[kind](path))
    elif kind == ".json":
        table = _from_json(path, parse_json(text, path.name), samples)
    elif kind == ".jsonl":
        rows = [
            parse_json(line, f"{path.name}, line {number}")
            for number, line in enumerate(text.splitlines(), 1)
            if line.strip()
        ]
        table = _from_json(path, rows, samples)
    else:
        table = _from_csv(path, text)
    if not table.columns or not len(table):
        raise ParameterError(next(iter(table.texts.values()), f"{path.name} has no samples"))
    return replace(table, notes=(*encoding, *table.notes))


def _text(path: Path) -> tuple[str, tuple[str, ...]]:
    """Text of a file, and a note if it is read as Latin-1, which older programs write for µ and °.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is too large, or no text.
    """
    data = read_bytes(path)
    try:
        return as_text(data, path), ()
    except ParameterError:
        if CONTROL & {*data}:
            raise
    return data.decode("latin-1"), (f"{path.name} is no UTF-8 text and was read as Latin-1",)


def _kind(path: Path) -> str:
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix


def _from_csv(path: Path, text: str) -> Table:
    """Columns under a line of names, without empty columns that have no name."""
    if echoed.is_echo(text):
        rows = echoed.messages(text)
        names = {name: None for row in rows for name in row}
        return _of_cells(path, {name: [row.get(name, "") for row in rows] for name in names})
    filled = [line for line in text.splitlines() if line.strip()]
    lines = [line for line in filled if not line.startswith("#")]
    if not lines:
        raise ParameterError(f"{path.name} is empty")
    names, rows, above = _named(path, filled, lines)
    rows, notes = _samples(_padded(path, rows, names), names)
    notes = (*above, *notes)
    cells: dict[str, Sequence[Any]] = {}
    texts: dict[str, str] = {}
    for name, values in zip(names, zip(*rows, strict=True), strict=False):
        if cells.get(name, values) != values:
            texts[name] = f"{path.name} has two columns named {name!r}, with different values"
        if name:
            cells[name] = values
    table = _of_cells(path, {name: cells[name] for name in cells if name not in texts}, notes=notes)
    return replace(table, texts=table.texts | texts)


def _named(
    path: Path, filled: Sequence[str], lines: Sequence[str]
) -> tuple[list[str], list[Sequence[str]], list[str]]:
    """Names of the columns, rows, and a sentence on lines above the names.

    Args:
        path: The file.
        filled: Lines that are not empty.
        lines: Lines that are neither empty nor comments.
    """
    top, separator, has_units, settings = _above(lines)
    body = [line for i, line in enumerate(lines[top:], top) if i not in settings]
    first, *rows = parse_csv(body, path.name, delimiter=separator, skipinitialspace=True)
    names = [_MARK.sub("", name.strip()) for name in first]
    names = names[1:] if first[0] and not names[0] else names
    if has_units:
        symbols = (cell.strip(" []()") for cell in rows.pop(0))
        names = [f"{name} [{symbol}]" if symbol.strip("-1") else name
                 for name, symbol in zip(names, symbols, strict=True)]  # fmt: skip
    elif all(map(_KEYED.fullmatch, names)):
        cells = [[_KEYED.fullmatch(cell.strip()) for cell in row] for row in (first, *rows)]
        names = [match[1] for match in cells[0] if match]
        rows = [[match[2] if match else "" for match in row] for row in cells]
    elif _is_mostly_numbers(names):
        rows, above = [first, *rows], filled[: filled.index(lines[top])]
        numbers = [str(i + 1) for i in range(len(first))]
        names = (
            _commented(above, separator, len(first))
            or echoed.names_of_joint_states(first)
            or numbers
        )
    notes = [f"{top} lines above the names are no samples, the first is {lines[0].strip()!r}"]
    notes = notes * bool(top) + [f"line {lines[i].strip()!r} is no sample" for i in settings]
    return names, rows, notes


def _above(lines: Sequence[str]) -> tuple[int, str, bool, list[int]]:
    """Find the line of names, and the separator of the cells.

    The names are in the last line without numbers above the first of several rows of numbers that
    is as long as these; of rows whose cells have their names, in the first. They are in the first
    line if there are no such rows.

    Returns:
        Index of the line of names, the separator, whether a line of units is below the names, and
        indices of the lines between names and rows that have a text in place of a number.
    """
    marks = [_row_separator(line) for line in lines[:PREAMBLE]]
    lengths = [len(list(itertools.takewhile(bool, marks[i:]))) for i in range(len(marks))]
    row = next(i for i, length in enumerate(lengths) if length >= min(RUN, max(lengths)))
    mark = marks[row] or _separator(lines[0])
    cells = [[cell.strip() for cell in line.split(mark)] for line in lines[: row + 1]]
    if all(map(_KEYED.fullmatch, filter(None, cells[row]))):
        return row, mark, False, []
    heads = [i for i in range(row) if len(cells[i]) > 1 and not any(map(_has_number, cells[i]))]
    if not heads:
        return (row if marks[row] else 0), mark, False, []
    size = [len(list(filter(None, line))) for line in cells]
    top = next((i for i in reversed(heads) if size[i] >= size[row]), heads[-1])
    has_units = (
        top > 0 and len(cells[top - 1]) == len(cells[top]) and all(map(_is_unit, cells[top]))
    )
    settings = [
        i for i in range(top + 1, row) if len(cells[i]) == len(cells[row]) and any(
            _has_number(b) and a and not _has_number(a)
            for a, b in zip(cells[i], cells[row], strict=True)
        )
    ]  # fmt: skip
    return top - has_units, mark, has_units, settings


def _has_number(cell: str) -> bool:
    """Whether a cell is a number or a time, and not empty."""
    text = cell.strip('"')
    return text.lower() not in EMPTY and (_number(text) is not None or _seconds(text) is not None)


def _row_separator(line: str) -> str:
    """Separator that divides a line into the largest share of numbers; "" if few cells are some."""
    shares: dict[str, tuple[float, int]] = {}
    for mark in SEPARATORS:
        cells = [cell for cell in map(str.strip, line.split(mark)) if cell]
        count = sum(_has_number(cell) or bool(_KEYED.fullmatch(cell)) for cell in cells)
        if len(cells) > 1 and 2 * count > len(cells):
            shares[mark] = count / len(cells), count
    return max(shares, key=lambda mark: shares[mark], default="")


def _is_mostly_numbers(cells: Sequence[str]) -> bool:
    """Whether more than half of the cells that are not empty are numbers or times."""
    filled = [cell.strip().strip('"') for cell in cells if cell.strip()]
    return 2 * sum(_number(x) is not None or _seconds(x) is not None for x in filled) > len(filled)


def _is_unit(cell: str) -> bool:
    """Whether a cell is a unit, with or without brackets, or empty."""
    try:
        return bool(units.dimension(cell.strip().strip('"[]()')))
    except NameUnknownError:
        return False


def _commented(above: Sequence[str], separator: str, width: int) -> list[str]:
    """Names in the last comment above the rows, as NumPy writes them; empty if it is no header."""
    text = above[-1].lstrip("#").strip() if above else ""
    for marks in (r"[,;\s]+", re.escape(separator)):  # names with spaces are between tabs
        names = [name.strip() for name in re.split(marks, text)]
        if len(names) == width and not any(map(_is_number, names)):
            return names
    return []


def _samples(rows: list[Sequence[str]], head: Sequence[str]) -> tuple[list, tuple[str, ...]]:
    """Rows that are samples, with a sentence on each other one.

    A repeated header begins an appended log; a single text is a remark, such as ``end of log``.
    """
    retained, remarks = [], dict[str, list[int]]()
    header = tuple(cell.strip() for cell in head)
    for number, row in enumerate(rows):
        filled = [cell.strip() for cell in row if cell.strip()]
        text = filled[0] if len(filled) == 1 < len(row) else ""
        if tuple(cell.strip() for cell in row) == header:
            remarks.setdefault("", []).append(number)
        elif text and text[0] not in "[(" and _number(text) is None and _seconds(text) is None:
            remarks.setdefault(text, []).append(number)
        else:
            retained.append(row)
    return retained, tuple(
        Doubt(f"row {' and '.join(map(str, numbers[:5]))}{' and others' if numbers[5:] else ''} "
              f"{f'has only the text {text!r}' if text else 'repeats the header'}: no sample")
        for text, numbers in remarks.items()
    )  # fmt: skip


def _of_cells(
    path: Path,
    cells: Mapping[str, Sequence[Any]],
    header: dict[str, Any] | None = None,
    notes: tuple[str, ...] = (),
) -> Table:
    """Table of named columns of cells, with a column for each pair of seconds and nanoseconds."""
    cells, row_notes = joint_rows.divided(cells, _number_or_time)
    notes = (*notes, *row_notes)
    columns: dict[str, np.ndarray] = {}
    messages: dict[str, str] = {}
    labels: dict[str, tuple[str, ...]] = {}
    marks: dict[str, np.ndarray] = {}
    clocks: list[str] = []
    for name, values in cells.items():
        try:
            if values and _items(values[0]) is not None:
                columns |= _lists(path, name, values)
                continue
            columns[name], text_cells, is_time = _numbers(path, name, values)
        except ParameterError as error:
            messages[name] = str(error)
            labels[name] = tuple(
                dict.fromkeys(str(v).strip() for v in values if v not in ("", None))
            )
            items = _items(labels[name][0]) if len(labels[name]) == 1 else None  # names of joints
            labels |= {f"{name}[{i}]": (item.strip("'\""),) for i, item in enumerate(items or ())}
            continue
        clocks += [name] * is_time
        if text_cells is not None:
            marks[name] = text_cells
    stamps = _combined_stamps(columns)
    clocks = [*stamps, *clocks]
    every = columns | stamps
    return Table(path, every, header or {}, messages, labels, marks, tuple(clocks), notes)


def _combined_stamps(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Times [s] from columns of seconds and of nanoseconds, by the words before both."""
    parts = {}
    for name in columns:
        match = _NANOSECONDS.fullmatch(name)
        if match:
            parts[match[1].lower()] = name
    stamps = {}
    for name in columns:
        match = _SECONDS.fullmatch(name)
        other = parts.get(match[1].lower()) if match else None
        label = (match[1] if match else "") or "sec + nanosec"
        if other and label not in columns:
            stamps[label] = columns[name] + 1e-9 * columns[other]
    return stamps


def _lists(path: Path, name: str, cells: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns from cells that are lists of numbers, ``"[0.1, 0.2]"``, as ``name[0]`` and so on."""
    rows = [_items(cell) or [""] for cell in cells]
    for line, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise ParameterError(
                f"{path.name}: column {name!r} lists {len(row)} numbers in row {line}, "
                f"{len(rows[0])} before"
            )
    result = {}
    for i, values in enumerate(zip(*rows, strict=True)):
        result[f"{name}[{i}]"], text_cells, _ = _numbers(path, f"{name}[{i}]", values)
        if text_cells is not None:
            raise ParameterError(
                f"{path.name}: column {name!r} lists {max(text_cells)!r}, no number"
            )
    return result


def _items(cell: Any) -> list[str] | None:
    """Texts of the values of a cell that is a list; None if it is none.

    Lists are in brackets or parentheses, also as Python writes arrays: ``array('d', [0.1, 0.2])``.
    """
    text = str(cell).strip()
    text = text.partition(",")[2].strip() if text.startswith("array(") else text
    if text[:1] not in ("[", "("):
        return None
    return re.split(r"[,;\s]+", text.strip("[]() ,;\t\r\n"))


def _separator(line: str) -> str:
    counts = {mark: line.count(mark) for mark in SEPARATORS}
    best = max((mark for mark in counts if mark != " "), key=lambda mark: counts[mark])
    return best if counts[best] else " " if counts[" "] else ","


def _padded(path: Path, rows: Any, names: Sequence[str]) -> list[Sequence[str]]:
    """Rows as long as the names; short ones, such as the last of a log, end with empty cells.

    Raises:
        ParameterError: A row is longer, or all are shorter: the names are not those of the cells.
    """
    full, width = [], len(names)
    named = max((i for i, name in enumerate(names, 1) if name), default=0)
    longest = max(map(len, rows), default=named)
    if longest < named:
        raise ParameterError(
            f"{path.name}: {named} names of columns above {longest} values in a row, so that a "
            "value may stand under the name of another; correct the first line"
        )
    for line, row in enumerate(rows, start=2):
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            raise ParameterError(
                f"{path.name}, line {line}: {len(row)} fields under {width} names of columns"
            )
        full.append(row[:width] + [""] * (width - len(row)))
    return full


def _numbers(
    path: Path, name: str, cells: Sequence[Any]
) -> tuple[np.ndarray, np.ndarray | None, bool]:
    """Numbers of cells, (T,), texts among them or None, and whether they are dates or times of day.

    A column has numbers, or times, if most of its cells are such, or a single other text.

    Raises:
        ParameterError: The column is one of texts.
    """
    try:
        return np.array([float(v) if v not in ("", None) else np.nan for v in cells]), None, False
    except (ValueError, TypeError):
        pass
    comma = not any("." in str(cell) for cell in cells)  # else it separates thousands
    numbers = [_number(cell, comma) for cell in cells]
    times = [_seconds(str(cell)) for cell in cells]
    n_numbers = sum(value is not None and not np.isnan(value) for value in numbers)
    is_time = len(times) - times.count(None) > 0.5 * (n_numbers + numbers.count(None))
    if is_time:
        numbers = [v if str(cell).strip() else np.nan for v, cell in zip(times, cells, strict=True)]
    text_cells = [row for row, value in enumerate(numbers) if value is None]
    n_texts = len({cells[row] for row in text_cells})
    if not is_time and n_numbers < max(2, len(text_cells)) and (n_numbers < 2 or n_texts > 1):
        row = text_cells[0]
        raise ParameterError(
            f"{path.name}: column {name!r} has {cells[row]!r} in row {row}, wanted is a number"
        )
    values, marks = np.array(numbers, dtype=float), None  # NaN for None
    if text_cells:
        marks = np.full(len(cells), "", dtype=object)
        marks[text_cells] = [str(cells[row]).strip() for row in text_cells]
    return _past_midnight(values) if is_time else values, marks, is_time


def _number(cell: Any, comma: bool = True) -> float | None:
    """Number of a cell, NaN for an empty one; None for a text.

    Args:
        cell: The cell.
        comma: Whether a comma is a decimal point.
    """
    token = str(cell).strip().lower()
    if token in EMPTY:
        return np.nan
    if token in ("true", "false"):
        return float(token == "true")
    if comma and re.fullmatch(r"[-+]?\d*,\d+(e[-+]?\d+)?", token):
        token = token.replace(",", ".")
    try:
        return float(token)
    except ValueError:
        return None


def _number_or_time(cell: Any) -> float | None:
    """Number of a cell, or time of a date; None for another text."""
    number = _number(cell)
    return _seconds(str(cell)) if number is None else number


def _seconds(text: str) -> float | None:
    """Time [s] of a date with a time (ISO 8601, UTC if without zone) or of a time of day, or None.

    These dates count from 1970; times of day, also after another date, from midnight. A number with
    a unit of time is a time, too.
    """
    duration = _DURATION.fullmatch(text.strip())
    if duration and (number := _number(duration[1])) is not None:
        return number * units.factor(duration[2])
    match = _DATE.fullmatch(text.strip())
    time = None if match else _TIME_OF_DAY.fullmatch(text.strip())
    if time:
        hours, minutes, seconds = (float(part.replace(",", ".")) for part in time.groups())
        return 3600.0 * hours + 60.0 * minutes + seconds
    try:
        date, clock, fraction, hours, minutes = match.groups() if match else [""] * 5
        moment = datetime.fromisoformat(f"{date}T{clock}{hours or '+00'}:{minutes or '00'}")
    except ValueError:
        return None
    return moment.timestamp() + float(f"0.{fraction or 0}")


def _past_midnight(t: np.ndarray) -> np.ndarray:
    """Times [s] with a day added where a time of day begins again."""
    valid = np.isfinite(t)
    days = np.zeros(len(t))
    if valid.any() and np.nanmax(t) < 4.0 * HALF_DAY:
        days[valid] = np.cumsum(np.diff(t[valid], prepend=t[valid][0]) < -HALF_DAY)
    return t + 2.0 * HALF_DAY * days


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _leaves(value: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Values of nested mappings by their dotted names; lists are values."""
    flattened: dict[str, Any] = {}
    for key, inside in value.items():
        name = f"{prefix}{key}"
        flattened |= _leaves(inside, f"{name}.") if isinstance(inside, dict) else {name: inside}
    return flattened


def _from_json(path: Path, value: Any, samples: str) -> Table:
    rows, header = value, {}
    if isinstance(value, dict):
        value = value if any(isinstance(v, list) for v in value.values()) else _leaves(value)
        lists = {k: v for k, v in value.items() if isinstance(v, list) and v}
        records = {k: v for k, v in lists.items() if isinstance(v[0], dict)}
        if not samples and not records and lists:  # a mapping of columns
            header = {k: v for k, v in value.items() if k not in lists}
            return _of_cells(path, _equal(path.name, lists), header)
        samples = samples or (next(iter(records)) if len(records) == 1 else "")
        rows = _chosen(path, records, samples)
        header = {k: v for k, v in value.items() if k != samples}
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise ParameterError(f"{path.name} must hold a list of samples, each with named values")
    rows, notes = _of_runs(path, rows)
    names = {name: None for row in rows for name in _flatten(row)}
    flattened = [_flatten(row) for row in rows]
    lists = {name: [row.get(name) for row in flattened] for name in names}
    return _of_cells(path, _equal(path.name, lists), header, notes)


def _chosen(path: Path, records: dict[str, list], samples: str) -> list:
    """The list of samples of a JSON log that has this name."""
    if not records:
        raise ParameterError(f"{path.name} must hold a list of samples or columns of numbers")
    if samples not in records:
        raise NameUnknownError(f"list of samples in {path.name}", samples, records)
    return records[samples]


def _of_runs(path: Path, rows: list[dict[str, Any]]) -> tuple[list[dict], tuple[str, ...]]:
    """Samples of all runs with the number of their run, if each item is a run; else the rows.

    Items are runs if each has a list that is longer than the list of items: a run has columns, a
    sample the values of its joints. Lists less than half as long as the longest are settings.
    """
    lengths = [{k: len(v) for k, v in row.items() if isinstance(v, list)} for row in rows]
    longest = [max(sizes.values(), default=0) for sizes in lengths]
    if min(longest) <= len(rows):
        return rows, ()
    samples, left = [], dict[str, None]()
    for number, (row, sizes, maximum) in enumerate(zip(rows, lengths, longest, strict=True)):
        names = [name for name, size in sizes.items() if 2 * size >= maximum]
        _equal(f"{path.name}, run {number}", {name: row[name] for name in names})
        left |= {name: None for name in sizes if name not in names}
        values = {k: v for k, v in row.items() if k not in sizes} | {foreign.EPISODE: number}
        samples += [values | {name: row[name][i] for name in names} for i in range(maximum)]
    text = f"shorter lists of its runs are left out: {', '.join(left)}"
    return samples, (Doubt(text),) if left else ()


def _flatten(row: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values and lists under dotted names and indices: ``imu.gyro[2]``."""
    result: dict[str, Any] = {}
    for key, value in row.items():
        inside = value
        if isinstance(value, list):
            inside = {f"[{i}]": v for i, v in enumerate(value)}
        name = f"{prefix}{key}" if key.startswith("[") or not prefix else f"{prefix}.{key}"
        if isinstance(inside, dict):
            result |= _flatten(inside, name)
        else:
            result[name] = value
    return result


def _equal(source: str, lists: dict[str, list]) -> dict[str, list]:
    """Columns of one length; those of lists divided into columns such as ``q[2]``."""
    lengths = {len(values) for values in lists.values()}
    if len(lengths) != 1:
        raise ParameterError(f"{source}: its columns have {sorted(lengths)} samples")
    divided: dict[str, list] = {}
    for name, values in lists.items():
        rows = [value if isinstance(value, list) else [] for value in values]
        width = max(map(len, rows))
        parts = {f"{name}[{i}]": [row[i] if i < len(row) else None for row in rows]
                 for i in range(width)}  # fmt: skip
        divided |= parts or {name: values}
    return divided
