# SPDX-License-Identifier: Apache-2.0
"""Readings of a simulation at the time stamps of measured ones, moved to even times as these were.

A reading that was moved by a third of a period just after a step of the command may be off by many
times its noise. The same happens to a prediction that is read and moved in the same way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import ticks


class Stamps(NamedTuple):
    """Time stamps of K readings of one signal in a record."""

    rows: np.ndarray  # row to which each was moved, (K,)
    late: np.ndarray  # time by which it was moved, in rows, (K,)
    about: np.ndarray  # indices of the readings about it, (K, w)
    weights: np.ndarray  # their weights in its change (`ticks.neighbours`), (K, w)

    @classmethod
    def of(cls, values: np.ndarray, moved: np.ndarray) -> Stamps:
        """Stamps of a signal of a record.

        Args:
            values: Readings, (T,); NaN where there is none.
            moved: Time by which each was moved to its row, in rows, (T,).
        """
        rows = np.flatnonzero(np.isfinite(values))
        late = moved[rows]
        return cls(rows, late, *ticks.neighbours(rows - late, np.arange(len(rows)), late))

    def read(self, steps: np.ndarray, parts: int) -> np.ndarray:
        """Readings of a simulated signal, moved to their rows, (K,).

        Args:
            steps: The signal, with `parts` samples for each row, (T * parts,).
            parts: Samples per row.
        """
        x = np.interp(parts * (self.rows - self.late), np.arange(len(steps)), steps)
        return x + ticks.change(x, np.arange(len(x)), self.about, self.weights)
