# SPDX-License-Identifier: Apache-2.0
"""Binary tables: ``.pt`` of torch (PACE), ``.parquet`` (LeRobot), ``.npz`` of NumPy, ``.mat``.

A ``.pt`` is a zip of tensors with a pickle that describes them. It is not unpickled: the few
commands that describe tensors are interpreted here, each once and without torch; any other command
is an error. A ``.parquet`` is read by pyarrow in a process with bounded memory and time.
"""

from __future__ import annotations

import collections
import contextlib
import functools
import importlib
import importlib.util
import io
import pickletools
import resource
import struct
import zlib
from collections.abc import Iterable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loco_control import packed
from loco_control.exceptions import MissingPackageError, ParameterError
from loco_control.reading import read_bytes, read_json, understood

from ...jobs.process import spawn

MOST_COLUMNS = 10_000  # columns of one file
STORAGES = {
    "FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8",
    "IntStorage": "<i4", "ShortStorage": "<i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "?",
}  # fmt: skip
INFO = Path("meta") / "info.json"
EPISODE = "episode_index"

_COMPRESSED = 15  # type of a compressed variable in a .mat
_TUPLES = {"EMPTY_TUPLE": 0, "TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
_VALUES = {
    "BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE",
    "NONE", "NEWTRUE", "NEWFALSE",
}  # fmt: skip
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_REBUILD = "torch._utils _rebuild_tensor_v2"
_ORDERED = "collections OrderedDict"

_READER_MEMORY = 2 * 2**30  # address space of the parquet reader, in addition to the file's size
_READER_TIME = 20  # processor time for one file, and again for each 100 MB of it [s]


class _Name(str):
    """Module and name of a class or function in the pickle, which is not imported."""


class _Storage(NamedTuple):
    """Location and type of the numbers of a tensor in the zip."""

    key: str
    kind: str


class _Tensors:
    """Interpreter for the pickle commands of tensors, in time linear in their number.

    Args:
        files: Contents of the zip, by name.
        root: Folder in it.
    """

    def __init__(self, files: dict[str, bytes], root: str):
        self._files, self._root = files, root
        self._stack: list[Any] = []
        self._marks: list[int] = []
        self._memo: dict[int, Any] = {}

    def read(self, commands: bytes) -> Any:
        """Value that the commands of a pickle build.

        Raises:
            ValueError: A command is not needed for a dictionary of tensors.
        """
        for code, argument, _ in pickletools.genops(commands):
            if code.name == "STOP":
                return self._stack.pop()
            self._follow(code.name, argument)
        raise ValueError("it does not end")

    def _follow(self, command: str, argument: Any) -> None:
        stack = self._stack
        if command in _VALUES:
            stack.append(_CONSTANTS.get(command, argument))
        elif command in _TUPLES:
            stack.append(tuple(self._last(_TUPLES[command])))
        elif command == "TUPLE":
            stack.append(tuple(self._marked()))
        elif command in ("EMPTY_DICT", "EMPTY_LIST"):
            stack.append({} if command == "EMPTY_DICT" else [])
        elif command == "MARK":
            self._marks.append(len(stack))
        elif command in ("BINPUT", "LONG_BINPUT", "MEMOIZE"):
            self._memo[len(self._memo) if argument is None else argument] = stack[-1]
        elif command in ("BINGET", "LONG_BINGET"):
            stack.append(self._memo[argument])
        elif command in ("APPEND", "APPENDS"):
            items = self._last(1) if command == "APPEND" else self._marked()
            stack[-1].extend(items)
        elif command in ("SETITEM", "SETITEMS"):
            items = self._last(2) if command == "SETITEM" else self._marked()
            if not all(isinstance(key, str) for key in items[::2]):  # others may be slow to hash
                raise ValueError("a key is no text")
            stack[-1].update(zip(items[::2], items[1::2], strict=True))
        elif command not in ("PROTO", "FRAME"):
            self._call(command, argument)

    def _call(self, command: str, argument: Any) -> None:
        """Interpret a command that names, or calls, a Python object."""
        stack = self._stack
        if command == "GLOBAL":
            stack.append(_Name(argument))
        elif command == "STACK_GLOBAL":
            stack.append(_Name(" ".join(map(str, self._last(2)))))
        elif command == "BINPERSID":
            stack.append(_storage(stack.pop()))
        elif command == "BUILD":  # attributes of a dictionary, which are not columns
            stack.pop()
        elif command == "REDUCE":
            function, values = self._last(2)
            if function == _ORDERED and values == ():
                stack.append({})
            elif function == _REBUILD:
                stack.append(self._tensor(*values))
            else:
                raise ValueError(f"it asks for {str(function)[:80]!r}, which is no tensor")
        else:
            raise ValueError(f"it has the command {command}, which no dictionary of tensors needs")

    def _last(self, count: int) -> list[Any]:
        if count > len(self._stack):
            raise ValueError("it takes more values than there are")
        at = len(self._stack) - count
        values, self._stack[at:] = self._stack[at:], []
        return values

    def _marked(self) -> list[Any]:
        return self._last(len(self._stack) - self._marks.pop())

    def _tensor(self, storage: Any, offset: int, shape: Any, strides: Any, *_: Any) -> np.ndarray:
        buffer = np.frombuffer(self._files[f"{self._root}/data/{storage.key}"], storage.kind)
        last = offset + sum((n - 1) * s for n, s in zip(shape, strides, strict=True))
        if min((offset, *shape, *strides)) < 0 or (0 not in shape and last >= len(buffer)):
            raise ValueError(f"a tensor of shape {shape} reaches beyond its {len(buffer)} numbers")
        step = tuple(s * buffer.itemsize for s in strides)
        return np.lib.stride_tricks.as_strided(buffer[offset:], shape, step, writeable=False)


def _storage(place: Any) -> _Storage:
    """Location of the numbers of a tensor."""
    tag, kind, key, *_ = place
    module, _, name = str(kind).partition(" ")
    if tag != "storage" or module != "torch" or name not in STORAGES:
        raise ValueError("its numbers are of a kind that is not known")
    return _Storage(str(key), STORAGES[name])


def torch_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of a dictionary of tensors: ``time``, ``dof_pos[0]``, ``dof_pos[1]``, ...

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is not a dictionary of tensors from `torch.save`.
    """
    data = read_bytes(path, "recording")
    try:
        files = packed.unzip(data)
        inside = next(name for name in files if name.endswith("/data.pkl"))
        content = _Tensors(files, inside.rpartition("/")[0]).read(files[inside])
        if not isinstance(content, dict):
            raise ValueError("it must hold a dictionary of tensors by name")
        columns = {k: v for k, v in content.items() if isinstance(v, np.ndarray) and v.ndim}
        packed.check_room(sum(8 * values.size for values in columns.values()), len(data))
    except Exception as error:  # noqa: BLE001  (malformed commands raise any type)
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ParameterError(
            f"{path.name} is no file of tensors that torch.save wrote: {reason}"
        ) from None
    return expand(path, columns)


def expand(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """One column per number of a row, (T,): ``name``, or ``name[0]``, ``name[1]``, ...

    Raises:
        ParameterError: Columns have different lengths, or more than two dimensions.
    """
    if len({len(values) for values in columns.values()}) > 1:
        sizes = ", ".join(f"{name} {len(values)}" for name, values in columns.items())
        raise ParameterError(f"{path.name}: its columns have different lengths ({sizes})")
    count = sum(values.shape[1] if values.ndim > 1 else 1 for values in columns.values())
    if count > MOST_COLUMNS:
        raise ParameterError(f"{path.name} has {count} columns, at most {MOST_COLUMNS} are read")
    result: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        if values.ndim > 2:
            raise ParameterError(f"{path.name}: {name} has the shape {values.shape}, wanted (T, n)")
        if values.ndim == 1:
            result[name] = values.astype(float)
        else:
            result |= {f"{name}[{i}]": values[:, i].astype(float) for i in range(values.shape[1])}
    return result


def numpy_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of the arrays that ``numpy.savez`` wrote.

    Raises:
        ParameterError: The file has no arrays of numbers of one length.
    """
    files = packed.unzip(read_bytes(path, "recording"))
    return _series(path, {k.removesuffix(".npy"): packed.array(v) for k, v in files.items()})


def matlab_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of the arrays of MATLAB's ``save``, up to version 7; fields of a struct by dots.

    Raises:
        ParameterError: The file is of version 7.3, or has no arrays of numbers of one length.
    """
    data = read_bytes(path, "recording")
    if b"MATLAB 7.3" in data[:128]:
        raise ParameterError(f"{path.name} is of version 7.3; save it with -v7, or as a table")
    _check_packed(data)
    try:
        fields = importlib.import_module("scipy.io").loadmat(io.BytesIO(data), simplify_cells=True)
    except Exception as error:  # noqa: BLE001  (malformed bytes raise any type)
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise ParameterError(f"{path.name} is no file that MATLAB saved: {reason}") from None
    return _series(path, dict(_nested(fields)))


def _check_packed(data: bytes) -> None:
    """Raise an error if the compressed variables of a ``.mat`` are too large unpacked."""
    order, at, filled = "<" if data[126:128] == b"IM" else ">", 128, 0
    while data.startswith(b"MATLAB") and at + 8 <= len(data):
        kind, size = struct.unpack(f"{order}II", data[at : at + 8])
        if kind == _COMPRESSED:
            part, rest = data[at + 8 : at + 8 + size], packed.limit(len(data)) - filled + 1
            filled += len(zlib.decompressobj().decompress(part, rest))
            packed.check_room(filled, len(data))
        at += 8 + size


def _nested(fields: dict[str, Any], at: str = "") -> Iterable[tuple[str, np.ndarray]]:
    """Arrays in nested fields, with their path."""
    for name, value in fields.items():
        if isinstance(value, dict):
            yield from _nested(value, f"{at}{name}.")
        elif isinstance(value, np.ndarray):
            yield f"{at}{name}", value


def _series(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of the arrays over time; those of another length are constants and left out."""
    numbers = {k: v.squeeze() for k, v in arrays.items() if v.dtype.kind in "fiub" and v.size > 1}
    lengths = collections.Counter(v.size for v in numbers.values() if v.ndim == 1)
    lengths = lengths or collections.Counter(max(v.shape) for v in numbers.values() if v.ndim == 2)
    if not lengths:
        raise ParameterError(f"{path.name} has no array of numbers over time")
    length = max(lengths, key=lambda size: (lengths[size], size))
    upright = {k: v.T if v.ndim == 2 and len(v) != length else v for k, v in numbers.items()}
    return expand(path, {k: v for k, v in upright.items() if v.ndim <= 2 and len(v) == length})


def parquet_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of numbers and of lists of numbers; those of LeRobot with the names of its motors.

    Raises:
        MissingPackageError: pyarrow is not installed.
        ParameterError: The file is not a parquet file, or lists differ in length.
    """
    data = read_bytes(path, "recording")
    if importlib.util.find_spec("pyarrow") is None:
        raise MissingPackageError(
            f"{path.name} needs pyarrow, which comes with `./loco install lerobot`"
        ) from None
    columns = _read_isolated(data)
    if isinstance(columns, str):
        raise ParameterError(f"{path.name} is not a parquet file of numbers: {columns}")
    return _named(path, expand(path, columns))


def _read_isolated(data: bytes) -> dict[str, np.ndarray] | str:
    """Columns of a parquet file, read in another process, or an error message."""
    pipe = _reader()
    try:
        pipe.send_bytes(data)
        return pipe.recv()
    except (EOFError, OSError):
        _reader.cache_clear()
        return "reading it ends the process that reads it, or takes too long"


@functools.cache
def _reader() -> Connection:
    """Pipe to a process that reads parquet files until this process ends."""
    return spawn(_read_files)[1]


def _read_files(pipe: Connection) -> None:
    """Read the files that arrive on a pipe, with bounded memory and time for each."""
    with contextlib.suppress(EOFError, OSError):
        while True:
            data = pipe.recv_bytes()
            used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            _limit(resource.RLIMIT_CPU, used + _READER_TIME * (1 + len(data) / 1e8))
            _limit(resource.RLIMIT_AS, _READER_MEMORY + packed.limit(len(data)) + 2 * len(data))
            pipe.send(_read_parquet(data))


def _limit(what: int, maximum: float) -> None:
    """Lower a resource limit of this process; existing lower limits stay."""
    _, hard = resource.getrlimit(what)
    limit = int(maximum) + 1
    resource.setrlimit(what, (limit if hard == -1 else min(limit, hard), hard))


def _read_parquet(data: bytes) -> dict[str, np.ndarray] | str:
    """Columns (T,) or (T, n) of a parquet file, or an error message of one line."""
    try:
        arrow = _arrow()
        arrow.set_memory_pool(arrow.system_memory_pool())  # other pools reserve more memory
        file, columns, filled = _arrow(".parquet").ParquetFile(io.BytesIO(data)), {}, 0
        for field in file.schema_arrow:
            inside = _inside(field.type)
            if _is_number(inside or field.type):
                column = file.read([field.name], use_threads=False).column(field.name)
                filled += 8 * len(column) if inside is None else column.nbytes
                packed.check_room(filled, len(data))
                columns[field.name] = _values(field.name, column.combine_chunks(), inside)
    except Exception as error:  # noqa: BLE001  (the reader raises any type for a broken file)
        return " ".join(str(error).split())[:120] or type(error).__name__
    return columns


def _arrow(part: str = "") -> Any:
    """A module of the optional package pyarrow."""
    return importlib.import_module(f"pyarrow{part}")


def _inside(kind: Any) -> Any:
    """Type of the values of a list type; None for other types."""
    types = _arrow(".types")
    lists = types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)
    return kind.value_type if lists else None


def _is_number(kind: Any) -> bool:
    types = _arrow(".types")
    return types.is_boolean(kind) or types.is_integer(kind) or types.is_floating(kind)


def _values(name: str, column: Any, inside: Any) -> np.ndarray:
    """Column of numbers (T,), or of lists of equal length (T, n); NaN for missing values."""
    compute = _arrow(".compute")
    elements = column if inside is None else compute.list_flatten(column)
    numbers = elements.cast(_arrow().float64(), safe=False).to_numpy(zero_copy_only=False)
    if inside is None:
        return numbers
    sizes = compute.unique(compute.list_value_length(column))
    if len(sizes) != 1 or not sizes[0].is_valid:
        raise ValueError(f"lists of {name} differ in length")
    return numbers.reshape(len(column), -1)


def _named(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of a LeRobot dataset, named by its ``meta/info.json``."""
    info = next((p / INFO for p in path.parents[:4] if (p / INFO).is_file()), None)
    if info is None:
        return columns
    features = _features(info)
    named = {feature: _flatten(entry.get("names")) for feature, entry in features.items()}
    labels = {
        f"{feature}[{i}]": f"{feature}[{name}]"
        for feature, names in named.items()
        for i, name in enumerate(names)
    }
    return {labels.get(name, name): values for name, values in columns.items()}


@understood("description of a LeRobot dataset")
def _features(info: Path) -> dict[str, dict[str, Any]]:
    """Features of a LeRobot dataset."""
    features = read_json(info, "description")["features"]
    return {str(feature): dict(entry) for feature, entry in features.items()}


def _flatten(names: Any) -> list[str]:
    """Names of the numbers of a feature: a list, or a mapping of lists such as ``motors``."""
    if isinstance(names, dict):
        names = [name for group in names.values() for name in _as_list(group)]
    return [str(name) for name in _as_list(names)]


def _as_list(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list) else []
