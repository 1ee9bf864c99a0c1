# SPDX-License-Identifier: Apache-2.0
"""The record of an optimisation: a text file to which each evaluation is appended.

First line: what was optimised and how. Every other line: one evaluation, in the order of
generation and index, however many workers there were. The file is all there is to an
optimisation: the state of the search follows from it, so that a killed one goes on where
it was, and ends with the same file, byte for byte, as one that was left alone.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, ParameterError

from .score import Score

FORMAT = 1
FILE = "evaluations.jsonl"


class Evaluations:
    """Evaluations of one optimisation, in memory and appended to a file.

    Args:
        path: The file, made when it is missing; None keeps nothing.
        header: Description of the problem and the search: plain values.

    Attributes:
        rows: Mappings with generation, index, sigma, x, value, reason and extra.

    Raises:
        ParameterError: The file is of another version, of another optimisation, broken, or
            being written by another process.
    """

    def __init__(self, path: str | Path | None, header: Mapping[str, Any]):
        self.header = {"kind": "optimisation", "format": FORMAT, **json.loads(json.dumps(header))}
        self.rows: list[dict[str, Any]] = []
        self._file: Any = None
        if path is not None:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            self._open(Path(path))

    def _open(self, path: Path) -> None:
        file = open(path, "a+", encoding="utf-8")  # noqa: SIM115, closed by `close`
        try:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise ParameterError(f"another optimisation is writing {path}") from error
            end = _whole(path)
            if end:
                header, self.rows = _parse(path, end)
                _compare(path, header, self.header)
                file.truncate(end)
            else:
                file.truncate(0)
                file.write(json.dumps(self.header) + "\n")
                file.flush()
        except BaseException:
            file.close()
            raise
        self._file = file

    def append(
        self, generation: int, index: int, sigma: float, x: np.ndarray, score: Score
    ) -> None:
        """Keep one evaluation; it survives the death of this process."""
        row = {"generation": generation, "index": index, "sigma": float(sigma)}
        row |= {"x": [float(v) for v in x], "value": float(score.value)}
        row |= {"reason": score.reason, "extra": score.extra}
        self.rows.append(row)
        if self._file:
            self._file.write(json.dumps(row) + "\n")
            self._file.flush()

    def generation(self, number: int) -> list[dict[str, Any]]:
        """Rows of a generation, as many as there are, in order of their index."""
        size = self.header["population"]
        return self.rows[number * size : (number + 1) * size]

    def close(self) -> None:
        """Let go of the file."""
        if self._file:
            self._file.close()


def read(path: str | Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Header and rows of a file, or of the folder that an optimisation wrote.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is of another version, or broken.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    if not path.is_file():
        raise MissingFileError(f"there is no record of an optimisation {path}")
    return _parse(path, _whole(path))


def columns(rows: list[dict[str, Any]], population: int) -> dict[str, np.ndarray]:
    """Course of an optimisation over its whole generations, each (generations,).

    ``evaluations`` done, ``best`` so far, ``median`` of the generation, ``sigma`` and the
    share of ``failures``.
    """
    whole = len(rows) // population
    values = np.array([row["value"] for row in rows[: whole * population]], dtype=float)
    values = values.reshape(whole, population)
    failed = [bool(row["reason"]) for row in rows[: whole * population]]
    return {
        "evaluations": population * np.arange(1, whole + 1),
        "best": np.minimum.accumulate(values.min(axis=1)) if whole else np.zeros(0),
        "median": np.median(values, axis=1),
        "sigma": np.array([rows[g * population]["sigma"] for g in range(whole)]),
        "failures": np.reshape(failed, (whole, population)).mean(axis=1),
    }


def _whole(path: Path) -> int:
    """Bytes up to the end of the last whole line: what a killed process began is left out."""
    return path.read_bytes().rfind(b"\n") + 1


def _parse(path: Path, end: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    try:
        lines = path.read_bytes()[:end].decode().splitlines()
        header = json.loads(lines[0])
        version = (header["kind"], header["format"])
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise ParameterError(f"{path} is not the record of an optimisation ({error})") from error
    if version != ("optimisation", FORMAT):
        raise ParameterError(
            f"{path} is a record of kind {version[0]!r}, format {version[1]}; wanted is "
            f"'optimisation', format {FORMAT}"
        )
    return header, [_row(path, number, line, header) for number, line in enumerate(lines[1:])]


def _row(path: Path, number: int, line: str, header: dict[str, Any]) -> dict[str, Any]:
    try:
        row = json.loads(line)
        place = divmod(number, header["population"])
        if (row["generation"], row["index"]) != place or len(row["x"]) != len(header["names"]):
            raise ValueError("not the evaluation that belongs here")
    except (ValueError, KeyError, TypeError) as error:
        raise ParameterError(f"{path}, line {number + 2}, is broken: {error}") from error
    return row


def _compare(path: Path, recorded: Mapping[str, Any], header: Mapping[str, Any]) -> None:
    for key in (*header, *recorded):
        if recorded.get(key) != header.get(key):
            raise ParameterError(
                f"{path.parent} holds another optimisation: {key} is {recorded.get(key)!r} there, "
                f"{header.get(key)!r} here; choose another folder or remove that one"
            )
