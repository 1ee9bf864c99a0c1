# SPDX-License-Identifier: Apache-2.0
"""Arrays and plain values in one ``.npz`` file that says what it is and of which version."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, ParameterError

FORMATS = {  # kinds of file and their versions
    "weights": 1,
    "joint_weights": 1,
    "log": 1,
    "msd_gait": 1,
    "msd_loop": 1,
    "joint_log": 1,
    "case": 1,
}


def write(
    path: str | Path,
    kind: str,
    meta: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    compress: bool = False,
) -> None:
    """Write a file of a kind in `FORMATS`, whole or not at all; makes its folder."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    text = json.dumps({"kind": kind, "format": FORMATS[kind], **meta})
    try:
        with open(part, "wb") as file:  # an open file, or NumPy would append ".npz" to the name
            save: Any = np.savez_compressed if compress else np.savez
            save(file, meta=text, **arrays)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def read(path: str | Path, kind: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Plain values and arrays of a file.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is not of this kind or version.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"there is no {kind} file {path}")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        meta = json.loads(str(arrays.pop("meta")))
        found = (meta.pop("kind"), meta.pop("format"))
    except (ValueError, OSError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise ParameterError(f"{path} is not a {kind} file of loco ({error})") from error
    if found != (kind, FORMATS[kind]):
        raise ParameterError(
            f"{path} is a {found[0]} file of format {found[1]}; "
            f"wanted is a {kind} file of format {FORMATS[kind]}"
        )
    return meta, arrays
