# SPDX-License-Identifier: Apache-2.0
"""External forces on points of links, as arrays for the compiled loop of a fixed-base robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .base import Effect, overrides, span
from .rows import MAX_INT

CONSTANTS = 11  # point, force, anchor (3 each), stiffness, length


class Pull(NamedTuple):
    """A constant force and a cable that pulls towards an anchor when taut, on a point."""

    link: str  # link that it acts on
    point: Sequence[float]  # point of application, link frame [m]
    force: Sequence[float] = (0.0, 0.0, 0.0)  # world frame [N]
    anchor: Sequence[float] = (0.0, 0.0, 0.0)  # fixed end of the cable, world frame [m]
    stiffness: float = 0.0  # stiffness of the cable [N/m]
    length: float = 0.0  # length at which the cable becomes taut [m]


class Pulls(NamedTuple):
    """Arrays of k pulls for the kernel `multibody.dynamics.pulled`."""

    body: np.ndarray  # joint of the tree whose body is pulled, -1 for the base, (k,)
    window: np.ndarray  # first step, and step after the last, (k, 2)
    const: np.ndarray  # point in the frame of that body, then the fields of `Pull`, (k, CONSTANTS)


def of(effects: Sequence[Effect]) -> list[tuple[Effect, Pull | None]]:
    """Effects that act on the world, each with its `Pull`; None if it is not a single force."""
    acting = (e for e in effects if overrides(e, "on_step") and not e.absent())
    return [(effect, effect.pull()) for effect in acting]


def laid_out(
    effects: Sequence[Effect], frames: Mapping[str, Any], height: float, dt: float
) -> Pulls:
    """Arrays of the pulls of configured effects.

    Args:
        effects: Effects on a fixed-base robot, all with a pull according to `of`.
        frames: Frames of its links, from `tree.build`.
        height: Height of its base, the origin of the loop's coordinates [m].
        dt: Physics step [s].
    """
    pairs = of(effects)
    body, window = np.zeros(len(pairs), np.int64), np.zeros((len(pairs), 2), np.int64)
    const = np.zeros((len(pairs), CONSTANTS))
    for k, (effect, pull) in enumerate(pairs):
        body[k], place, turn = frames[pull.link]
        first, last = span(effect, dt)
        window[k] = first, min(last, MAX_INT)
        anchor = np.array(pull.anchor) - (0.0, 0.0, height)
        point = place + turn @ np.array(pull.point)
        const[k] = *point, *pull.force, *anchor, pull.stiffness, pull.length
    return Pulls(body, window, const)
