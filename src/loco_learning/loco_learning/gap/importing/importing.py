# SPDX-License-Identifier: Apache-2.0
"""Import of tables as records, by a mapping; ``loco_bringup.gap.importing`` reads bags."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, ParameterError
from loco_sim.robot.robot import Robot

from ..recordings import tracks
from ..recordings.mapping import Column, Mapping, Rule
from ..recordings.record import Doubt, Record
from . import align, tables
from .foreign import EPISODE

NO_RECORDING = "there is no recording at {}; name a bag folder or a file (docs/gap_import.md)"


class TableSource:
    """Columns of a file, or of an episode in it, and of other files in its folder.

    Raises:
        LocoError: The file cannot be read.
    """

    def __init__(self, path: Path, mapping: Mapping, table: tables.Table | None = None):
        self._table = tables.read(path, mapping.samples) if table is None else table
        self._folder, self._mapping = path.parent, mapping
        self._tables: dict[str, tables.Table] = {"": self._table}
        self._times: dict[tuple[str, str], np.ndarray] = {}
        self.header = self._table.header
        self.notes: list[str] = list(self._table.notes)
        episode = self.header.get(EPISODE)
        stem = path.name.removesuffix(".gz").rsplit(".", 1)[0]
        self.name = stem if episode is None else f"episode {episode}"

    def series(self, column: Column) -> tuple[np.ndarray, np.ndarray]:
        """Time stamps [s] and raw values of a column, each (K,)."""
        if column.file not in self._tables:
            other = tables.read(self._folder / column.file, self._mapping.samples)
            self._tables[column.file] = other
            self.notes += other.notes
        table = self._tables[column.file]
        time = column.time or self._mapping.time
        if (column.file, time) not in self._times:
            self._times[column.file, time] = self._clock(table, time)
        t = self._times[column.file, time]
        raw = table.column(column.column, column.missing_texts)
        for text, rows in table.text_rows(column.column).items():
            self.notes.append(
                Doubt(
                    f"{column.column}: {len(rows):,} of {len(raw):,} cells are {text!r}, which the "
                    "mapping calls missing: left out"
                )
            )
        if time in table.cell_texts:
            t, raw = (x[table.cell_texts[time] == ""] for x in (t, raw))
        if column.time:  # a column with its own times may be shorter than the table
            t, raw = t[np.isfinite(t)], raw[np.isfinite(t)]
        return t, raw

    def _clock(self, table: tables.Table, time: str) -> np.ndarray:
        if time:
            by_text = table.text_rows(time)
            for text, rows in by_text.items():
                self.notes.append(
                    Doubt(
                        f"{time}: row {rows[0]}{' and others' if rows[1:] else ''} has the text "
                        f"{text!r} for its time: no reading"
                    )  # fmt: skip
                )
            return table.column(time, tuple(by_text)) * self._mapping.time_unit
        if not self._mapping.time_rate:
            raise ParameterError(
                f"{self._mapping.path} must say time: {{column: ...}} with the times, or "
                f"time: {{rate: ...}} with the rate of the log in Hz; {table.path.name} has "
                f"{', '.join(table.columns)}"
            )
        return np.arange(len(table)) / self._mapping.time_rate


def load(path: str | Path, robot: Robot, mapping: Mapping, judge: bool = True) -> list[Record]:
    """Records of a table, or of the mapped files of a folder.

    Args:
        path: File, or folder with the files that the mapping names.
        robot: Robot that was measured.
        mapping: Roles and units of the columns.
        judge: Whether to reject signals that are probably in a wrong unit; if not, `setup.family`
            reports them.

    Raises:
        MissingFileError: The file does not exist, or none fits the mapping.
        LocoError: The data contradict their description.
    """
    path = Path(path)
    if path.is_dir():
        paths = {p for pattern in mapping.files for p in path.glob(pattern) if tables.is_table(p)}
        if not paths:
            raise MissingFileError(f"{path} has no file like {' or '.join(mapping.files)}")
    elif path.is_file():
        paths = {path}
    else:
        raise MissingFileError(NO_RECORDING.format(path))
    recordings = [
        record
        for p in sorted(paths)
        for table in tables.episodes(tables.read(p, mapping.samples))
        for record in records(TableSource(p, mapping, table), robot, mapping, p.name, judge)
    ]
    if not recordings:
        raise ParameterError(f"no record of {mapping.path} fits {path}; see its 'records'")
    return recordings


def records(
    source: tracks.Source, robot: Robot, mapping: Mapping, file: str, judge: bool = True
) -> list[Record]:
    """Records of a file or bag: one for each matching rule and each cut of its clock.

    Args:
        source: File or bag that holds the columns.
        robot: Robot that was measured.
        mapping: Roles and units of the columns.
        file: File name to compare with the patterns of the rules.
        judge: Whether to reject signals that are probably in a wrong unit; if not, `setup.family`
            reports them.

    Raises:
        LocoError: The mapping does not fit the columns, or their data are invalid.
    """
    rules = [rule for rule in mapping.records if fits(rule, file, source.header)]
    result: list[Record] = []
    for i, rule in enumerate(rules):
        read = tracks.from_source(source, mapping, rule, robot)
        first, *later = align.records(
            title(rule, source, i, len(rules)),
            [*read, *tracks.without_columns(read, mapping, robot)],
            robot,
            rate=mapping.rate,
            role=rule.role,
            overrides=overrides(mapping, rule, source.header),
            notes=source.notes,
            trust_units=mapping.trust_units,
            mend=mapping.mend,
            judge=judge,
            unscaled=tuple(c.place for c in tracks.of_joints(mapping, robot) if tracks.unscaled(c)),
        )
        parts = first.rested(-rule.rest), *later  # after a cut, the robot was not at rest
        result += [replace(part, stepped=mapping.physics_step) for part in parts]
    return result


def title(rule: Rule, source: tracks.Source, part: int, parts: int) -> str:
    """Name of a record; ``{field}`` in the name of the rule is replaced by a field of the header.

    Raises:
        ParameterError: The header lacks the field.
    """
    default = f"{source.name} {part + 1}" if parts > 1 else source.name
    try:
        return rule.name.format_map(source.header) or default
    except (KeyError, ValueError, AttributeError, IndexError):
        raise ParameterError(
            f"the name {rule.name!r} of a record may have {{field}} for fields of the header "
            f"({', '.join(source.header) or 'none'})"
        ) from None


def fits(rule: Rule, file: str, header: dict[str, Any]) -> bool:
    """True if the rule applies to this file."""
    return fnmatchcase(file, rule.file) and all(
        header.get(field) in allowed for field, allowed in rule.where.items()
    )


def overrides(mapping: Mapping, rule: Rule, header: dict[str, Any]) -> dict[str, Any]:
    """Values of robot.yaml for a record, from mapping, rule and header.

    Raises:
        ParameterError: The header lacks a field, or the field is not a number.
    """
    values = mapping.overrides | rule.overrides
    for field, entry in mapping.header.items():
        value = header.get(field)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ParameterError(
                f"header field {field!r} must be a number, got {value!r}; the header has "
                f"{', '.join(header) or 'nothing'}"
            )
        values[entry.override] = entry.scale * value + entry.offset
    return values
