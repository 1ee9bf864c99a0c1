# SPDX-License-Identifier: Apache-2.0
"""A model, what was measured, and what the one leaves of the other: whitened residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
        correction: What predictions lack because the physics step is not zero, (T, C) each.
        second: What of it is of second order in the step, (T, C) each.
        cap: Largest whitened residual that is told from a fall.
        count: Simulations so far [records].
    """

    forward: Any
    records: list[Record]
    fit_rows: list[np.ndarray]
    held_rows: list[np.ndarray]
    floor: np.ndarray
    correction: list[np.ndarray]
    second: list[np.ndarray]
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
        exact = [p + self.correction[i] for i, p in zip(only, predicted, strict=True)]
        return evidence.whiten([self.forward.measured[i] for i in only], exact, self.floor)

    def corrected(self, specs: Sequence[Mapping], overrides: Mapping[str, Any]) -> Case:
        """The same case with the step error of another model, e.g. of one with effects.

        Steps of one and one half are enough: what a quarter adds is taken from the model as
        it came.
        """
        whole, half = (self.forward(specs, overrides, step=s) for s in (1.0, 0.5))
        self.count += 3 * len(self.records)
        first = [2.0 * (h - w) for h, w in zip(half, whole, strict=True)]
        correction = [np.nan_to_num(f) + s for f, s in zip(first, self.second, strict=True)]
        return replace(self, correction=correction)

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
    correction, second, numeric = step_error(forward)
    floor = noise.total(noise.floor(forward.measured, steps), numeric)
    case = Case(forward, both, fit_rows, held_rows, floor, correction, second)
    before = case.vector([])
    case.cap = CAP * max(float(np.max(np.abs(before), initial=0.0)), 10.0)
    return case


def step_error(forward: Any) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """What a model's predictions lack because its physics step is not zero.

    Predictions at the model's step, half and a quarter of it are extrapolated to none
    (Richardson, first order). The error of a semi-implicit step acts like a delay of half a
    step: uncorrected it would be named one.

    Returns:
        What to add to a prediction, the part of it of second order, (T, C) per record each,
        and the error that remains, (C,).
    """
    whole, half, quarter = (forward((), {}, step=s) for s in (1.0, 0.5, 0.25))
    limits = [2.0 * q - h for q, h in zip(quarter, half, strict=True)]
    coarse = [2.0 * h - w for h, w in zip(half, whole, strict=True)]
    correction = [np.nan_to_num(e - w) for e, w in zip(limits, whole, strict=True)]
    second = [np.nan_to_num(e - c) for e, c in zip(limits, coarse, strict=True)]
    known = [
        np.where(np.isfinite(m), s, 0.0) for m, s in zip(forward.measured, second, strict=True)
    ]
    count = np.maximum(sum(np.isfinite(m).sum(0) for m in forward.measured), 1)
    square = sum(np.square(k).sum(0) for k in known)
    return correction, second, np.sqrt(square / count) / 3.0
