# SPDX-License-Identifier: Apache-2.0
"""The one place where files and texts of others are parsed: YAML, JSON, CSV, gzip and NPZ.

Whatever is wrong with such a text becomes a `ParameterError` that names the source, the line
where there is one, and the limit. Size, depth and what aliases expand to are bounded before
anything is built, so a small file cannot fill the memory or end the process.
"""

from __future__ import annotations

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

FOLDERS = ("bags",)  # that peers may name files of, unless the operator says others
MOST_YAML = 2 * 2**20  # characters of a YAML text
DEEPEST = 64  # mappings and lists within each other
MOST_NODES = 200_000  # values of a YAML text with its aliases written out

# What the parsers raise beside their own errors: dates that are none, numbers of too many
# digits, keys that cannot be hashed, files that end early.
_BROKEN = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError,
    MemoryError, NotImplementedError, RuntimeError, SyntaxError, EOFError, OSError,
    zlib.error, csv.Error, zipfile.BadZipFile,
)  # fmt: skip


# ---- files


def read_bytes(path: str | Path, what: str = "file", max_size: int = MOST_BYTES) -> bytes:
    """Contents of a file; of one whose name ends in ``.gz``, decompressed.

    Args:
        path: The file.
        what: Kind of file, for messages.
        max_size: Limit of its size, compressed and not [bytes].

    Raises:
        MissingFileError: There is no such file, or it cannot be read.
        ParameterError: It is larger than `max_size`, decompressed larger than `packed.room`, or it is
            not gzip as its name says.
    """
    path = Path(path)
    try:
        # A FIFO or a device has no end.
        if not path.is_file():
            raise MissingFileError(f"there is no {what} at {path}")
        with open(path, "rb") as file:
            data = file.read(max_size + 1)
    except MissingFileError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL in it
        raise MissingFileError(f"{what} {shown(str(path))} cannot be read: {_why(error)}") from None
    _check_size(path, len(data), max_size)
    if path.suffix.lower() == ".gz":
        max_size = min(max_size, packed.room(len(data)))
        try:
            with gzip.open(io.BytesIO(data)) as file:
                data = file.read(max_size + 1)
        except _BROKEN as error:
            raise ParameterError(f"{path} is not a gzip file: {_why(error)}") from None
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
        ParameterError: It is not such an archive, or unpacked larger than `packed.room`.
    """
    data = read_bytes(path, what)
    try:
        files = packed.unzip(data)
        return {name.removesuffix(".npy"): packed.array(inside) for name, inside in files.items()}
    except _BROKEN as error:
        raise ParameterError(f"{path} is not a {what}: {_why(error)}") from None


# ---- texts


def as_text(data: bytes, source: str | Path) -> str:
    """Text of UTF-8 bytes, with or without a byte order mark.

    Args:
        data: The bytes.
        source: Name of the source, for messages.

    Raises:
        ParameterError: They are not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise ParameterError(
            f"{source}, line {line}: not UTF-8 text, byte {data[error.start]:#04x}"
        ) from None


def parse_yaml(text: str, source: str | Path, max_size: int = MOST_YAML) -> Any:
    """Values of a YAML text: ``1e-3`` is a number, and no key may be given twice.

    Args:
        text: The text.
        source: Name of the source, for messages.
        max_size: Limit of its length [characters].

    Raises:
        ParameterError: It is not YAML, or beyond `max_size`, `DEEPEST` or `MOST_NODES`.
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
        raise ParameterError(f"{source} is not YAML: {_why(error)}") from None
    finally:
        if loader is not None:
            loader.dispose()


def parse_json(text: str, source: str | Path) -> Any:
    """Values of a JSON text.

    Args:
        text: The text.
        source: Name of the source, for messages.

    Raises:
        ParameterError: It is not JSON, or nested too deeply.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ParameterError(f"{source}, line {error.lineno}, is not JSON: {error.msg}") from None
    except RecursionError:
        raise ParameterError(f"{source} is not JSON: it is nested too deeply") from None
    except _BROKEN as error:
        raise ParameterError(f"{source} is not JSON: {_why(error)}") from None


def parse_csv(lines: Iterable[str], source: str | Path, **format: Any) -> list[list[str]]:
    """Rows of a table.

    Args:
        lines: Lines of the table.
        source: Name of the source, for messages.
        format: Arguments of `csv.reader`.

    Raises:
        ParameterError: It is not such a table.
    """
    reader = csv.reader(lines, **format)
    rows: list[list[str]] = []
    try:
        rows.extend(reader)
    except _BROKEN as error:
        raise ParameterError(f"{source}, line {reader.line_num}: {_why(error)}") from None
    return rows


def understood(what: str) -> Callable[[F], F]:
    """Decorator of a function that loads a file: values of a wrong kind are one error of ours.

    The checks of a loader name what is wrong; this is the net below them, for a list where a name
    should be and its like. The first argument of the function is the name or path of the file.

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
    """Block in which values of a file are taken apart; see `understood`.

    Raises:
        ParameterError: A value is of a wrong kind.
    """
    try:
        yield
    except LocoError:
        raise
    except _BROKEN as error:
        raise ParameterError(f"{shown(str(source), 200)} is not a {what}: {_why(error)}") from error


# ---- names


def within(folder: str | Path, name: str, what: str = "name") -> Path:
    """Path of a name in a folder.

    Args:
        folder: The folder.
        name: A name that a file or a message gave: one component, no path.
        what: Kind of thing that the name is of, for messages.

    Raises:
        ParameterError: It would lead out of the folder, or no file can have it.
    """
    is_invalid = name in ("", ".", "..") or any(c in "/\\" or not c.isprintable() for c in name)
    if is_invalid or len(name.encode("utf-8", "replace")) > 200:
        raise ParameterError(
            f"{what} must be a plain file name of at most 200 bytes, without / and \\, "
            f"got {shown(name)}"
        )
    return Path(folder) / name


def allowed(path: str | Path, folders: Iterable[str | Path], what: str = "file") -> Path:
    """Path that somebody on the network named, if it lies below a folder of the operator's.

    Nothing outside the folders is looked at, so the answer does not tell what exists.

    Args:
        path: The path.
        folders: Folders whose files may be read; none for no file at all.
        what: Kind of file, for messages.

    Raises:
        ParameterError: It lies elsewhere, also by way of ``..`` or a link.
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


# ---- what PyYAML leaves open


class _Loader(yaml.SafeLoader):
    """Safe YAML with bounds that reads 1e-3 as a number and refuses a key given twice."""

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
    """Number of values and depth of a node with its aliases written out.

    Raises:
        ComposerError: There are more than `MOST_NODES`, or they contain themselves.
    """
    if id(node) in sizes:
        return sizes[id(node)]
    count, height = 1, 1
    if not isinstance(node, yaml.ScalarNode):
        pairs = isinstance(node, yaml.MappingNode)
        for child in (c for item in node.value for c in (item if pairs else (item,))):
            if depth >= DEEPEST:  # an alias to what holds it never ends
                problem = f"nested more than {DEEPEST} levels deep with its aliases"
                raise yaml.composer.ComposerError(None, None, problem, child.start_mark)
            more, deeper = _expanded(child, depth + 1, sizes)
            count, height = count + more, max(height, deeper + 1)
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


def _why(error: BaseException) -> str:
    """Reason of an error, in one line."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    if isinstance(error, gzip.BadGzipFile):  # its words quote the file
        return "it does not begin as one, or its checksum is wrong"
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, MemoryError):
        return "it needs more memory than there is"
    return _line(error) or type(error).__name__


def _line(value: Any) -> str:
    return cut(" ".join(str(value).split()))
