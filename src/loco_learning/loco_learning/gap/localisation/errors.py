# SPDX-License-Identifier: Apache-2.0
"""Errors of a model over a record, with intervals: NRMSE and mean absolute windowed error.

The interval is a bootstrap over blocks, which are long compared to the correlation time of the
errors. As in thesis eq. (5.4), the windowed error allows one small time shift of the model for the
whole record.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .curves import Curve, Curves

BLOCKS = 20  # blocks of a record
DRAWS = 400
SHARE = 0.90  # probability of the interval
WINDOW = 0.05  # largest shift of the windowed error [s]
MOST_CHANNELS = 4  # channels in a table


@dataclass(frozen=True)
class Error:
    """A value and its interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if not np.isfinite(self.value):
            return "–"
        return f"{self.value:.3g} ({self.low:.3g} to {self.high:.3g})"


def nrmse(curve: Curve, column: int, which: str) -> Error:
    """Rms of the error over the standard deviation of the measurement [-]."""
    measured = curve.measured[:, column]
    scale = float(np.nanstd(measured)) if np.isfinite(measured).any() else np.nan
    squares = (curve.residual(which)[:, column] / max(scale, 1e-30)) ** 2
    return _interval(squares, f"nrmse {curve.name} {column}", np.sqrt)


def mawe(curve: Curve, column: int, which: str) -> Error:
    """Mean absolute error with the time shift that minimises it [unit of the channel]."""
    measured, model = curve.measured[:, column], getattr(curve, which)[:, column]
    dt = (curve.t[-1] - curve.t[0]) / max(1, len(curve.t) - 1)
    max_shift = min(int(WINDOW / dt + 1e-9), len(measured) // 4)
    shifts = sorted(range(-max_shift, max_shift + 1), key=lambda s: (abs(s), s))
    each = [np.abs(measured - _shifted(model, s)) for s in shifts]
    means = [float(np.mean(e[np.isfinite(e)])) if np.isfinite(e).any() else np.inf for e in each]
    return _interval(each[int(np.argmin(means))], f"mawe {curve.name} {column}", lambda x: x)


def _shifted(y: np.ndarray, by: int) -> np.ndarray:
    """Signal shifted by a number of samples; NaN at the open end."""
    out = np.full(len(y), np.nan)
    if by >= 0:
        out[by:] = y[: len(y) - by]
    else:
        out[:by] = y[-by:]
    return out


def _interval(values: np.ndarray, key: str, transform: Callable) -> Error:
    """Mean over finite values and its interval over blocks, both transformed by `transform`."""
    parts = [p[np.isfinite(p)] for p in np.array_split(values, BLOCKS)]
    parts = [p for p in parts if len(p)]
    if not parts:
        return Error(np.nan, np.nan, np.nan)
    sums, counts = np.array([p.sum() for p in parts]), np.array([len(p) for p in parts])
    rng = np.random.default_rng(zlib.crc32(key.encode()))
    drawn = rng.integers(0, len(parts), (DRAWS, len(parts)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.5 - SHARE / 2, 0.5 + SHARE / 2])
    return Error(*(float(transform(x)) for x in (sums.sum() / counts.sum(), low, high)))


def error_rows(curves: Curves) -> list[list[str]]:
    """Record, role, channel, NRMSE before and after, windowed error before and after."""
    rows = []
    for curve in curves.records:
        for c in curves.worst(MOST_CHANNELS):
            if np.isfinite(curve.measured[:, c]).sum() < BLOCKS:
                continue
            unit = curves.unit(c)
            windowed = [
                str(mawe(curve, c, which)).replace(" (", f" {unit} (", 1)
                for which in ("before", "after")
            ]
            pointwise = [str(nrmse(curve, c, which)) for which in ("before", "after")]
            rows.append([curve.name, curve.role, curves.label(c), *pointwise, *windowed])
    return rows
