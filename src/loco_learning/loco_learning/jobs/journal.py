# SPDX-License-Identifier: Apache-2.0
"""Journal: a file to which finished work is appended, so that a killed command can resume.

The first line identifies the work. Every other line is one result, with a check sum. An incomplete
last line, from a killed process or a full disk, is removed and its work is repeated.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from loco_control.checks import check
from loco_control.exceptions import ParameterError
from loco_control.reading import parse_json, read_bytes, shown

from ..plain import flat

log = logging.getLogger(__name__)

_SUM = ', "crc": "'  # start of the check sum at the end of each line


class Journal:
    """Rows in memory and in a file to which only this process writes.

    Args:
        path: The file, created if missing; None keeps rows in memory only.
        header: Description of the work, with `kind` and `format`: plain values.
        row: A `TypedDict` of the keys of a row, for `checks.check`.
        new: Whether a broken file, or one of other work, is overwritten with a warning.

    Attributes:
        header: Header as read back from JSON.
        rows: Rows of plain values, in the order in which they were appended.

    Raises:
        ParameterError: The file is broken, belongs to other work or is being written by
            another process.
        OSError: The file cannot be written.
    """

    def __init__(
        self,
        path: str | Path | None,
        header: Mapping[str, Any],
        row: Any = dict[str, Any],
        new: bool = False,
    ):
        self.header: dict[str, Any] = json.loads(json.dumps(header))
        self.rows: list[dict[str, Any]] = []
        self.path = Path(path) if path is not None else None
        self._file: Any = None
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._open(self.path, row, new)

    def _open(self, path: Path, row: Any, new: bool) -> None:
        if path.exists() and not path.is_file():
            raise ParameterError(f"{path} is no file")  # reading a pipe would block
        file = open(path, "ab", buffering=0)  # noqa: SIM115, closed by `close`
        try:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise ParameterError(f"another process is writing {path}") from error
            end = 0
            try:
                _, self.rows, end = read(path, row, self.header)
            except ParameterError as error:
                if not new:
                    raise
                log.warning("work that was begun is done anew: %s", error)
                end = 0
            os.ftruncate(file.fileno(), end)
            if not end:
                _put(file, _line(self.header))
        except BaseException:
            file.close()
            raise
        self._file = file

    def append(self, row: Mapping[str, Any]) -> None:
        """Append a row to memory and file; it survives the death of this process.

        Raises:
            OSError: The disk is full; the file ends with the previous row.
        """
        self.rows.append(dict(row))
        if self._file:
            _put(self._file, _line(row))

    def close(self) -> None:
        """Close the file."""
        if self._file:
            self._file.close()
            self._file = None

    def remove(self) -> None:
        """Close and delete the file, when the work is complete."""
        if self._file and self.path:
            self.path.unlink(missing_ok=True)
        self.close()


def read(
    path: Path, row: Any = dict[str, Any], header: Mapping[str, Any] | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]], int]:
    """Header and rows of a journal, and the number of bytes up to its last complete line.

    Args:
        path: The file.
        row: A `TypedDict` of the keys of a row, for `checks.check`.
        header: The required header; None for any.

    Raises:
        ParameterError: The header differs, a complete line is broken, or a value is invalid.
    """
    data = read_bytes(path, "journal")
    end = data.rfind(b"\n") + 1
    lines = data[:end].splitlines()
    if not lines:
        return {}, [], 0
    stored = _parsed(path, 1, lines[0], dict[str, Any])
    if header is not None:
        _compare(path, stored, header)
    return stored, [_parsed(path, n, line, row) for n, line in enumerate(lines[1:], start=2)], end


def _line(row: Mapping[str, Any]) -> bytes:
    text = json.dumps(row)[:-1]
    return f'{text}{_SUM}{zlib.crc32(text.encode()):08x}"}}\n'.encode()


def _parsed(path: Path, number: int, line: bytes, kind: Any) -> dict[str, Any]:
    text, mark, rest = line.decode("ascii", "replace").rpartition(_SUM)
    try:
        if not mark:
            raise ValueError("it has no check sum, as files of other kinds and older versions")
        if rest != f'{zlib.crc32(text.encode()):08x}"}}':
            raise ValueError("its check sum is wrong")
        row = parse_json(text + "}", "it")
        check(row, kind, "")
    except ValueError as error:
        raise ParameterError(f"{path}, line {number}, is broken: {error}") from None
    return row


def _put(file: Any, data: bytes) -> None:
    """Append data completely or not at all."""
    end = os.fstat(file.fileno()).st_size
    view = memoryview(data)
    try:
        while view:
            view = view[file.write(view) :]
    except OSError:
        os.ftruncate(file.fileno(), end)
        raise


def _compare(path: Path, recorded: Mapping[str, Any], header: Mapping[str, Any]) -> None:
    stored, current = flat(recorded), flat(header)
    for key in (*current, *stored):
        if stored.get(key) != current.get(key):
            raise ParameterError(
                f"{path} belongs to other work: {shown(key, 80)[1:-1]} is {shown(stored.get(key))} there, "
                f"{shown(current.get(key))} here; choose another folder or remove that one"
            )
