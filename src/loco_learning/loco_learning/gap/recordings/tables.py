# SPDX-License-Identifier: Apache-2.0
"""CSV files, JSON logs and binary tables, compressed or not, as named columns of numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import parse_csv, parse_json, read_text, understood

from . import foreign

KINDS = (".csv", ".txt", ".tsv", ".json", ".jsonl", ".pt", ".parquet")
BINARY = {".pt": foreign.torch_columns, ".parquet": foreign.parquet_columns}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one file.

    Attributes:
        path: File of the table.
        columns: Numbers by name, all of one length; NaN for an empty field.
        header: Other fields of a JSON log.
        texts: Reason why a column of a CSV file holds no numbers, by name; an error if it is used.
    """

    path: Path
    columns: dict[str, np.ndarray]
    header: dict[str, Any] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def column(self, name: str) -> np.ndarray:
        """A column by name.

        Raises:
            NameUnknownError: The file has no such column.
            ParameterError: The column does not hold numbers.
        """
        for text in (name, name.split("[")[0]):
            if text in self.texts:
                raise ParameterError(self.texts[text])
        if name not in self.columns:
            raise NameUnknownError(f"column in {self.path.name}", name, self.columns)
        return self.columns[name]


def episodes(table: Table) -> list[Table]:
    """The table divided into its episodes, with their number in the header."""
    numbers = table.columns.get(foreign.EPISODE)
    if numbers is None:
        return [table]
    result = []
    for number in np.unique(numbers[np.isfinite(numbers)]):
        rows = numbers == number
        columns = {name: values[rows] for name, values in table.columns.items()}
        header = {**table.header, foreign.EPISODE: int(number)}
        result.append(Table(table.path, columns, header, table.texts))
    return result


def is_table(path: Path) -> bool:
    """True if the extension of the file is that of a table."""
    return _kind(path) in KINDS


@understood("table of samples")
def read(path: str | Path, samples: str = "") -> Table:
    """Read a file, by the extension of its name with or without ``.gz``.

    Args:
        path: CSV with a header line (separated by comma, semicolon, tab or spaces), JSON, JSON
            lines, ``.pt`` or ``.parquet``.
        samples: Field of a JSON log that is its list of samples; empty: the only list.

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The content does not match the extension.
    """
    path = Path(path)
    kind = _kind(path)
    text = "" if kind in BINARY else read_text(path)
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
        raise ParameterError(f"{path.name} has no samples")
    return table


def _kind(path: Path) -> str:
    name = path.name.lower().removesuffix(".gz")
    return Path(name).suffix


def _from_csv(path: Path, text: str) -> Table:
    """Columns under a header line, without empty columns that have no name."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise ParameterError(f"{path.name} is empty")
    separator = _separator(lines[0])
    first, *rows = parse_csv(lines, path.name, delimiter=separator, skipinitialspace=True)
    names = [name.strip() for name in first]
    if all(_is_number(name) for name in names if name):
        raise ParameterError(
            f"{path.name} has no header line: its first line is all numbers, wanted are the "
            "names of the columns"
        )
    cells = list(zip(*_padded(path, rows, len(names)), strict=True))
    columns: dict[str, np.ndarray] = {}
    messages: dict[str, str] = {}
    for name, values in zip(names, cells, strict=False):
        if name in columns or name in messages:
            raise ParameterError(f"{path.name} has two columns named {name!r}")
        try:
            if name and any(value.lstrip().startswith("[") for value in values[:1]):
                columns |= _lists(path, name, values)
            elif name:
                columns[name] = _numbers(path, name, values, separator == ";")
        except ParameterError as error:
            messages[name] = str(error)
    return Table(path, columns, texts=messages)


def _lists(path: Path, name: str, cells: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns from cells that are lists of numbers, ``"[0.1, 0.2]"``, as ``name[0]`` and so on."""
    rows = [re.split(r"[,;\s]+", cell.strip().strip("[]").strip()) for cell in cells]
    for line, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise ParameterError(
                f"{path.name}: column {name!r} lists {len(row)} numbers in row {line}, "
                f"{len(rows[0])} before"
            )
    columns = zip(*rows, strict=True)
    return {
        f"{name}[{i}]": _numbers(path, f"{name}[{i}]", list(values), False)
        for i, values in enumerate(columns)
    }


