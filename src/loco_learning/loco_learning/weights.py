# SPDX-License-Identifier: Apache-2.0
"""Trained networks in one ``.npz`` file, with configuration and seed inside."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict, to_dict

from . import archive
from .schedule import Schedule


class Network(Protocol):
    """What can be saved: parts with arrays, made from parameters."""

    KIND: ClassVar[str]  # of file, in `archive.FORMATS`
    PARAMS: ClassVar[type]
    SHAPING: ClassVar[tuple[str, ...]]  # parameters that must agree to reuse weights
    TRAINED: ClassVar[tuple[str, ...]]  # parts that training makes; the rest is running state
    params: Any
    schedule: Schedule

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()`, by name."""

    def about(self) -> dict[str, Any]:
        """What a file says beside the parameters."""

    def refresh(self) -> None:
        """Recompute what is derived from the weights."""


def save(network: Network, path: str | Path) -> None:
    """Write a network to `path`; the running state goes in, so that it can be resumed."""
    meta = {"learner": to_dict(network.params), **network.about()}
    arrays = {
        f"{part}.{name}": value
        for part, owner in network.parts().items()
        for name, value in owner.state().items()
    }
    archive.write(path, network.KIND, meta, arrays)


def load(cls: Any, path: str | Path) -> Any:
    """Network of a class from `path` with its running state."""
    meta, arrays = archive.read(path, cls.KIND)
    learner = from_dict(cls.PARAMS, {**meta["learner"], "weights": ""})
    network = cls.remade(learner, meta)
    network.params = network.schedule.params = learner.replace(weights=meta["learner"]["weights"])
    _copy(network, arrays, tuple(network.parts()), path)
    return network


def restore_weights(network: Network, path: str | Path) -> None:
    """Put the trained weights of `path` into a network of the same shape."""
    meta, arrays = archive.read(path, network.KIND)
    for key in network.SHAPING:
        wanted, found = getattr(network.params, key), meta["learner"].get(key)
        if wanted != found:
            raise ParameterError(
                f"learner.{key} is {wanted!r}, but the weights in {path} have {found!r}"
            )
    _copy(network, arrays, network.TRAINED, path)


def _copy(
    network: Network, arrays: dict[str, np.ndarray], parts: tuple[str, ...], path: str | Path
) -> None:
    for part in parts:
        for name, value in network.parts()[part].state().items():
            found = arrays.get(f"{part}.{name}")
            if found is None or found.shape != value.shape:
                shape = "nothing" if found is None else f"shape {found.shape}"
                raise ParameterError(f"{path} holds {shape} for {part}.{name}, not {value.shape}")
            value[...] = found
    network.refresh()
