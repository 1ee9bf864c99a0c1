# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that are not known well, refitted to every model without a simulation.

What a change of each value does to the residual is simulated once. From then on the values that
suit a model best, within their priors, are linear least squares. Torques along a given motion are
linear in masses, centres and inertias. A motion is so for small changes alone: there values stay
within `MOST` deviations, and the changes are simulated about the values that suit the robot.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from loco_sim.robot.equipment import BodyParams

from ..statistics import evidence

PART = 0.1  # of a deviation that is simulated; the rest is taken as linear (taste)
ROUNDS = 3  # of the weights, each with what the one before leaves (taste)
TIMES, NEAR = 4, 0.5  # that changes are simulated, at most; deviations that need no more (taste)
MOST = 2.5  # deviations that a value may be off where a motion is compared: beyond is an effect


@dataclass(frozen=True)
class Loose:
    """Linear nuisance.

    Attributes:
        names: Values by dotted name, K of them.
        nominal: Value of each as the robot says it, (K,).
        spread: Standard deviation of each, (K,).
        columns: Change of the residual [floors] per deviation, (T, C, K) per record; 0 where
            nothing was measured.
        weight: Information of a residual of 1 floor in each channel, (C,).
        rows: Rows of each record that are fitted, (T,) flags.
        most: Largest deviations of a value.
        at: Deviations about which models are simulated, (K,).
    """

    names: tuple[str, ...]
    nominal: np.ndarray
    spread: np.ndarray
    columns: tuple[np.ndarray, ...]
    weight: np.ndarray
    rows: tuple[np.ndarray, ...]
    most: float
    at: np.ndarray
    grams: dict[int, np.ndarray] = field(default_factory=dict, compare=False, repr=False)

    def best(self, residuals: Sequence[np.ndarray], only: Sequence[int]) -> np.ndarray:
        """Deviations that suit a model best, (K,).

        Args:
            residuals: Residuals of the model [floors], (T, C) each, simulated at `at`.
            only: Their records.
        """
        gram, moment = np.eye(len(self.names)), np.zeros(len(self.names))
        for i, r in zip(only, residuals, strict=True):
            used = np.isfinite(r) & self.rows[i][:, None]
            weighed = np.where(used, r, 0.0) * self.weight
            moment -= np.einsum("tck,tc->k", self.columns[i], weighed)
            if i not in self.grams:
                a = self.columns[i][used] * np.sqrt(self._weights(used))[:, None]
                self.grams[i] = a.T @ a
            gram += self.grams[i]
            moment += self.grams[i] @ self.at
        free = np.linalg.solve(gram, moment)
        if np.all(np.abs(free) <= self.most):
            return free
        root = np.linalg.cholesky(gram)
        bounds = (-self.most, self.most)
        return lsq_linear(root.T, np.linalg.solve(root, moment), bounds, method="bvls").x

    def far(self, by: np.ndarray) -> bool:
        """Whether deviations lie so far from `at` that what they do is no straight line."""
        return math.isfinite(self.most) and bool(np.max(np.abs(by - self.at)) > NEAR)

    def about(self, by: np.ndarray) -> Loose:
        """The same for models that are simulated at other deviations."""
        return replace(self, at=by)

    def _weights(self, used: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.weight, used.shape)[used]

    def left(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], by: np.ndarray
    ) -> list[np.ndarray]:
        """Residuals with the values at deviations `by`, (T, C) each."""
        moved = by - self.at
        return [r + self.columns[i] @ moved for i, r in zip(only, residuals, strict=True)]

    def values(self, by: np.ndarray) -> dict[str, float]:
        """Values of ``robot.yaml`` at deviations, none beyond what is legal."""
        found = self.nominal + self.spread * by
        return {n: _legal(n, float(v)) for n, v in zip(self.names, found, strict=True)}


def nominal_value(robot: Any, name: str) -> float:
    """Value of a dotted name as the robot has it."""
    section, _, rest = name.partition(".")
    place, _, parameter = rest.rpartition(".")
    if section == "bodies":
        return float(getattr(BodyParams(), parameter))
    return float(getattr(getattr(robot, section)[place], parameter))


def _legal(name: str, value: float) -> float:
    if not name.startswith("bodies."):
        return value
    meta = BodyParams.__dataclass_fields__[name.rpartition(".")[2]].metadata
    return min(max(value, meta["low"]), meta["high"])


def prepare(case: Any, spread: Mapping[str, float], robot: Any, linear: bool) -> Loose | None:
    """Simulate what each value does, and weigh channels by what all of them together leave.

    Args:
        case: Model and data, without any nuisance yet.
        spread: Standard deviation of each value by dotted name.
        robot: The robot as it came, with drives as its file has them.
        linear: Whether residuals are linear in the values, however large their changes.
    """
    if not spread:
        return None
    names = tuple(spread)
    nominal = np.array([nominal_value(robot, name) for name in names])
    sizes = np.array([spread[name] for name in names])
    every, none = range(len(case.records)), np.zeros(len(names))
    rows, width = tuple(case.fit_rows), len(case.forward.channels)
    most = np.inf if linear else MOST
    loose = Loose(names, nominal, sizes, (), np.ones(width), rows, most, none)
    for _ in range(1 if linear else TIMES):
        loose = _about(case, loose)
        here = case.bare([], loose.values(loose.at))
        for _ in range(ROUNDS):
            left = loose.left(here, every, loose.best(here, every))
            fitted = case.masked(left, every, held=False)
            score = evidence.score([r for r, used in zip(fitted, rows, strict=True) if used.any()])
            weight = 1.0 / (np.max(score.tau, axis=0) * np.square(score.scale))
            loose = replace(loose, weight=weight, grams={})
        best = loose.best(here, every)
        if not loose.far(best):
            break
        loose = loose.about(best)
    return loose


def _about(case: Any, loose: Loose) -> Loose:
    """The same with what each value does about the deviations `at`."""
    here = case.bare([], loose.values(loose.at), coarse=True)
    columns = []
    for k in range(len(loose.names)):
        moved = loose.at.copy()
        moved[k] += PART if moved[k] <= 0.0 else -PART
        there = case.bare([], loose.values(moved), coarse=True)
        change = (np.nan_to_num(a - b) for a, b in zip(there, here, strict=True))
        columns.append([c / (moved[k] - loose.at[k]) for c in change])
    found = tuple(np.stack(each, axis=-1) for each in zip(*columns, strict=True))
    return replace(loose, columns=found, grams={})
