# SPDX-License-Identifier: Apache-2.0
"""Files of reflex network weights (``.npz``), which include configuration and seed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict, to_dict
from loco_control.reading import shown

from .. import archive

if TYPE_CHECKING:
    from .network import ReflexNetwork


def save(network: ReflexNetwork, path: str | Path) -> None:
    """Write a network to `path`, including its running state, so that it can be resumed."""
    about = {**network.senses.about(), "dt": network.dt, "seed": network.seed}
    arrays = {
        f"{part}.{name}": value
        for part, owner in network.parts().items()
        for name, value in owner.state().items()
    }
    meta = {"learner": to_dict(network.params), **about}
    archive.write(path, network.senses.KIND, meta, arrays)


def load(cls: Any, senses: tuple[Any, ...], path: str | Path) -> Any:
    """Network of class `cls` with one of these kinds of sensors, and its running state."""
    by_kind = {kind.KIND: kind for kind in senses}
    with archive.reading(path, *by_kind) as (meta, arrays):
        kind = by_kind[meta["kind"]]
        params = from_dict(kind.PARAMS, meta["learner"])
        learner = params.replace(weights="")
        felt = kind.remade(learner, meta)
        if learner.enabled or learner.phases_when_off:  # before memory of this size is allocated
            shape = (felt.size * learner.memory, learner.neurons)
            _part(arrays, "hidden.weights", shape, path)
            _part(arrays, "readout.weights", (learner.neurons, 2 * len(felt.outputs)), path)
            _part(arrays, "readout.p", (learner.neurons, learner.neurons), path)
        network = cls(learner, felt, meta["dt"], meta["seed"])
        network.params = network.schedule.params = params
        _copy(network, arrays, tuple(network.parts()), path)
    return network


def restore_weights(network: ReflexNetwork, path: str | Path) -> None:
    """Copy the trained weights of `path` to a network of the same shape."""
    meta, arrays = archive.read(path, network.senses.KIND)
    for key in network.senses.SHAPING:
        expected, stored = getattr(network.params, key), meta["learner"].get(key)
        if expected != stored:
            raise ParameterError(
                f"learner.{key} is {expected!r}, but the weights in {path} have {stored!r}"
            )
    _copy(network, arrays, network.senses.TRAINED, path)


def read_readout(path: str | Path, kind: str) -> np.ndarray:
    """Readout in a weight file of a kind, (N, 2k): positions, then velocities of k joints."""
    with archive.reading(path, kind) as (_, arrays):
        readout = arrays["readout.weights"]
        return _part(arrays, "readout.weights", (len(readout), readout.shape[1]), path)


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
            value[...] = _part(arrays, f"{part}.{name}", value.shape, path, value.dtype.kind)
    if parts:
        network.refresh()


def _part(
    arrays: dict[str, np.ndarray], name: str, shape: tuple, path: str | Path, kind: str = "f"
) -> np.ndarray:
    """An array of a file with the given shape and kind, without NaN; counts are not negative.

    Raises:
        ParameterError: The file has no such array.
    """
    array = arrays.get(name)
    if array is None or array.shape != shape:
        holds = "nothing" if array is None else f"shape {shown(array.shape)}"
        raise ParameterError(f"{path} holds {holds} for {name}, not {shape}")
    if array.dtype.kind != kind or np.isnan(array).any() or (kind == "i" and (array < 0).any()):
        raise ParameterError(f"{path} holds {array.dtype} for {name}, with NaN or of a wrong kind")
    return array
