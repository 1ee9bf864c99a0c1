# SPDX-License-Identifier: Apache-2.0
"""Parsing of all input files and texts: YAML, JSON, CSV, gzip and NPZ.

Any fault of such a text becomes a `ParameterError` that names the source, the line if known, and
the limit. Size, nesting depth and expanded aliases are bounded before any object is created, so a
small file cannot exhaust the memory or crash the process.
"""

from __future__ import annotations

import codecs
import contextlib
import csv
import functools
import gzip
import io
import json
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

from . import packed
from .exceptions import LocoError, MissingFileError, ParameterError, cut, shown
from .packed import MOST_BYTES

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "FOLDERS", "allowed", "as_text", "parse_csv", "parse_json", "parse_yaml", "read_bytes",
    "read_json", "read_npz", "read_text", "read_yaml", "shown", "understanding", "understood",
    "within",
]  # fmt: skip

F = TypeVar("F", bound=Callable[..., Any])

FOLDERS = ("bags",)  # default folders whose files network peers may name
MOST_YAML = 2 * 2**20  # largest length of a YAML text [characters]
DEEPEST = 64  # largest nesting depth of mappings and lists
MOST_NODES = 200_000  # largest number of values of a YAML text, aliases expanded

# Errors that parsers raise in addition to their own: invalid dates, numbers with too many
# digits, unhashable keys, truncated files.
_BROKEN = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError,
    MemoryError, NotImplementedError, RuntimeError, SyntaxError, EOFError, OSError,
    zlib.error, csv.Error, zipfile.BadZipFile,
)  # fmt: skip


# ---- files


def read_bytes(path: str | Path, what: str = "file", max_size: int = MOST_BYTES) -> bytes:
    """Contents of a file, decompressed if its name ends in ``.gz``.

    Args:
        path: The file.
        what: Kind of file, for messages.
        max_size: Limit of its size, before and after decompression [bytes].

    Raises:
        MissingFileError: There is no such file, or it cannot be read.
        ParameterError: It is larger than `max_size`, decompressed larger than `packed.room`, or
            named ``.gz`` without being gzip.
    """
    path = Path(path)
    try:
        # A FIFO or a device never ends.
        if not path.is_file():
            raise MissingFileError(f"there is no {what} at {path}")
        with open(path, "rb") as file:
            data = file.read(max_size + 1)
    except MissingFileError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL in it
        raise MissingFileError(f"{what} {shown(str(path))} cannot be read: {_msg(error)}") from None
    _check_size(path, len(data), max_size)
    if path.suffix.lower() == ".gz":
        max_size = min(max_size, packed.limit(len(data)))
        try:
            with gzip.open(io.BytesIO(data)) as file:
                data = file.read(max_size + 1)
        except _BROKEN as error:
            raise ParameterError(f"{path} is not a gzip file: {_msg(error)}") from None
        _check_size(path, len(data), max_size, " decompressed")
    return data


def read_text(path: str | Path, what: str = "file", max_size: int = MOST_BYTES) -> str:
    """Text of a UTF-8 file, with or without a byte order mark.

    The arguments are those of `read_bytes`.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is too large, or not UTF-8.
    """
    return as_text(read_bytes(path, what, max_size), path)


def read_yaml(path: str | Path, what: str = "file", max_size: int = MOST_YAML) -> Any:
    """Values of a YAML file; the arguments are those of `read_bytes`.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is too large, not UTF-8 or not YAML.
    """
    return parse_yaml(read_text(path, what, max_size), path, max_size)


def read_json(path: str | Path, what: str = "file", max_size: int = MOST_BYTES) -> Any:
    """Values of a JSON file; the arguments are those of `read_bytes`.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is too large, not UTF-8 or not JSON.
    """
    return parse_json(read_text(path, what, max_size), path)


def read_npz(path: str | Path, what: str = "file") -> dict[str, np.ndarray]:
    """Arrays of a NumPy archive; nothing in it is unpickled.

    Args:
        path: The file.
        what: Kind of file, for messages.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is not a NumPy archive, or unpacked larger than `packed.room`.
    """
    data = read_bytes(path, what)
    try:
        files = packed.unzip(data)
        return {name.removesuffix(".npy"): packed.array(inside) for name, inside in files.items()}
    except _BROKEN as error:
        raise ParameterError(f"{path} is not a {what}: {_msg(error)}") from None


