# SPDX-License-Identifier: Apache-2.0
"""Division of periodic signals into periods at zero crossings of the actuation, and their mean.

The command is periodic and equal on the robot and in its model, so its rising
zero crossings divide both alike; each period is then interpolated on one common phase axis and
averaged, which removes what is not periodic (sensor noise, vibration).

Source: thesis section 5.2, figure 5.2a; constants from the author's code.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError

CUTOFF = 0.03  # low-pass filter, as a share of half the sampling rate
POINTS = 200  # samples on the phase axis of one period
MIN_RANGE = 1e-9  # range of a reference [its unit] below which it is constant
PERIOD_TOLERANCE = 0.2  # largest relative difference of a period from the median period


@dataclass(frozen=True)
class Segments:
    """Signals divided into periods.

    Attributes:
        period: Mean length of a period [s].
        periods: Each period on the common phase axis, (P, N, J).
    """

    period: float
    periods: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Average period, (N, J)."""
        return self.periods.mean(axis=0)

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation between periods, (N, J)."""
        return self.periods.std(axis=0)


def low_pass(x: np.ndarray) -> np.ndarray:
    """Second-order Butterworth low-pass without phase shift (applied forwards and backwards).

    Args:
        x: Evenly sampled signal, (T,).

    Raises:
        ParameterError: The signal is too short to filter.
    """
    if len(x) < 16:
        raise ParameterError(f"a signal of {len(x)} samples is too short to be cut into periods")
    # Called here since its import takes 0.8 s and other users of this module do not filter.
    from scipy import signal

    b, a = signal.butter(2, CUTOFF)
    return signal.filtfilt(b, a, x, padlen=min(len(x) - 1, 300))


def leading(commands: np.ndarray) -> int:
    """Column of the first command that moves, whose zero crossings are used; 0 if none moves.

    Args:
        commands: Commands of the driven joints, (T, m).
    """
    moving = np.ptp(commands, axis=0) >= MIN_RANGE if len(commands) else np.zeros(1, dtype=bool)
    return int(np.argmax(moving))


def crossings(t: np.ndarray, reference: np.ndarray, min_periods: int = 2) -> np.ndarray:
    """Times at which the centred, smoothed reference rises through zero [s], (P + 1,).

    Args:
        t: Times of the samples [s], evenly spaced, (T,).
        reference: Command of one driven joint, (T,).
        min_periods: Smallest number of whole periods.

    Raises:
        ParameterError: The signal is not finite, constant, not periodic, or has too few periods.
    """
    if not np.all(np.isfinite(reference)):
        raise ParameterError("the actuation has values that are not finite")
    if len(reference) == 0:
        raise ParameterError("there is no actuation: no samples are left to cut into periods")
    if np.ptp(reference) < MIN_RANGE:
        raise ParameterError(
            f"the actuation is constant at {reference[0]:g} rad: it has no zero crossings to cut at"
        )
    smooth = low_pass(reference)
    smooth = smooth - 0.5 * (smooth.max() + smooth.min())
    before = np.flatnonzero((smooth[:-1] < 0.0) & (smooth[1:] >= 0.0))
    if len(before) < min_periods + 1:
        raise ParameterError(
            f"the actuation has {max(0, len(before) - 1)} whole periods in {t[-1] - t[0]:.1f} s, "
            f"at least {min_periods} are needed"
        )
    low, high = smooth[before], smooth[before + 1]
    times = t[before] - low / (high - low) * (t[before + 1] - t[before])
    lengths = np.diff(times)
    usual = float(np.median(lengths))
    if np.any(np.abs(lengths - usual) > PERIOD_TOLERANCE * usual):
        raise ParameterError(
            f"the actuation is not periodic: its periods last {lengths.min():.2f} s to "
            f"{lengths.max():.2f} s"
        )
    return times


def cut(t: np.ndarray, x: np.ndarray, at: np.ndarray, points: int = POINTS) -> Segments:
    """Interpolate each period of the signals on one phase axis.

    Args:
        t: Times of the samples [s], increasing, (T,).
        x: Signals, (T, J).
        at: Borders of the periods [s], (P + 1,), inside `t`.
        points: Number of samples N of the phase axis, without its end.

    Raises:
        ParameterError: A signal is not finite, or a border lies outside the signal.
    """
    if not np.all(np.isfinite(x)):
        raise ParameterError("a sensor signal has values that are not finite")
    step = float(np.median(np.diff(t)))
    if at[0] < t[0] - step or at[-1] > t[-1] + step:
        raise ParameterError(
            f"periods from {at[0]:.2f} s to {at[-1]:.2f} s lie outside the signal "
            f"({t[0]:.2f} s to {t[-1]:.2f} s)"
        )
    phase = np.arange(points) / points
    when = at[:-1, None] + phase * np.diff(at)[:, None]  # (P, N)
    periods = np.stack([np.interp(when, t, column) for column in x.T], axis=-1)
    return Segments(float(np.mean(np.diff(at))), periods)
