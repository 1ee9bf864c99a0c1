# SPDX-License-Identifier: Apache-2.0
"""Trained networks in one ``.npz`` file, with configuration and seed inside."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.params import from_dict, to_dict

from .params import LearnerParams

if TYPE_CHECKING:
    from .reflex import ReflexNetwork

FORMAT = 1
SHAPING = ("memory", "neurons", "activation", "scaling", "window")  # must agree to reuse weights
TRAINED = ("hidden", "readout", "scaling")  # what training makes; the rest is running state


def save(network: ReflexNetwork, path: str | Path) -> None:
    """Write a network to `path`; the running state goes in, so that it can be resumed."""
    meta = {
        "format": FORMAT,
        "learner": to_dict(network.params),
        "dt": network.dt,
        "seed": network.seed,
    }
    arrays = {
        f"{part}.{name}": value
        for part, owner in network.parts().items()
        for name, value in owner.state().items()
    }
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:  # an open file, or NumPy would append ".npz" to the name
        np.savez(file, meta=json.dumps(meta), **arrays)


def load(cls: type[ReflexNetwork], path: str | Path) -> ReflexNetwork:
    """Network from `path` with its running state."""
    meta, arrays = read(path)
    learner = from_dict(LearnerParams, {**meta["learner"], "weights": ""})
    network = cls(learner, meta["dt"], meta["seed"])
    network.params = learner.replace(weights=meta["learner"]["weights"])
    _copy(network, arrays, tuple(network.parts()), path)
    return network


def restore_weights(network: ReflexNetwork, path: str | Path) -> None:
    """Put the trained weights of `path` into a network of the same shape."""
    meta, arrays = read(path)
    for key in SHAPING:
        wanted, found = getattr(network.params, key), meta["learner"].get(key)
        if wanted != found:
            raise ParameterError(
                f"learner.{key} is {wanted!r}, but the weights in {path} have {found!r}"
            )
    _copy(network, arrays, TRAINED, path)


def read(path: str | Path) -> tuple[dict, dict[str, np.ndarray]]:
    """Configuration and arrays of a weight file.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is not a weight file of this format.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"no weight file {path}")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        meta = json.loads(str(arrays.pop("meta")))
        version = meta["format"]
    except (ValueError, OSError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise ParameterError(f"{path} is not a weight file ({error})") from error
    if version != FORMAT:
        raise ParameterError(f"{path} has weight format {version!r}, this version reads {FORMAT}")
    return meta, arrays


def _copy(
    network: ReflexNetwork, arrays: dict[str, np.ndarray], parts: tuple[str, ...], path: str | Path
) -> None:
    for part in parts:
        for name, value in network.parts()[part].state().items():
            found = arrays.get(f"{part}.{name}")
            if found is None or found.shape != value.shape:
                shape = "nothing" if found is None else f"shape {found.shape}"
                raise ParameterError(f"{path} holds {shape} for {part}.{name}, not {value.shape}")
            value[...] = found
    network.refresh()
