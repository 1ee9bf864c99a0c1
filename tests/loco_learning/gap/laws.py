# SPDX-License-Identifier: Apache-2.0
"""Effects with their coordinates, and models of one of them, for tests that simulate nothing."""

from __future__ import annotations

import numpy as np

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_sim.effects.coordinates import Coordinate

TORQUE = Coordinate("torque", 0.05, (1.0,), 0.0, 10.0, "N·m", strength=True)
DELAY = Coordinate("delay", 0.02, (1.0,), 0.0, 1.0, "s", strength=True)
SPEED = Coordinate("velocity", 0.1, (0.0,), 0.001, 10.0, "rad/s", logarithmic=True)


def hypothesis(effect: str, *coordinates: Coordinate, place: str = "knee") -> Hypothesis:
    """An effect at a place."""
    return Hypothesis(effect, place, (("joint", place),), coordinates)


COULOMB = hypothesis("coulomb_friction", TORQUE)
STRIBECK = hypothesis("stribeck_friction", TORQUE, SPEED)
COMMAND_DELAY = hypothesis("command_delay", DELAY)


def fitted(h: Hypothesis, shape: float = 0.0) -> Fitted:
    """A model with one effect, which leaves noise."""
    r = np.random.default_rng(0).normal(size=(500, 2))
    x = (1.0, shape)[: len(h.coordinates)]
    return Fitted(((h, x),), {}, 1.0, evidence.score([r]), (r,), 0.0)