# ---- texts


def as_text(data: bytes, source: str | Path) -> str:
    """Text of UTF-8 bytes, with or without a byte order mark, or of UTF-16 bytes with one.

    Args:
        data: The bytes.
        source: Name of the source, for messages.

    Raises:
        ParameterError: The bytes are of another encoding.
    """
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, byte = data.count(b"\n", 0, error.start) + 1, data[error.start]
        raise ParameterError(
            f"{source}, line {line}: not UTF-8 text, byte {byte:#04x} ({chr(byte)!r} in Latin-1, "
            "which iconv -f latin1 -t utf-8 converts)"
        ) from None


def parse_yaml(text: str, source: str | Path, max_size: int = MOST_YAML) -> Any:
    """Values of a YAML text: ``1e-3`` is a number, and duplicate keys are refused.

    Args:
        text: The text.
        source: Name of the source, for messages.
        max_size: Limit of its length [characters].

    Raises:
        ParameterError: The text is not YAML, or exceeds `max_size`, `DEEPEST` or `MOST_NODES`.
    """
    if len(text) > max_size:
        raise ParameterError(f"{source} has {len(text)} characters, at most {max_size} are read")
    loader = None
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}," if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        raise ParameterError(f"{source}{line} is not YAML: {_line(problem)}") from None
    except _BROKEN as error:
        raise ParameterError(f"{source} is not YAML: {_msg(error)}") from None
    finally:
        if loader is not None:
            loader.dispose()


