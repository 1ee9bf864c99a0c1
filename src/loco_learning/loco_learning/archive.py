# SPDX-License-Identifier: Apache-2.0
"""Files of arrays and plain values: one ``.npz`` with the kind and version of its content."""

from __future__ import annotations

import contextlib
import json
import numbers
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, TypedDict

import numpy as np

from loco_control.checks import Between, check_file
from loco_control.exceptions import LocoError, ParameterError
from loco_control.files import write_whole
from loco_control.reading import parse_json, read_npz, shown, understanding


class Weights(TypedDict):
    """Plain values of a weight file; those of `senses` have further ones."""

    learner: dict[str, Any]
    dt: Annotated[float, Between(1e-6, 1e3)]
    seed: Annotated[int, Between(0, 2**63 - 1)]


class JointWeights(Weights):
    """Plain values of a weight file of a joint reflex."""

    sensors: list[str]
    outputs: Annotated[int, Between(1, 1000)]


class Log(TypedDict):
    """Plain values of a simulation's log."""

    experiment: dict[str, Any]
    seed: int
    fall: Any
    wall_time: numbers.Real


class MsdGait(TypedDict):
    """Plain values of a gait of a mass-spring-damper network."""

    task: dict[str, Any]
    parameters: int
    population: int
    best: numbers.Real
    clean: numbers.Real
    speed: numbers.Real
    power: numbers.Real


class MsdLoop(TypedDict):
    """Plain values of a closed loop of a mass-spring-damper network."""

    job: dict[str, Any]
    values: dict[str, Any]


class Case(TypedDict):
    """Plain values of one run of a study."""

    name: str
    variant: str
    seed: int
    experiment: dict[str, Any]
    verdict: dict[str, Any]
    metrics: dict[str, dict[str, numbers.Real | None]]
    at: dict[str, Any]
    key: str


FORMATS: dict[str, tuple[int, Any]] = {  # kinds of file, their versions and keys
    "weights": (1, Weights),
    "joint_weights": (1, JointWeights),
    "log": (2, Log),
    "msd_gait": (1, MsdGait),
    "msd_loop": (1, MsdLoop),
    "case": (2, Case),
}


def write(
    path: str | Path,
    kind: str,
    meta: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    compress: bool = False,
) -> None:
    """Write a file of a kind in `FORMATS`, completely or not at all; creates its folder."""
    text = json.dumps({"kind": kind, "format": FORMATS[kind][0], **meta})
    save: Any = np.savez_compressed if compress else np.savez
    write_whole(path, lambda file: save(file, meta=text, **arrays))


def read(path: str | Path, *permitted: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Plain values and arrays of a file; of several permitted kinds, the actual one is in "kind".

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The kind or version is another one, or a value is invalid.
    """
    kind = permitted[0]
    arrays = read_npz(path, f"{kind} file of loco")
    meta = parse_json(str(arrays.pop("meta", "")), path)
    if not isinstance(meta, dict):
        raise ParameterError(f"{path} is not a {kind} file of loco (its meta is no mapping)")
    stored = (meta.get("kind"), meta.pop("format", None))
    if stored not in [(kind, FORMATS[kind][0]) for kind in permitted]:
        raise ParameterError(
            f"{path} is a {str(stored[0])[:40]} file of format {shown(stored[1])}; "
            f"wanted is a {kind} file of format {FORMATS[kind][0]}"
        )
    check_file(meta, FORMATS[meta["kind"]][1], path)
    if len(permitted) == 1:
        meta.pop("kind")
    return meta, arrays


@contextlib.contextmanager
def reading(
    path: str | Path, *permitted: str
) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Context manager of `read`, for a block that builds objects from the values.

    Raises:
        LocoError: See `read`.
        ParameterError: The block fails on the values; the message names the file.
    """
    values = read(path, *permitted)
    try:
        with understanding(path, f"{permitted[0]} file of loco"):
            yield values
    except LocoError as error:
        named = str(path) in str(error)
        raise error if named else ParameterError(f"{path}: {error}") from None
