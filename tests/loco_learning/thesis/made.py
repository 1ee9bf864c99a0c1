# SPDX-License-Identifier: Apache-2.0
"""Evidence that nobody had to run, so that what a measure says of it is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from loco_learning.study.case import CaseResult
from loco_learning.thesis.evidence import Evidence


def case(variant="reflex", seed=0, verdict=None, at=None, curves=None, experiment=None, **phases):
    """A run with these metrics by phase."""
    return CaseResult(
        "c", variant, seed, experiment or {}, verdict or {}, phases, at=at or {},
        curves=curves or {},
    )  # fmt: skip


class Given(Evidence):
    """Evidence whose cases are given by the name of their study."""

    def __init__(self, variants=(), **cases):
        super().__init__({}, None)
        self._cases, self._variants = cases, variants

    def study(self, name):
        return SimpleNamespace(variants=self._variants), self._cases[name]


class Other(Evidence):
    """Evidence of one result that is of no study."""

    def __init__(self, result):
        super().__init__({}, None)
        self._result = result

    def other(self, name):
        return self._result


def curve(opened=None, seed=0, **closed):
    """Cases over stiffness of one seed; the open loop is 1 everywhere, or as given."""
    count = len(next(iter({**closed, **(opened or {})}.values())))
    names = {*closed, *(opened or {})}
    return [
        case(
            seed=seed,
            at={"kp": kp},
            train={name: (opened or {}).get(name, np.ones(count))[i] for name in names},
            test={name: closed.get(name, np.ones(count))[i] for name in names},
        )
        for i, kp in enumerate(np.linspace(100.0, 1000.0, count))
    ]
