# SPDX-License-Identifier: Apache-2.0
"""Tables of others in binary form: ``.pt`` of torch (PACE) and ``.parquet`` (LeRobot).

A ``.pt`` is a zip of tensors and a pickle that says where each lies. The pickle is read with
only those names in reach that describe a tensor, so nothing in it can run, and without torch.
"""

from __future__ import annotations

import importlib
import io
import json
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import MissingPackageError, ParameterError
from loco_control.reading import read_bytes

MOST = 2**28  # numbers of a tensor, and bytes of the pickle
STORAGES = {
    "FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8",
    "IntStorage": "<i4", "ShortStorage": "<i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "?",
}  # fmt: skip
INFO = Path("meta") / "info.json"
EPISODE = "episode_index"


class _Storage(NamedTuple):
    """Numbers of a file in the zip."""

    key: str
    kind: str


class _Reader(pickle.Unpickler):
    """A pickle of tensors; any other name in it is an error."""

    def __init__(self, data: bytes, files: zipfile.ZipFile, root: str):
        super().__init__(io.BytesIO(data))
        self._files, self._root = files, root

    def find_class(self, module: str, name: str) -> Any:
        """One of the few names that a tensor needs."""
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return self._tensor
        if module == "torch" and name in STORAGES:
            return STORAGES[name]
        raise pickle.UnpicklingError(f"it asks for {module}.{name}, which is no tensor")

    def persistent_load(self, pid: Any) -> _Storage:
        """Place of the numbers of a tensor."""
        tag, kind, key, *_ = pid
        if tag != "storage" or kind not in STORAGES.values():
            raise pickle.UnpicklingError("its numbers are of a kind that is not known")
        return _Storage(str(key), kind)

    def _tensor(self, storage: Any, offset: int, shape: Any, strides: Any, *_: Any) -> np.ndarray:
        shape, strides = tuple(map(int, shape)), tuple(map(int, strides))
        name = f"{self._root}/data/{storage.key}"
        if self._files.getinfo(name).file_size > 8 * MOST or np.prod(shape, dtype=float) > MOST:
            raise ValueError(f"a tensor has the shape {shape}, more than {MOST} numbers")
        flat = np.frombuffer(self._files.read(name), storage.kind)
        last = offset + sum((n - 1) * s for n, s in zip(shape, strides, strict=True))
        if min((offset, *shape, *strides)) < 0 or (0 not in shape and last >= len(flat)):
            raise ValueError(f"a tensor of shape {shape} reaches beyond its {len(flat)} numbers")
        step = tuple(s * flat.itemsize for s in strides)
        return np.lib.stride_tricks.as_strided(flat[offset:], shape, step).copy()


def torch_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of a dictionary of tensors: ``time``, ``dof_pos[0]``, ``dof_pos[1]``, ...

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is not a dictionary of tensors that `torch.save` wrote.
    """
    data = read_bytes(path, "recording")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as files:
            inside = next(name for name in files.namelist() if name.endswith("/data.pkl"))
            if files.getinfo(inside).file_size > MOST:
                raise ValueError("its pickle is too large")
            root = inside.rpartition("/")[0]
            found = _Reader(files.read(inside), files, root).load()
    except Exception as error:  # noqa: BLE001  (a pickle that is broken raises anything)
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise ParameterError(
            f"{path.name} is no file of tensors that torch.save wrote: {why}"
        ) from None
    if not isinstance(found, dict):
        raise ParameterError(f"{path.name} must hold a dictionary of tensors by name")
    columns = {str(k): v for k, v in found.items() if isinstance(v, np.ndarray) and v.ndim}
    return spread(path, columns)


def spread(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """One column for each number of a row, (T,): ``name``, or ``name[0]``, ``name[1]``, ...

    Raises:
        ParameterError: Columns have different lengths, or more than two dimensions.
    """
    if len({len(values) for values in columns.values()}) > 1:
        sizes = ", ".join(f"{name} {len(values)}" for name, values in columns.items())
        raise ParameterError(f"{path.name}: its columns have different lengths ({sizes})")
    found: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        if values.ndim > 2:
            raise ParameterError(f"{path.name}: {name} has the shape {values.shape}, wanted (T, n)")
        if values.ndim == 1:
            found[name] = values.astype(float)
        else:
            found |= {f"{name}[{i}]": values[:, i].astype(float) for i in range(values.shape[1])}
    return found


def parquet_columns(path: Path) -> dict[str, np.ndarray]:
    """Columns of numbers and of lists of numbers; LeRobot's by the names of its motors.

    Raises:
        MissingPackageError: pyarrow is not installed.
        ParameterError: It is not a parquet file, or lists differ in length.
    """
    data = read_bytes(path, "recording")
    try:
        pq = importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError:
        raise MissingPackageError(
            f"{path.name} needs pyarrow, which comes with `pip install 'loco-gap[lerobot]'`"
        ) from None
    try:
        table = pq.read_table(io.BytesIO(data))
        lists = {name: table.column(name).to_pylist() for name in table.column_names}
    except Exception as error:  # noqa: BLE001  (the reader of a broken file raises anything)
        why = " ".join(str(error).split())[:120]
        raise ParameterError(f"{path.name} is not a parquet file: {why}") from None
    columns = {}
    for name, values in lists.items():
        try:
            columns[name] = np.array([np.nan if v is None else v for v in values], dtype=float)
        except (TypeError, ValueError):
            if values and isinstance(values[0], list):
                raise ParameterError(
                    f"{path.name}: lists of {name} differ in length, or hold no numbers"
                ) from None
    return _named(path, spread(path, columns))


def _named(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns of a LeRobot dataset with the names of its ``meta/info.json``."""
    info = next((p / INFO for p in path.parents[:4] if (p / INFO).is_file()), None)
    if info is None:
        return columns
    try:
        features = json.loads(read_bytes(info, "description"))["features"]
        named = {feature: _flat(entry.get("names")) for feature, entry in features.items()}
    except (ValueError, TypeError, KeyError, AttributeError):
        raise ParameterError(f"{info} does not describe features as LeRobot does") from None
    known = {
        f"{feature}[{i}]": f"{feature}[{name}]"
        for feature, names in named.items()
        for i, name in enumerate(names)
    }
    return {known.get(name, name): values for name, values in columns.items()}


def _flat(names: Any) -> list[str]:
    """Names of the numbers of a feature: a list, or lists under a word such as ``motors``."""
    if isinstance(names, dict):
        names = [name for group in names.values() for name in _as_list(group)]
    return [str(name) for name in _as_list(names)]


def _as_list(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list) else []
