# SPDX-License-Identifier: Apache-2.0
"""Excitation signals for identification: chirp, triangle and steps, with exact derivatives.

Each is a function of the time t since the start and of the phase p of the joint [strides]
(how far it is ahead), with values in [-1, 1] and an exact time derivative:

- ``chirp``: sin(theta(t) + 2 pi p), the frequency f(t) going from f0 to f1 in `sweep`
  seconds, even in the logarithm, and back: f = f0 (f1/f0)^(s/sweep).
- ``triangle``: constant speed up and down, f t + p turns from the middle upwards; a slow one
  excites friction, play and stiffness but not inertia.
- ``steps``: one of `levels` after another, each for 1/f, reached in `rise` by 3u² - 2u³;
  long levels are static poses.

Source: Pintelon and Schoukens 2012, System identification, chapter 5 (excitation signals).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

WAVEFORMS = ("chirp", "triangle", "steps")

Motion = tuple[np.ndarray, np.ndarray]  # values in [-1, 1] and their derivatives [1/s], (m,) each


def chirp(t: float, phase: np.ndarray, first: float, last: float, sweep: float) -> Motion:
    """Sine whose frequency sweeps from `first` to `last` [Hz] in `sweep` [s] and back."""
    turns, f = swept(t, first, last, sweep)
    angle = 2.0 * np.pi * (turns + phase)
    return np.sin(angle), 2.0 * np.pi * f * np.cos(angle)


def swept(t: float, first: float, last: float, sweep: float) -> tuple[float, float]:
    """Turns since the start and frequency [Hz] of a sweep up and down."""
    rate = math.log(last / first) / sweep
    rounds, since = divmod(t, 2.0 * sweep)
    back = since > sweep
    s = 2.0 * sweep - since if back else since
    integral = _integral(sweep, first, rate)
    part = _integral(s, first, rate)
    turns = 2.0 * integral - part if back else part
    return rounds * 2.0 * integral + turns, first * math.exp(rate * s)


def _integral(s: float, first: float, rate: float) -> float:
    """Phase of an exponential sweep after `s` seconds [turns]: the integral of its frequency."""
    return first * s if abs(rate * s) < 1e-9 else first * math.expm1(rate * s) / rate


def triangle(t: float, phase: np.ndarray, frequency: float) -> Motion:
    """Constant speed between -1 and 1; starts in the middle, upwards."""
    u = (frequency * t + np.asarray(phase) + 0.25) % 1.0
    up = u < 0.5
    return np.where(up, 4.0 * u - 1.0, 3.0 - 4.0 * u), np.where(up, 4.0, -4.0) * frequency


def steps(
    t: float, phase: np.ndarray, frequency: float, levels: Sequence[float], rise: float
) -> Motion:
    """Levels in turn, each for 1 / `frequency`, reached in `rise` [s]; the initial level is 0.

    A `rise` longer than the duration of a level is limited to that duration.
    """
    listed = np.asarray(levels, dtype=float)
    turn = np.maximum(frequency * t + np.asarray(phase, dtype=float), 0.0)
    index = np.floor(turn + 1e-9).astype(int)
    since = np.maximum(turn - index, 0.0) / frequency
    goal = listed[index % len(listed)]
    start = np.where(index > 0, listed[(index - 1) % len(listed)], 0.0)
    if rise <= 0.0:
        return goal, np.zeros(len(goal))
    rise = min(rise, 1.0 / frequency)
    u = np.minimum(since / rise, 1.0)
    x = start + (goal - start) * u * u * (3.0 - 2.0 * u)
    return x, (goal - start) * 6.0 * u * (1.0 - u) / rise
