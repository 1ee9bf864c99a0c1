# SPDX-License-Identifier: Apache-2.0
"""Arrays and plain values in one ``.npz`` file that says what it is and of which version."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_control.reading import parse_json, read_npz

FORMATS = {  # kinds of file and their versions
    "weights": 1,
    "joint_weights": 1,
    "log": 2,
    "msd_gait": 1,
    "msd_loop": 1,
    "case": 2,
}


def write(
    path: str | Path,
    kind: str,
    meta: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    compress: bool = False,
) -> None:
    """Write a file of a kind in `FORMATS`, whole or not at all; makes its folder."""
    text = json.dumps({"kind": kind, "format": FORMATS[kind], **meta})
    save: Any = np.savez_compressed if compress else np.savez
    write_whole(path, lambda file: save(file, meta=text, **arrays))


def read(path: str | Path, *kinds: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Plain values and arrays of a file of one of these kinds; which one is under "kind".

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is of none of these kinds, or of another version.
    """
    kind = kinds[0]
    arrays = read_npz(path, f"{kind} file of loco")
    meta = parse_json(str(arrays.pop("meta", "")), path)
    if not isinstance(meta, dict):
        raise ParameterError(f"{path} is not a {kind} file of loco (its meta is no mapping)")
    found = (meta.get("kind"), meta.pop("format", None))
    if len(kinds) == 1:
        meta.pop("kind", None)
    if found not in [(kind, FORMATS[kind]) for kind in kinds]:
        raise ParameterError(
            f"{path} is a {found[0]} file of format {found[1]}; "
            f"wanted is a {kind} file of format {FORMATS[kind]}"
        )
    return meta, arrays
