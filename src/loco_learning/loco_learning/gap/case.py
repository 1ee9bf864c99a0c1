# SPDX-License-Identifier: Apache-2.0
"""A model, what was measured, and what the one leaves of the other: whitened residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import evidence, noise
from .record import Record

CAP = 20.0  # times the largest residual of the model as it came: more is a model that fell over


@dataclass
class Case:
    """Residuals of models on the records that are fitted and those that judge.

    Attributes:
        forward: What a model says where the robot was measured.
        records: All records, in the order of the forward model.
        fit_rows: Rows of each record that are fitted, (T,) flags.
        held_rows: Rows of each record that only judge, (T,) flags.
        floor: Noise and numerical error of each channel, (C,).
        cap: Largest whitened residual that is told from a fall.
        count: Simulations so far [records].
    """

    forward: Any
    records: list[Record]
    fit_rows: list[np.ndarray]
    held_rows: list[np.ndarray]
    floor: np.ndarray
    cap: float = evidence.LIMIT
    count: int = field(default=0, compare=False)

    @property
    def fitted(self) -> list[int]:
        """Records that are fitted, at least in part."""
        return [i for i, rows in enumerate(self.fit_rows) if rows.any()]

    @property
    def judging(self) -> list[int]:
        """Records that judge, at least in part."""
        return [i for i, rows in enumerate(self.held_rows) if rows.any()]

    @property
    def signals(self) -> list[str]:
        """Names of the signals that were measured."""
        return sorted({channel.signal for channel in self.forward.channels})

    def whitened(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
    ) -> list[np.ndarray]:
        """Residual of whole records in floors, (T, C) each."""
        only = list(range(len(self.records))) if only is None else list(only)
        self.count += len(only)
        predicted = self.forward(specs, overrides or {}, only)
        return evidence.whiten([self.forward.measured[i] for i in only], predicted, self.floor)

    def masked(
        self, residuals: Sequence[np.ndarray], only: Sequence[int], held: bool
    ) -> list[np.ndarray]:
        """Residuals of the rows that are fitted, or of those that judge; others are NaN."""
        rows = self.held_rows if held else self.fit_rows
        return [np.where(rows[i][:, None], r, np.nan) for i, r in zip(only, residuals, strict=True)]

    def vector(
        self,
        specs: Sequence[Mapping],
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
    ) -> np.ndarray:
        """Residual of all fitted values in one line [floors], (N,)."""
        only = self.fitted if only is None else list(only)
        residuals = self.masked(self.whitened(specs, overrides, only), only, held=False)
        flat = np.concatenate(
            [r[np.isfinite(self._weighed(i))] for i, r in zip(only, residuals, strict=True)]
        )
        return np.clip(np.nan_to_num(flat, nan=self.cap), -self.cap, self.cap)

    def _weighed(self, i: int) -> np.ndarray:
        """Measured values of a record where it is fitted, NaN elsewhere, (T, C)."""
        return np.where(self.fit_rows[i][:, None], self.forward.measured[i], np.nan)

    def channel_of(self, only: Sequence[int] | None = None) -> np.ndarray:
        """Channel of each value of `vector`, (N,)."""
        only = self.fitted if only is None else list(only)
        return np.concatenate([np.nonzero(np.isfinite(self._weighed(i)))[1] for i in only])


def prepare(forward: Any, records: Sequence[Record], held_out: Sequence[Record]) -> Case:
    """Split what is fitted from what judges, and find the floor of each channel.

    Without records to judge on, the last third of each record judges.

    Args:
        forward: Forward model of ``[*records, *held_out]``.
        records: To fit.
        held_out: To judge on.
    """
    both = [*records, *held_out]
    fit_rows, held_rows = [], []
    for i, record in enumerate(both):
        rows = np.zeros(len(record.t), dtype=bool)
        if held_out:
            rows[:] = i < len(records)
            judges = ~rows
        else:
            rows[: (2 * len(rows)) // 3] = True
            judges = ~rows
        fit_rows.append(rows)
        held_rows.append(judges)
    steps = np.array([max(r.resolution.get(c.signal, 0.0) for r in both) for c in forward.channels])
    floor = noise.total(noise.floor(forward.measured, steps), forward.numeric)
    case = Case(forward, both, fit_rows, held_rows, floor)
    before = case.vector([])
    case.cap = CAP * max(float(np.max(np.abs(before), initial=0.0)), 10.0)
    return case
