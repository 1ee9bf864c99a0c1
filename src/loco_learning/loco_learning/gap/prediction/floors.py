# SPDX-License-Identifier: Apache-2.0
"""Errors of predictions that are no gap: of the physics step, of hunting drives, of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from loco_control.params import limits
from loco_sim.bolted.loop import needs_engine
from loco_sim.effects import from_list
from loco_sim.params import SimParams

from ..recordings.record import Record
from . import horizon, running

_, FASTEST = limits(SimParams, "physics_rate")
FINE = 0.25  # physics step over the model's where no engine is needed
ABOUT = 0.05  # time within which an error may come [s]
PHASE = 0.05  # shift of a drive's rounding [steps]
NUDGES = -40.0, -20.0, 0.0, 20.0, 40.0  # speeds at the start, for other phases of hunting [steps/s]


def stepped(forward: Any, correction: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Error of what was recorded, where that is a simulation whose own steps are not zero.

    A first-order step leaves an error in proportion to its length; that of the model is known.
    The model may have divided its step for damping that the simulation solved with a whole one.

    Args:
        forward: Forward model.
        correction: Correction of predictions in the model's own steps, (T, C) each.

    Returns:
        Rms about each time, (T, C) each.
    """
    errors = []
    for i, (record, lacks) in enumerate(zip(forward.records, correction, strict=True)):
        share = 0.0
        if record.simulated:
            share = record.simulated / running.step(forward.robot(i), running.period(record))
        errors.append(share * lacks)
    return _rms(errors, forward.records)


def doubts(forward: Any, likely: Sequence[Mapping[str, Any]] = ()) -> list[np.ndarray]:
    """Deviation about each time, (T, C) each, that nobody can know better in pieces."""
    return _rms(horizon.doubt(forward, likely), forward.records)


def hunting(forward: Any, step: float) -> list[np.ndarray]:
    """Spread of runs whose drives hunt in other phases, (T, C) each.

    A drive that rounds its encoder hunts about its goal; where in a step and when it does so
    depends on the smallest differences, and what hangs on it swings along: a knee that a step of
    the hip throws off its stop flies a tenth further or less. No model can tell that.
    """
    robot = forward._robot(0, {}, 1.0)
    rounding = max((getattr(d, "resolution", 0.0) for d in robot.drives.values()), default=0.0)
    if not rounding > 0.0:
        return [np.zeros(m.shape) for m in forward.measured]
    places = [
        forward([{"name": "joint_offset", "offset": share * rounding}], {}, step=step)
        for share in (-PHASE, PHASE)
    ]
    times = [forward.nudged(share * rounding)((), {}, step=step) for share in NUDGES]
    runs = zip(*places, *times, strict=True)
    apart = [np.nan_to_num(np.std(each, axis=0, ddof=1)) for each in runs]
    return _largest(apart, forward.records)


def _largest(errors: Sequence[np.ndarray], records: Sequence[Record]) -> list[np.ndarray]:
    """Largest error about each time, (T, C) each: it may come a little earlier or later."""
    return [
        maximum_filter1d(np.abs(error), max(1, round(ABOUT / record.dt)), axis=0, mode="nearest")
        for error, record in zip(errors, records, strict=True)
    ]


def _rms(errors: Sequence[np.ndarray], records: Sequence[Record]) -> list[np.ndarray]:
    """Rms error about each time, (T, C) each: it goes through zero where it is not small."""
    levels = []
    for error, record in zip(errors, records, strict=True):
        width = max(1, round(2.0 * ABOUT / record.dt))
        mean = uniform_filter1d(np.square(error), width, axis=0, mode="nearest")
        levels.append(np.sqrt(np.maximum(mean, 0.0)))  # the running sum may end below 0
    return levels


def pooled(levels: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """Rms over what was measured in all records, (C,)."""
    pairs = zip(levels, measured, strict=True)
    every = np.concatenate([np.where(np.isfinite(m), e, np.nan) for e, m in pairs])
    count = np.maximum(np.isfinite(every).sum(0), 1)
    return np.sqrt(np.nansum(np.square(every), axis=0) / count)


def finest(forward: Any) -> float:
    """Step over the model's: as fine as is cheap and as the engine's rate allows for a quarter."""
    rates = [forward._robot(i, {}, 1.0).sim.physics_rate for i in range(len(forward.records))]
    for step in (FINE, 2.0 * FINE) if compiled(forward) and forward.fine_steps else ():
        if 4.0 * max(rates) / step <= FASTEST:
            return step
    return 1.0


def compiled(forward: Any) -> bool:
    """The model runs without the engine on every record, so that fine steps are cheap."""
    return not any(
        needs_engine(forward._robot(i, {}, 1.0), from_list(forward.model.effects))
        for i in range(len(forward.records))
    )


def step_error(
    forward: Any, fine: float, overrides: Mapping[str, Any] | None = None
) -> tuple[dict[float, list[np.ndarray]], list[np.ndarray]]:
    """Error of a model's predictions because its physics step is not zero.

    Predictions at two steps are extrapolated to none (Richardson, first order). The error of
    a semi-implicit step acts like a delay of half a step: uncorrected it would be named one.

    Args:
        forward: Forward model.
        fine: Step over the model's that the case uses where it can.
        overrides: Values of robot.yaml, over those of the model.

    Returns:
        Correction of a prediction, (T, C) per record, by step; and the error that remains about
        each time, the same shape.
    """
    rate = max(forward._robot(i, {}, 1.0).sim.physics_rate for i in range(len(forward.records)))
    if 4.0 * rate / fine > FASTEST:
        none = [np.zeros(m.shape) for m in forward.measured]  # it is fine enough as it is
        return {1.0: none}, none
    steps = {1.0, fine, 0.5 * fine, 0.25 * fine}
    runs = {step: forward((), overrides, step=step) for step in sorted(steps)}
    limits = [2.0 * q - h for q, h in zip(runs[0.25 * fine], runs[0.5 * fine], strict=True)]
    coarse = [2.0 * h - w for h, w in zip(runs[0.5 * fine], runs[fine], strict=True)]
    correction = {
        step: [np.nan_to_num(e - p) for e, p in zip(limits, runs[step], strict=True)]
        for step in sorted({1.0, fine})
    }
    remains = [np.nan_to_num(a - b) for a, b in zip(limits, coarse, strict=True)]
    return correction, _rms(remains, forward.records)
