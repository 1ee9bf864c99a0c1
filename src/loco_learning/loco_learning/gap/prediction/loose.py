# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that are not known well, refitted to every model without a simulation.

Torques along a given motion are linear in masses, centres and inertias, and nearly so with any
effect in the model: what a change of each value does to the residual is simulated once. From
then on the values that suit a model best, within their priors, are linear least squares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_sim.robot.equipment import BodyParams

from ..statistics import evidence

PART = 0.1  # of a deviation that is simulated; the rest is taken as linear (taste)
ROUNDS = 3  # of the weights, each with what the one before leaves (taste)


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
    """

    names: tuple[str, ...]
    nominal: np.ndarray
    spread: np.ndarray
    columns: tuple[np.ndarray, ...]
    weight: np.ndarray

    def best(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], rows: Sequence[np.ndarray]
    ) -> np.ndarray:
        """Deviations that suit a model best, (K,).

        Args:
            residuals: Residuals of the model [floors], (T, C) each.
            only: Their records.
            rows: Rows of every record that are fitted, (T,) flags.
        """
        count = len(self.names)
        gram, moment = np.eye(count), np.zeros(count)
        for i, r in zip(only, residuals, strict=True):
            used = np.isfinite(r) & rows[i][:, None]
            a = (
                self.columns[i][used]
                * np.sqrt(np.broadcast_to(self.weight, r.shape)[used])[:, None]
            )
            gram += a.T @ a
            moment -= a.T @ (r[used] * np.sqrt(np.broadcast_to(self.weight, r.shape)[used]))
        return np.linalg.solve(gram, moment)

    def left(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], by: np.ndarray
    ) -> list[np.ndarray]:
        """Residuals with the values at deviations `by`, (T, C) each."""
        return [r + self.columns[i] @ by for i, r in zip(only, residuals, strict=True)]

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


def prepare(case: Any, spread: Mapping[str, float], robot: Any) -> Loose | None:
    """Simulate what each value does, and weigh channels by what all of them together leave.

    Args:
        case: Model and data, without any nuisance yet.
        spread: Standard deviation of each value by dotted name.
        robot: The robot as it came, with drives as its file has them.
    """
    if not spread:
        return None
    names = tuple(spread)
    nominal = np.array([nominal_value(robot, name) for name in names])
    sizes = np.array([spread[name] for name in names])
    here = case.whitened([])
    moved = [
        case.whitened([], {name: float(at + PART * size)})
        for name, at, size in zip(names, nominal, sizes, strict=True)
    ]
    columns = tuple(
        np.stack([np.nan_to_num(m[i] - r) / PART for m in moved], axis=-1)
        for i, r in enumerate(here)
    )
    every = range(len(here))
    loose = Loose(names, nominal, sizes, columns, np.ones(here[0].shape[1]))
    for _ in range(ROUNDS):
        left = loose.left(here, every, loose.best(here, every, case.fit_rows))
        fitted = case.masked(left, every, held=False)
        score = evidence.score(
            [r for r, rows in zip(fitted, case.fit_rows, strict=True) if rows.any()]
        )
        weight = 1.0 / (np.max(score.tau, axis=0) * np.square(score.scale))
        loose = Loose(names, nominal, sizes, columns, weight)
    return loose
