# SPDX-License-Identifier: Apache-2.0
"""Saves trained weights from a node that has to go on, whatever the disk says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from loco_control.ros.node import LocoNode


def save_weights(node: LocoNode, network: Any, path: str, tick: int, t: float) -> None:
    """Save; a full disk is an event, ``weights not saved``, and no reason to stop walking.

    Args:
        node: That tells of it.
        network: With a method `save`.
        path: New file.
        tick: Now.
        t: Simulated time [s].
    """
    try:
        network.save(Path(path))
    except OSError as error:
        node.event("weights not saved", f"{path}: {error.strerror or error}", tick, t)
