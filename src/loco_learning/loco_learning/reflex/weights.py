# SPDX-License-Identifier: Apache-2.0
"""Weights of a reflex network in one ``.npz`` file, with configuration and seed inside."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict, to_dict

from .. import archive

if TYPE_CHECKING:
    from .network import ReflexNetwork


def save(network: ReflexNetwork, path: str | Path) -> None:
    """Write a network to `path`; the running state goes in, so that it can be resumed."""
    about = {**network.senses.about(), "dt": network.dt, "seed": network.seed}
    arrays = {
        f"{part}.{name}": value
        for part, owner in network.parts().items()
        for name, value in owner.state().items()
    }
    meta = {"learner": to_dict(network.params), **about}
    archive.write(path, network.senses.KIND, meta, arrays)


def load(cls: Any, senses: tuple[Any, ...], path: str | Path) -> Any:
    """Network of class `cls` with one of these kinds of senses, and its running state."""
    kinds = {kind.KIND: kind for kind in senses}
    meta, arrays = archive.read(path, *kinds)
    kind = kinds[meta["kind"]]
    learner = from_dict(kind.PARAMS, {**meta["learner"], "weights": ""})
    network = cls(learner, kind.remade(learner, meta), meta["dt"], meta["seed"])
    network.params = network.schedule.params = learner.replace(weights=meta["learner"]["weights"])
    _copy(network, arrays, tuple(network.parts()), path)
    return network


def restore_weights(network: ReflexNetwork, path: str | Path) -> None:
    """Put the trained weights of `path` into a network of the same shape."""
    meta, arrays = archive.read(path, network.senses.KIND)
    for key in network.senses.SHAPING:
        wanted, found = getattr(network.params, key), meta["learner"].get(key)
        if wanted != found:
            raise ParameterError(
                f"learner.{key} is {wanted!r}, but the weights in {path} have {found!r}"
            )
    _copy(network, arrays, network.senses.TRAINED, path)


def read_readout(path: str | Path, kind: str) -> np.ndarray:
    """Readout in a weight file of a kind, (N, 2k): positions, then velocities of k joints."""
    return archive.read(path, kind)[1]["readout.weights"]


def with_readout(source: str | Path, path: str | Path, kind: str, readout: np.ndarray) -> None:
    """Write the network of a weight file to `path` with another readout, (N, 2k)."""
    meta, arrays = archive.read(source, kind)
    meta["learner"] = {**meta["learner"], "weights": ""}
    archive.write(path, kind, meta, {**arrays, "readout.weights": np.array(readout, dtype=float)})


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
    if parts:
        network.refresh()
