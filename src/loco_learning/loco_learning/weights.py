# SPDX-License-Identifier: Apache-2.0
"""Trained networks in one ``.npz`` file, with configuration and seed inside."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict, to_dict

from . import archive
from .params import LearnerParams

if TYPE_CHECKING:
    from .reflex import ReflexNetwork

# Must agree to reuse weights:
SHAPING = ("memory", "neurons", "activation", "scaling", "window", "bias_input")
TRAINED = ("hidden", "readout", "scaling")  # what training makes; the rest is running state


def save(network: ReflexNetwork, path: str | Path) -> None:
    """Write a network to `path`; the running state goes in, so that it can be resumed."""
    meta = {"learner": to_dict(network.params), "dt": network.dt, "seed": network.seed}
    arrays = {
        f"{part}.{name}": value
        for part, owner in network.parts().items()
        for name, value in owner.state().items()
    }
    archive.write(path, "weights", meta, arrays)


def load(cls: type[ReflexNetwork], path: str | Path) -> ReflexNetwork:
    """Network from `path` with its running state."""
    meta, arrays = archive.read(path, "weights")
    learner = from_dict(LearnerParams, {**meta["learner"], "weights": ""})
    network = cls(learner, meta["dt"], meta["seed"])
    network.params = learner.replace(weights=meta["learner"]["weights"])
    _copy(network, arrays, tuple(network.parts()), path)
    return network


def restore_weights(network: ReflexNetwork, path: str | Path) -> None:
    """Put the trained weights of `path` into a network of the same shape."""
    meta, arrays = archive.read(path, "weights")
    for key in SHAPING:
        wanted, found = getattr(network.params, key), meta["learner"].get(key)
        if wanted != found:
            raise ParameterError(
                f"learner.{key} is {wanted!r}, but the weights in {path} have {found!r}"
            )
    _copy(network, arrays, TRAINED, path)


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
