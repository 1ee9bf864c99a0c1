# SPDX-License-Identifier: Apache-2.0
"""Fitted models that leave noise, and a slow error of a size, in three records."""

from __future__ import annotations

import numpy as np

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_sim.effects.coordinates import Coordinate

SIZE = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, "N·m", strength=True)


def law(name: str, place: str = "knee", joints: tuple[str, ...] = ()) -> Hypothesis:
    """An effect with one strength for each of its joints."""
    return Hypothesis(name, place, (), (SIZE,) * max(1, len(joints)), joints=joints)


def left(*sizes: float, seed: int = 0, shift: float = 0.0) -> list[np.ndarray]:
    """Noise, the same for all models, with a slow error in each record, (500, 1) each."""
    rng = np.random.default_rng(seed)
    t = np.arange(500.0)
    return [
        (rng.standard_normal(500) + size * np.sin(t / 7.0 + k + shift))[:, None]
        for k, size in enumerate(sizes)
    ]


def fitted(*laws: Hypothesis | str, rms: float = 0.0, whole: list | None = None) -> Fitted:
    """A model with effects that leaves a slow error of a size, or given residuals."""
    parts = tuple(law(one) if isinstance(one, str) else one for one in laws)
    whole = left(rms, rms, rms) if whole is None else whole
    held = evidence.score([*(np.full_like(r, np.nan) for r in whole[:-1]), whole[-1]])
    values = tuple((h, (1.0,) * len(h.coordinates)) for h in parts)
    return Fitted(values, {}, evidence.rms(whole[:-1]), held, tuple(whole), 0.0)