def parse_json(text: str, source: str | Path) -> Any:
    """Values of a JSON text.

    Args:
        text: The text.
        source: Name of the source, for messages.

    Raises:
        ParameterError: The text is not JSON, or nested too deeply.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ParameterError(f"{source}, line {error.lineno}, is not JSON: {error.msg}") from None
    except RecursionError:
        raise ParameterError(f"{source} is not JSON: it is nested too deeply") from None
    except _BROKEN as error:
        raise ParameterError(f"{source} is not JSON: {_msg(error)}") from None


def parse_csv(lines: Iterable[str], source: str | Path, **format: Any) -> list[list[str]]:
    """Rows of a CSV table.

    Args:
        lines: Lines of the table.
        source: Name of the source, for messages.
        format: Arguments of `csv.reader`.

    Raises:
        ParameterError: The lines are not CSV of this format.
    """
    reader = csv.reader(lines, **format)
    rows: list[list[str]] = []
    try:
        rows.extend(reader)
    except _BROKEN as error:
        raise ParameterError(f"{source}, line {reader.line_num}: {_msg(error)}") from None
    return rows


def understood(what: str) -> Callable[[F], F]:
    """Decorator of a function that loads a file: values of a wrong type raise `ParameterError`.

    A fallback for values that the loader's own checks miss, such as a list in place of a name.
    The first argument of the function is the name or path of the file.

    Args:
        what: Kind of file, for messages.
    """

    def decorate(load: F) -> F:
        @functools.wraps(load)
        def checked(source: Any, *arguments: Any, **kwargs: Any) -> Any:
            with understanding(source, what):
                return load(source, *arguments, **kwargs)

        return checked  # type: ignore[return-value]

    return decorate


@contextlib.contextmanager
def understanding(source: Any, what: str) -> Iterator[None]:
    """Context in which values of a wrong type raise `ParameterError`; see `understood`.

    Raises:
        ParameterError: A value has a wrong type.
    """
    try:
        yield
    except LocoError:
        raise
    except _BROKEN as error:
        raise ParameterError(f"{shown(str(source), 200)} is not a {what}: {_msg(error)}") from error


# ---- names


def within(folder: str | Path, name: str, what: str = "name") -> Path:
    """Path of a file in a folder, for a name from untrusted input.

    Args:
        folder: The folder.
        name: A name from a file or a message: a single path component.
        what: Kind of the named object, for messages.

    Raises:
        ParameterError: The name would lead out of the folder, or is not legal for a file.
    """
    is_invalid = name in ("", ".", "..") or any(c in "/\\" or not c.isprintable() for c in name)
    if is_invalid or len(name.encode("utf-8", "replace")) > 200:
        raise ParameterError(
            f"{what} must be a plain file name of at most 200 bytes, without / and \\, "
            f"got {shown(name)}"
        )
    return Path(folder) / name


def allowed(path: str | Path, folders: Iterable[str | Path], what: str = "file") -> Path:
    """Path requested over the network, checked to lie below one of the allowed folders.

    Paths outside the folders are not accessed, so the answer does not reveal which files exist.

    Args:
        path: The path.
        folders: Folders whose files may be read; if empty, no file may be read.
        what: Kind of file, for messages.

    Raises:
        ParameterError: The path leads elsewhere, also by way of ``..`` or a link.
    """
    try:
        real = Path(path).resolve()
        if any(real.is_relative_to(Path(folder).resolve()) for folder in filter(None, folders)):
            return real
    except (OSError, ValueError, RuntimeError):  # a NUL, too long, links in a circle
        pass
    raise ParameterError(
        f"{what} {shown(str(path))} is not below {' or '.join(map(str, folders)) or 'any folder'}; "
        "the parameter folders of the node names those that may be read"
    )


# ---- extensions of PyYAML


class _Loader(yaml.SafeLoader):
    """Safe YAML loader with limits, which reads 1e-3 as a number and refuses duplicate keys."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._depth += 1
        if self._depth > DEEPEST:
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(
                None, None, f"nested more than {DEEPEST} levels deep", mark
            )
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _expanded(node, 1, {})
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except yaml.YAMLError:
            raise
        except _BROKEN:
            kind, value = node.tag.rpartition(":")[2], getattr(node, "value", "")
            problem = f"{shown(value) if isinstance(value, str) else 'a value'} is no {kind}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None

    def construct_mapping(self, node: Any, deep: bool = False) -> dict:
        keys = set()
        for key, _ in getattr(node, "value", ()):
            if isinstance(key, yaml.ScalarNode) and key.value != "<<":
                if key.value in keys:
                    problem = f"{shown(key.value)} is given twice"
                    raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
                keys.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


def _expanded(node: Any, depth: int, sizes: dict[int, tuple[int, int]]) -> tuple[int, int]:
    """Number of values and depth of a YAML node with its aliases expanded.

    Raises:
        ComposerError: There are more than `MOST_NODES` values, or an alias contains itself.
    """
    if id(node) in sizes:
        return sizes[id(node)]
    count, height = 1, 1
    if not isinstance(node, yaml.ScalarNode):
        pairs = isinstance(node, yaml.MappingNode)
        for child in (c for item in node.value for c in (item if pairs else (item,))):
            if depth >= DEEPEST:  # an alias that contains itself never ends
                problem = f"nested more than {DEEPEST} levels deep with its aliases"
                raise yaml.composer.ComposerError(None, None, problem, child.start_mark)
            n_values, deeper = _expanded(child, depth + 1, sizes)
            count, height = count + n_values, max(height, deeper + 1)
            if count > MOST_NODES or depth + height > DEEPEST + 1:
                problem = f"more than {MOST_NODES} values, or {DEEPEST} levels, with its aliases"
                raise yaml.composer.ComposerError(None, None, problem, child.start_mark)
    sizes[id(node)] = count, height
    return count, height


def _check_size(path: str | Path, size: int, max_size: int, how: str = "") -> None:
    if size > max_size:
        raise ParameterError(
            f"{path} is larger than {max_size / 2**20:g} MiB{how}, which is the limit"
        )


def _msg(error: BaseException) -> str:
    """Reason of an error, in one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, gzip.BadGzipFile):  # its message quotes the file
        return "it does not begin as one, or its checksum is wrong"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    return _line(error) or type(error).__name__


def _line(value: Any) -> str:
    return cut(" ".join(str(value).split()))