def _separator(line: str) -> str:
    counts = {mark: line.count(mark) for mark in (";", "\t", ",", " ")}
    best = max((mark for mark in counts if mark != " "), key=lambda mark: counts[mark])
    return best if counts[best] else " " if counts[" "] else ","


def _padded(path: Path, rows: Any, width: int) -> list[Sequence[str]]:
    full = []
    for line, row in enumerate(rows, start=2):
        if len(row) > width and any(cell.strip() for cell in row[width:]):
            raise ParameterError(
                f"{path.name}, line {line}: {len(row)} fields under {width} names of columns"
            )
        full.append(row[:width] + [""] * (width - len(row)))
    return full


def _numbers(path: Path, name: str, values: Sequence[str], comma: bool) -> np.ndarray:
    try:
        return np.array([float(v) if v else np.nan for v in values])
    except ValueError:
        return np.array([_number(path, name, i, v, comma) for i, v in enumerate(values)])


def _number(path: Path, name: str, row: int, text: Any, comma: bool) -> float:
    token = str(text).strip().lower()
    if token in ("", "none", "null", "nan", "na"):
        return np.nan
    if token in ("true", "false"):
        return float(token == "true")
    if comma and re.fullmatch(r"[-+]?\d*,\d+(e[-+]?\d+)?", token):
        token = token.replace(",", ".")
    try:
        return float(token)
    except ValueError:
        raise ParameterError(
            f"{path.name}: column {name!r} has {text!r} in row {row}, wanted is a number"
        ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _from_json(path: Path, value: Any, samples: str) -> Table:
    rows, header = value, {}
    if isinstance(value, dict):
        lists = {k: v for k, v in value.items() if isinstance(v, list) and v}
        records = {k: v for k, v in lists.items() if isinstance(v[0], dict)}
        if not samples and not records and lists:  # a mapping of columns
            header = {k: v for k, v in value.items() if k not in lists}
            return Table(path, _equal(path, lists), header)
        samples = samples or (next(iter(records)) if len(records) == 1 else "")
        if samples not in records:
            raise NameUnknownError(f"list of samples in {path.name}", samples, records)
        rows, header = records[samples], {k: v for k, v in value.items() if k != samples}
    if not isinstance(rows, list) or not rows or not isinstance(rows[0], dict):
        raise ParameterError(f"{path.name} must hold a list of samples, each with named values")
    names = {name: None for row in rows for name in _flat(row)}
    flattened = [_flat(row) for row in rows]
    lists = {name: [row.get(name) for row in flattened] for name in names}
    return Table(path, _equal(path, lists), header)


def _flat(row: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested values and lists under dotted names and indices: ``imu.gyro[2]``."""
    result: dict[str, Any] = {}
    for key, value in row.items():
        inside = value
        if isinstance(value, list):
            inside = {f"[{i}]": v for i, v in enumerate(value)}
        name = f"{prefix}{key}" if key.startswith("[") or not prefix else f"{prefix}.{key}"
        if isinstance(inside, dict):
            result |= _flat(inside, name)
        else:
            result[name] = value
    return result


def _equal(path: Path, lists: dict[str, list]) -> dict[str, np.ndarray]:
    """Columns of numbers; columns of text are omitted."""
    lengths = {len(values) for values in lists.values()}
    if len(lengths) != 1:
        raise ParameterError(f"{path.name}: its columns have {sorted(lengths)} samples")
    non_numeric = {k for k, v in lists.items() if any(isinstance(x, (str, list)) for x in v)}
    return {
        name: np.array([np.nan if x is None else float(x) for x in values])
        for name, values in lists.items()
        if name not in non_numeric
    }
