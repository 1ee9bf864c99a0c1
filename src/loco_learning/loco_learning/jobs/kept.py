# SPDX-License-Identifier: Apache-2.0
"""Jobs with results in a journal: a job whose result is in the journal is not run again.

The jobs of a search depend on the results of earlier ones. A restarted search requests the same
jobs, since all random numbers are seeded: results from before a kill are read from the journal,
and the search continues to the same end.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import json
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from loco_control.exceptions import LocoError, ParameterError

from .. import __version__
from . import values
from .base import Failure, Jobs
from .journal import Journal

log = logging.getLogger(__name__)

_DECIDES = ("numpy", "scipy", "numba", "mujoco", "pybullet", "cma")  # affect the last bits
LIMIT = 128 * 2**20  # largest size of a journal of results [bytes]; further results are not stored


class Row(TypedDict):
    """A result in the journal."""

    key: str
    result: Any


def versions(names: Iterable[str] = _DECIDES) -> dict[str, str]:
    """Versions of this package and of others, by default those that affect its last bits."""
    result = {"loco": __version__}
    for name in names:
        try:
            result[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return result


def digest(*values: Any) -> str:
    """Digest of plain values, arrays, containers of these, paths and functions, 32 hex digits.

    Raises:
        TypeError: A value is of another type.
    """
    hasher = hashlib.sha256()
    _feed(hasher, values)
    return hasher.hexdigest()[:32]


def _feed(digest: Any, value: Any) -> None:
    kind = type(value).__qualname__
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, Mapping):
        digest.update(f"{kind}{len(value)}".encode())
        for key, entry in value.items():
            _feed(digest, key)
            _feed(digest, entry)
    elif isinstance(value, (list, tuple)):
        digest.update(f"{kind}{len(value)}".encode())
        for entry in value:
            _feed(digest, entry)
    elif isinstance(value, (str, bytes, int, float, np.generic, Path)) or value is None:
        text = repr(value).encode()
        digest.update(f"{kind}{len(text)}".encode() + text)
    elif callable(value) and hasattr(value, "__qualname__"):
        digest.update(f"{value.__module__}.{value.__qualname__}".encode())
    elif hasattr(value, "__dict__"):
        _feed(digest, [kind, vars(value)])
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


class Memory:
    """Results of a search's jobs, in a journal that is deleted when the search is complete.

    A context manager: the journal is deleted on success and on invalid input (`LocoError`), unless
    it stays. After any other exception it remains, for a restarted search.

    Args:
        path: The file; a broken one, or one of another search, is overwritten with a warning.
        inputs: All values that determine the results, for `digest`, besides package versions.
        types: Dataclasses in the results, besides arrays and plain values.
        stays: Whether the journal stays, for a later search with more jobs.
    """

    def __init__(
        self, path: Path, inputs: Sequence[Any], types: Sequence[type], stays: bool = False
    ):
        self._path, self._stays = path, stays
        self._header = {"kind": "search", "format": 4, "inputs": digest(*inputs)}
        self._header["versions"] = versions()
        self._journal: Journal | None = None
        self._known: dict[str, Any] = {}
        self._size, self._full = 0, False
        self._kinds = tuple(types)
        self._places = 0
        if path.exists():
            self._journal = Journal(path, self._header, Row, new=True)
            self._size = path.stat().st_size
            self._known = {row["key"]: row["result"] for row in self._journal.rows}

    def keeping(self, place: Jobs) -> Jobs:
        """The given jobs, with results stored in the journal."""
        self._places += 1
        return _CachedJobs(place, self, self._places)

    def known(self, key: str) -> tuple[Any] | None:
        """The stored result of a job as a tuple of one; None if there is none."""
        if key not in self._known:
            return None
        try:
            return (values.load(self._known[key], self._kinds),)
        except ParameterError as error:
            raise ParameterError(f"{self._path} is broken, remove it: {error}") from None

    def keep(self, key: str, result: Any) -> Any:
        """Store a result while the journal has room; returns it in the form of `known`."""
        payload = values.dump(result)
        row = {"key": key, "result": payload}
        self._size += len(json.dumps(row))
        if not self._full and self._size > LIMIT:
            log.info("%s has %d MB: further results are not kept", self._path, self._size // 10**6)
            self._full = True
        if not self._full:
            try:
                self._journal = self._journal or Journal(self._path, self._header, Row, new=True)
                self._journal.append(row)
            except OSError as error:
                log.warning("results are no longer kept for a search begun again: %s", error)
                self._full = True
        return values.load(payload, self._kinds)

    def __enter__(self) -> Memory:
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        done = kind is None or issubclass(kind, LocoError)
        if self._journal and done and not self._stays:
            self._journal.remove()
        elif self._journal:
            self._journal.close()


class _CachedJobs(Jobs):
    """Jobs with stored results, see `Memory.keeping`."""

    def __init__(self, place: Jobs, memory: Memory, number: int):
        self._place, self._memory, self._number = place, memory, number

    def outcomes(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """See `Jobs`."""
        keys, missing = [digest(self._number, job) for job in jobs], []
        for index, key in enumerate(keys):
            if result := self._memory.known(key):
                yield index, result[0]
            else:
                missing.append(index)
        for k, result in self._place.outcomes([jobs[i] for i in missing]):
            index = missing[k]
            if not isinstance(result, Failure):
                result = self._memory.keep(keys[index], result)
            yield index, result

    def close(self) -> None:
        """See `Jobs`."""
        self._place.close()
