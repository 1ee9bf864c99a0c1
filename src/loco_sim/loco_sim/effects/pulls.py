# SPDX-License-Identifier: Apache-2.0
"""Forces from outside on points of links, as data for the compiled loop of a bolted robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .base import Effect, overrides, span
from .rows import NEVER

CONSTANTS = 11  # point, force, anchor (3 each), stiffness, length


class Pull(NamedTuple):
    """A force that does not change, and a cable that pulls towards an anchor when it is taut."""

    link: str  # that it acts on
    point: Sequence[float]  # where, link frame [m]
    force: Sequence[float] = (0.0, 0.0, 0.0)  # world frame [N]
    anchor: Sequence[float] = (0.0, 0.0, 0.0)  # of the cable, world frame [m]
    stiffness: float = 0.0  # of the cable [N/m]
    length: float = 0.0  # at which it becomes taut [m]


class Pulls(NamedTuple):
    """Arrays that `tree_kernels.pulled` runs over: k pulls."""

    body: np.ndarray  # joint of the tree whose body is pulled, -1 is the base, (k,)
    window: np.ndarray  # first step, and the one after the last, (k, 2)
    const: np.ndarray  # point in the frame of that body, then as in `Pull`, (k, CONSTANTS)


def of(effects: Sequence[Effect]) -> list[tuple[Effect, Pull | None]]:
    """Effects that act on the world, each with the one force that it is; None if it is more."""
    acting = (e for e in effects if overrides(e, "on_step") and not e.absent())
    return [(effect, effect.pull()) for effect in acting]


def laid_out(
    effects: Sequence[Effect], frames: Mapping[str, Any], height: float, dt: float
) -> Pulls:
    """Pulls of configured effects.

    Args:
        effects: Effects on a robot whose base is bolted, all of `of` with a pull.
        frames: Frames of its links, from `tree.build`.
        height: Height of its base, from which the loop counts [m].
        dt: Physics step [s].
    """
    found = of(effects)
    body, window = np.zeros(len(found), np.int64), np.zeros((len(found), 2), np.int64)
    const = np.zeros((len(found), CONSTANTS))
    for k, (effect, pull) in enumerate(found):
        body[k], place, turn = frames[pull.link]
        first, last = span(effect, dt)
        window[k] = first, min(last, NEVER)
        anchor = np.array(pull.anchor) - (0.0, 0.0, height)
        point = place + turn @ np.array(pull.point)
        const[k] = *point, *pull.force, *anchor, pull.stiffness, pull.length
    return Pulls(body, window, const)
