# SPDX-License-Identifier: Apache-2.0
"""Mean absolute windowed error between two averaged periods, in its two variants.

Both compare the robot's period with the model's under one circular shift for all
channels, at most `WINDOW` either way, and use the smallest error, so that a lag
common to all channels does not count.

``thesis`` is eq. (5.4): absolute differences averaged over the period and summed over
the channels, in the unit of the signals. Departure: the equation writes one window
per sample; one period is shifted as a whole here, as in the author's code.

``author`` is what that code computes: each channel of *both* signals is scaled by the
*robot's* range, the absolute difference is integrated over one period in seconds
and averaged over the channels. Its unit is seconds; a period of pi seconds with an
error of 15 % of the range reads 0.48.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from loco_control.exceptions import NameUnknownError, ParameterError

WINDOW = 0.5  # largest shift [s]


def thesis(
    robot: np.ndarray, model: np.ndarray, period: float, window: float = WINDOW
) -> tuple[float, float]:
    """Error of eq. (5.4) [unit of the signals] and the corresponding shift [s].

    Args:
        robot: Average period of the robot, (N, J).
        model: Average period of the model, (N, J).
        period: Length of the period [s].
        window: Largest shift [s].

    Returns:
        Error, and the delay of the robot behind the model [s].

    Raises:
        ParameterError: Shapes differ or a value is not finite.
    """
    errors, step = _errors(robot, model, period, window)
    return _smallest(errors * robot.shape[1], step)


def author(
    robot: np.ndarray, model: np.ndarray, period: float, window: float = WINDOW
) -> tuple[float, float]:
    """Error of the author's code [s] and the corresponding shift [s]; see `thesis`.

    Raises:
        ParameterError: A channel of the robot is constant, so that it has no range.
    """
    low, width = robot.min(axis=0), np.ptp(robot, axis=0)
    if np.any(width <= 0.0):
        raise ParameterError("a sensor of the robot is constant: its range cannot be a scale")
    errors, step = _errors((robot - low) / width - 0.5, (model - low) / width - 0.5, period, window)
    return _smallest(errors * period, step)


LOSSES: dict[str, Callable[..., tuple[float, float]]] = {"thesis": thesis, "author": author}
UNITS = {"thesis": "rad", "author": "s"}


def loss(name: str) -> Callable[..., tuple[float, float]]:
    """Loss by its name.

    Raises:
        NameUnknownError: The loss does not exist.
    """
    if name not in LOSSES:
        raise NameUnknownError("loss", name, LOSSES)
    return LOSSES[name]


def _errors(
    robot: np.ndarray, model: np.ndarray, period: float, window: float
) -> tuple[np.ndarray, float]:
    """Mean absolute difference at each shift of -k … k samples, (2 k + 1,), and its step [s]."""
    if robot.shape != model.shape or robot.ndim != 2 or not robot.size:
        raise ParameterError(f"periods of shapes {robot.shape} and {model.shape} do not compare")
    if not (np.all(np.isfinite(robot)) and np.all(np.isfinite(model))):
        raise ParameterError("an averaged period has values that are not finite")
    count = len(robot)
    # Half a period in either direction includes all shifts.
    max_shift = min(int(window / period * count + 1e-9), count // 2)
    errors = _kernel(np.ascontiguousarray(robot.T), np.ascontiguousarray(model.T), max_shift)
    return errors, period / count


def _smallest(errors: np.ndarray, step: float) -> tuple[float, float]:
    shifts = np.arange(len(errors)) - len(errors) // 2
    order = np.lexsort((np.abs(shifts), errors))  # smallest shift among equal errors
    return float(errors[order[0]]), float(shifts[order[0]] * step)


@njit(cache=True)
def _kernel(robot: np.ndarray, model: np.ndarray, max_shift: int) -> np.ndarray:  # (J, N) each
    channels, count = robot.shape
    errors = np.empty(2 * max_shift + 1)
    for k in range(-max_shift, max_shift + 1):
        total = 0.0
        for j in range(channels):
            for i in range(count):
                total += abs(robot[j, i] - model[j, (i - k) % count])
        errors[k + max_shift] = total / (channels * count)
    return errors
