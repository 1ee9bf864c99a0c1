# SPDX-License-Identifier: Apache-2.0
"""Forces from outside on the trunk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from loco_control.params import parameter

from .base import Effect

if TYPE_CHECKING:
    from ..world import World


@dataclass
class Push(Effect, name="push"):
    """A constant force, plus one that jumps at random, on a point of the base.

    The random force is uniform in +-`random` on each axis and is drawn anew after a
    uniform time between `shortest` and `longest`.
    Source: the random force is that of the author's simulation (hyq_ml, hyq/physics.py), where
    a new draw every 25 to 250 control periods replaces the one before.
    """

    force: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "force, world frame", "N")
    point: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "where, base frame", "m")
    random: float = parameter(0.0, "amplitude of the random force on each axis", "N", low=0.0)
    shortest: float = parameter(0.1, "shortest time between two draws", "s", low=0.0)
    longest: float = parameter(1.0, "longest time between two draws", "s", low=0.0)

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._next = -np.inf
        self._now = np.array(self.force)

    def on_step(self, world: World, t: float) -> None:
        if self.random > 0.0 and t >= self._next:
            self._now = self.force + self._rng.uniform(-self.random, self.random, 3)
            self._next = t + self._rng.uniform(*sorted((self.shortest, self.longest)))
        if self._now.any():
            world.push(self._now.tolist(), point=self.point)
