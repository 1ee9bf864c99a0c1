# SPDX-License-Identifier: Apache-2.0
"""Jobs whose results a journal keeps: a result that is there is read, and its job is not run.

A search asks for jobs that depend on the results of others. Begun again it asks for the same
ones, for it draws nothing that is not seeded: what was done before a kill comes out of the
journal, and the search goes on to the same end.
"""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import importlib.metadata
import io
import logging
import pickle
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError, ParameterError

from .. import __version__
from .base import Failure, Jobs
from .journal import Journal

log = logging.getLogger(__name__)

_DECIDES = ("numpy", "scipy", "numba", "mujoco", "pybullet", "cma")  # the last bits of results
_NUMPY = {"_reconstruct", "scalar", "_frombuffer", "ndarray", "dtype"}


def versions() -> dict[str, str]:
    """Versions of this package and of those that decide the last bits of its results."""
    found = {"loco": __version__}
    for name in _DECIDES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def digest(*values: Any) -> str:
    """Digest of plain values, arrays, objects of such, paths and functions, 32 hexadecimal digits.

    Raises:
        TypeError: A value is none of these.
    """
    whole = hashlib.sha256()
    _feed(whole, values)
    return whole.hexdigest()[:32]


def _feed(whole: Any, value: Any) -> None:
    kind = type(value).__qualname__
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        whole.update(f"{value.dtype.str}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, Mapping):
        whole.update(f"{kind}{len(value)}".encode())
        for key, entry in value.items():
            _feed(whole, key)
            _feed(whole, entry)
    elif isinstance(value, (list, tuple)):
        whole.update(f"{kind}{len(value)}".encode())
        for entry in value:
            _feed(whole, entry)
    elif isinstance(value, (str, bytes, int, float, np.generic, Path)) or value is None:
        text = repr(value).encode()
        whole.update(f"{kind}{len(text)}".encode() + text)
    elif callable(value) and hasattr(value, "__qualname__"):
        whole.update(f"{value.__module__}.{value.__qualname__}".encode())
    elif hasattr(value, "__dict__"):
        _feed(whole, [kind, vars(value)])
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


class Memory:
    """Results of a search's jobs, in a journal that is removed when the search is done.

    A context manager: whatever ends its block but a mistake in what was given (`LocoError`) and
    success leaves the journal, for the search begun again.

    Args:
        path: The file; one of another search, or a broken one, is begun anew with a warning.
        inputs: All that decides the results, for `digest`, besides the versions of packages.
        kinds: Dataclasses of which results consist, beside arrays and plain values.
    """

    def __init__(self, path: Path, inputs: Sequence[Any], kinds: Sequence[type]):
        self._path = path
        self._header = {"kind": "search", "format": 1, "inputs": digest(*inputs)}
        self._header["versions"] = versions()
        self._journal: Journal | None = None
        self._known: dict[str, str] = {}
        self._full = False
        self._kinds = {(kind.__module__, kind.__qualname__): kind for kind in kinds}
        self._places = 0
        if path.is_file():
            self._journal = Journal(path, self._header, anew=True)
            self._known = {row["key"]: row["result"] for row in self._journal.rows}

    def keeping(self, place: Jobs) -> Jobs:
        """The same place, whose results are kept."""
        self._places += 1
        return _Kept(place, self, self._places)

    def known(self, key: str) -> tuple[Any] | None:
        """The result of a job in a tuple, if it is there."""
        text = self._known.get(key)
        return None if text is None else (self._loaded(text),)

    def keep(self, key: str, result: Any) -> Any:
        """Keep a result; returns it as `known` will give it."""
        text = base64.b64encode(pickle.dumps(result)).decode()
        if not self._full:
            try:
                self._journal = self._journal or Journal(self._path, self._header, anew=True)
                self._journal.append({"key": key, "result": text})
            except OSError as error:
                log.warning("results are no longer kept for a search begun again: %s", error)
                self._full = True
        return self._loaded(text)

    def __enter__(self) -> Memory:
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if self._journal and (kind is None or issubclass(kind, LocoError)):
            self._journal.remove()
        elif self._journal:
            self._journal.close()

    def _loaded(self, text: str) -> Any:
        return _Results(io.BytesIO(base64.b64decode(text)), self._kinds).load()


class _Results(pickle.Unpickler):
    """Makes arrays, plain values and the given dataclasses; nothing else that a file may name."""

    def __init__(self, file: io.BytesIO, kinds: Mapping[tuple[str, str], type]):
        super().__init__(file)
        self._kinds = kinds

    def find_class(self, module: str, name: str) -> Any:
        """The class of a name, if it is one of those that results consist of."""
        if (module, name) in self._kinds:
            return self._kinds[module, name]
        if module.split(".")[0] == "numpy" and name in _NUMPY:
            return super().find_class(module, name)
        raise ParameterError(f"a journal of results names {module}.{name}; remove that journal")


class _Kept(Jobs):
    """See `Memory.keeping`."""

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
