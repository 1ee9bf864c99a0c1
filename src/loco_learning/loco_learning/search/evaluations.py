# SPDX-License-Identifier: Apache-2.0
"""Record of an optimisation: a text file to which each evaluation is appended.

The first line describes the problem and the search. Every other line is one evaluation, in the
order of generation and index for any number of workers. The state of the search follows from the
file, so that a killed search resumes where it was, and ends with the same file, byte for byte, as
one that was not interrupted.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np

from loco_control.checks import Between, check_file
from loco_control.exceptions import MissingFileError, ParameterError

from ..jobs import journal
from ..jobs.journal import Journal
from .score import Score

FORMAT = 2
FILE = "evaluations.jsonl"


class Row(TypedDict):
    """One evaluation in the file."""

    generation: int
    index: int
    sigma: numbers.Real
    x: list[numbers.Real]
    value: numbers.Real
    reason: str
    extra: dict[str, Any]


class Header(TypedDict):
    """Required keys of the first line."""

    population: Annotated[int, Between(1, 1_000_000)]
    names: list[str]


class Evaluations:
    """Evaluations of one optimisation, in memory and appended to a file.

    Args:
        path: The file, created if missing; None writes no file.
        header: Description of the problem and the search: plain values.

    Attributes:
        rows: Mappings with generation, index, sigma, x, value, reason and extra.

    Raises:
        ParameterError: The file is of another version or optimisation, broken, or
            being written by another process.
    """

    def __init__(self, path: str | Path | None, header: Mapping[str, Any]):
        self._journal = Journal(path, {"kind": "optimisation", "format": FORMAT, **header}, Row)
        self.header, self.rows = self._journal.header, self._journal.rows
        try:
            _check(path, self.header, self.rows)
        except ParameterError:
            self.close()
            raise

    def append(
        self, generation: int, index: int, sigma: float, x: np.ndarray, score: Score
    ) -> None:
        """Append one evaluation; it survives the death of this process."""
        row = {"generation": generation, "index": index, "sigma": float(sigma)}
        row |= {"x": [float(v) for v in x], "value": float(score.value)}
        row |= {"reason": score.reason, "extra": score.extra}
        self._journal.append(row)

    def generation(self, number: int) -> list[dict[str, Any]]:
        """Available rows of a generation, in order of their index."""
        size = self.header["population"]
        return self.rows[number * size : (number + 1) * size]

    def close(self) -> None:
        """Close the file."""
        self._journal.close()


def read(path: str | Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Header and rows of a file, or of the folder of an optimisation.

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The file is of another version, or broken.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    if not path.is_file():
        raise MissingFileError(f"there is no record of an optimisation {path}")
    header, rows, _ = journal.read(path, Row)
    version = (header.get("kind"), header.get("format"))
    if version != ("optimisation", FORMAT):
        raise ParameterError(
            f"{path} is a record of kind {version[0]!r}, format {version[1]}; wanted is "
            f"'optimisation', format {FORMAT}"
        )
    check_file(header, Header, path)
    _check(path, header, rows)
    return header, rows


def columns(rows: list[dict[str, Any]], population: int) -> dict[str, np.ndarray]:
    """History of an optimisation over its complete generations, (generations,) each.

    Keys: ``evaluations`` done, ``best`` so far, ``median`` of the generation, ``sigma`` and the
    share of ``failures``.
    """
    generations = len(rows) // population
    values = np.array([row["value"] for row in rows[: generations * population]], dtype=float)
    values = values.reshape(generations, population)
    failed = [bool(row["reason"]) for row in rows[: generations * population]]
    return {
        "evaluations": population * np.arange(1, generations + 1),
        "best": np.minimum.accumulate(values.min(axis=1)) if generations else np.zeros(0),
        "median": np.median(values, axis=1),
        "sigma": np.array([rows[g * population]["sigma"] for g in range(generations)]),
        "failures": np.reshape(failed, (generations, population)).mean(axis=1),
    }


def _check(path: Any, header: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise an error if a row is not the evaluation expected at its position."""
    for number, row in enumerate(rows):
        try:
            place = divmod(number, header["population"])
            if (row["generation"], row["index"]) != place or len(row["x"]) != len(header["names"]):
                raise ValueError("not the evaluation that belongs here")
        except (ValueError, KeyError, TypeError) as error:
            raise ParameterError(f"{path}, line {number + 2}, is broken: {error}") from None
