# SPDX-License-Identifier: Apache-2.0
"""Commands of a log that is slower than the rate at which they were given.

A table of 50 Hz holds one in four of the commands of a drive that is commanded at 200 Hz. Held
from row to row they would be late by half a period of the log, which looks like a delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from loco_sim import lazy
from loco_sim.robot.robot import Robot

from ..record import Doubt
from ..tracks import Track
from .params import RATES

interpolate = lazy.module("scipy.interpolate")  # loaded on first use


def undersampled(tracks: Sequence[Track], rate: float, robot: Robot) -> list[Track]:
    """Commands logged in the rows of the angles, more rarely than robot.yaml says they are given.

    Rows may lack a few readings or commands: most time stamps are shared.

    Args:
        tracks: Signals with rising time stamps.
        rate: Rate of angles and commands [Hz].
        robot: Robot that was measured.
    """
    if not robot.rate_stated or robot.control_rate < RATES.ratio * rate:
        return []
    rows = [track.t for track in tracks if track.role == "q"]
    commands = [k for k in tracks if k.role.startswith("command_") and k.between == ""]
    long = [k for k in commands if len(k.t) >= RATES.samples]
    return [k for k in long if any(_same_rows(k.t, t) for t in rows)]


def _same_rows(t: np.ndarray, other: np.ndarray) -> bool:
    """True if two signals with these time stamps were logged in the same rows."""
    count = min(len(t), len(other))
    return count > 0 and np.isin(t, other).sum() >= RATES.shared * count


def multiple(rate: float, robot: Robot) -> float:
    """Smallest multiple of the rate of a log that is not below the rate of the commands [Hz].

    Commands that are given faster than the physics steps change once per step.
    """
    return rate * math.ceil(min(robot.control_rate, robot.sim.physics_rate) / rate - 0.01)


def commands(
    tracks: Sequence[Track], axis: np.ndarray, robot: Robot, data: Mapping[str, Any]
) -> dict[str, dict[str, np.ndarray]]:
    """Fields `command` and `unsure` of a record with interpolated commands.

    Args:
        tracks: Undersampled commands.
        axis: Times of the record [s], (T,).
        robot: Robot that was measured.
        data: Fields of the record with commands that are held from row to row.
    """
    values = {kind: command.copy() for kind, command in data["command"].items()}
    errors = {kind: np.zeros(command.shape) for kind, command in values.items()}
    for track in tracks:
        kind, column = track.role.removeprefix("command_"), data["driven"].index(track.place)
        values[kind][:, column], errors[kind][:, column] = interpolated(track, axis, robot)
    return {"command": values, "unsure": errors}


def interpolated(track: Track, axis: np.ndarray, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """A command on an axis, and its estimated error there, (T,) each.

    Of several curves the one is used that predicts every second sample best from the others: a
    local cubic (Akima 1970), which does not overshoot at steps, or a spline, which is exacter where
    a command is smooth. Its error is estimated from the curve through every second sample, and
    the order of convergence from those through every fourth and every second: it is half of each
    step, and small for smooth commands.
    """
    single = np.diff(track.t, prepend=-np.inf) > RATES.close * np.median(np.diff(track.t))
    track = replace(track, t=track.t[single], x=track.x[single])
    delay = 0.5 / robot.control_rate - 0.5 * float(axis[1] - axis[0])  # mean of a held command
    t = np.clip(axis - delay, track.t[0], track.t[-1])
    degree = min(RATES.degrees, key=lambda degree: _error(track, degree, 2))
    fine, coarse = (_curve(track, degree, n) for n in (1, 2))
    inside = np.minimum(t, track.t[::2][-1])
    ratio = max(_error(track, degree, 4), 1e-300) / max(_error(track, degree, 2), 1e-300)
    order = float(np.clip(math.log2(ratio), 1.0, degree + 1.0))
    return fine(t), (coarse(inside) - fine(inside)) / (2.0**order - 1.0)


def _curve(track: Track, degree: int, n: int) -> Callable[[np.ndarray], np.ndarray]:
    """The curve through every n-th sample; a degree of 3 is the local cubic."""
    t, x = track.t[::n], track.x[::n]
    if degree == 3:
        return interpolate.Akima1DInterpolator(t, x)
    return interpolate.make_interp_spline(t, x, degree)


def _error(track: Track, degree: int, n: int) -> float:
    """Rms error of the curve through every n-th sample, at the samples halfway between them."""
    middle = slice(n // 2, None, n)
    inside = track.t[middle] <= track.t[::n][-1]
    errors = _curve(track, degree, n)(track.t[middle]) - track.x[middle]
    return float(np.sqrt(np.mean(np.square(errors[inside]))))


def note(tracks: Sequence[Track], rate: float, robot: Robot) -> Doubt:
    """Sentence on commands that are not known between the rows of a log."""
    roles = ", ".join(dict.fromkeys(track.role for track in tracks))
    return Doubt(
        f"{roles}: logged at {rate:.4g} Hz, given at {robot.control_rate:.4g} Hz as robot.yaml "
        "says (control_rate): between rows it is not known and was drawn as a smooth curve; if "
        "each held until the next row, say between: hold at the column"
    )
