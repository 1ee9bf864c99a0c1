# SPDX-License-Identifier: Apache-2.0
"""Prediction errors that are no gap: of the physics step, of limit cycles and of contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from loco_control.params import limits
from loco_sim.bolted.loop import needs_engine
from loco_sim.effects import from_list
from loco_sim.params import SimParams

from ..recordings.record import Record, spacing
from ..statistics.jitter import jitter, rate
from . import horizon, running

_, FASTEST = limits(SimParams, "physics_rate")
FINE = 0.25  # ratio of the physics step to the model's if no engine is needed
ABOUT = 0.05  # uncertainty of the time at which an error occurs [s]
PHASE = 0.05  # shift of a drive's quantisation [steps]
# Initial speeds, to average over phases of a limit cycle [steps/s].
SPEEDS = -40.0, -20.0, 0.0, 20.0, 40.0


def stepped(forward: Any, correction: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Error of a record that is itself a simulation with a finite physics step.

    The error of a first-order integrator is proportional to its step; that of the model is known.
    The model may use substeps for damping where the recorded simulation used whole steps.

    Args:
        forward: Forward model.
        correction: Correction of predictions in the model's own steps, (T, C) each.

    Returns:
        Rms about each time, (T, C) each.
    """
    errors = []
    for i, (record, step_error) in enumerate(zip(forward.records, correction, strict=True)):
        step = record.simulated or record.stepped
        own_step = running.step(forward.robot(i), running.period(record)) if step else 1.0
        errors.append(step / own_step * step_error)
    return _rms(errors, forward.records)


def state_errors(forward: Any, suspects: Sequence[Mapping[str, Any]] = ()) -> list[np.ndarray]:
    """Standard deviation of predictions that start in uncertain measured states, (T, C) each."""
    return _rms(horizon.state_std(forward, suspects), forward.records)


def undersampled(forward: Any) -> list[np.ndarray]:
    """Change of predictions by the estimated error of undersampled commands, (T, C) each."""
    if not any(record.unsure for record in forward.records):
        return [np.zeros(m.shape) for m in forward.measured]
    pairs = zip(forward.recommanded()(), forward(), strict=True)
    return _rms([np.nan_to_num(a - b) for a, b in pairs], forward.records)


def times(forward: Any) -> list[float]:
    """Standard deviation of the times of readings with uneven stamps [s], by record.

    Stamps that are late by any part of a period do not show when readings were made that are
    themselves uneven: on an even clock these are off by their own jitter, at their stamps by the
    delay. The records of one kind, put back or not, share it.
    """
    deviations = [0.0] * len(forward.records)
    for put_back in (True, False):
        limits, readings = {}, []
        for i, record in enumerate(forward.records):
            late = record.late or 2.0 * float(np.max(np.abs(record.moved.get("q", 0.0))))
            q = record.joints_of(forward.robot(i), "q")
            rows = np.flatnonzero(np.isfinite(q).any(axis=1))
            if late and bool(record.late) is put_back and len(rows) > 1:
                limits[i], every = late, spacing(rows)
                readings.append((q[rows[0] :: every], every * record.dt))
        deviation = jitter(readings)
        for i, late in limits.items():
            deviations[i] = min(deviation, late)
    return deviations


def mistimed(forward: Any, deviations: Sequence[float]) -> list[np.ndarray]:
    """Error of readings by the deviations of their times [s], (T, C) each."""
    errors = []
    for values, record, deviation in zip(
        forward.measured, forward.records, deviations, strict=True
    ):
        error = np.zeros(values.shape)
        for c, column in enumerate(values.T if deviation else ()):
            rows = np.flatnonzero(np.isfinite(column))
            every = spacing(rows) if len(rows) > 1 else 1
            rows_read = slice(rows[0] if len(rows) else 0, None, every)
            error[rows_read, c] = np.nan_to_num(
                deviation * rate(column[rows_read], every * record.dt)
            )
        errors.append(error)
    return errors


def limit_cycle_errors(forward: Any, step: float) -> list[np.ndarray]:
    """Spread of simulations whose drives have limit cycles of other phases, (T, C) each.

    A drive with a quantised encoder oscillates about its target. The phase of this limit cycle
    depends on the smallest differences, and other joints follow: a knee that leaves its stop
    because of a step of the hip may swing a tenth further or less. No model predicts the phase.
    """
    rounding = forward._robot(0, {}, 1.0).encoder_step
    if not rounding > 0.0:
        return [np.zeros(m.shape) for m in forward.measured]
    positions = [
        forward([{"name": "joint_offset", "offset": share * rounding}], {}, step=step)
        for share in (-PHASE, PHASE)
    ]
    times = [forward.nudged(share * rounding)((), {}, step=step) for share in SPEEDS]
    runs = zip(*positions, *times, strict=True)
    deviations = [np.nan_to_num(np.std(each, axis=0, ddof=1)) for each in runs]
    return _largest(deviations, forward.records)


def _largest(errors: Sequence[np.ndarray], records: Sequence[Record]) -> list[np.ndarray]:
    """Largest error about each time, (T, C) each, since it may occur a little earlier or later."""
    return [
        maximum_filter1d(np.abs(error), max(1, round(ABOUT / record.dt)), axis=0, mode="nearest")
        for error, record in zip(errors, records, strict=True)
    ]


def _rms(errors: Sequence[np.ndarray], records: Sequence[Record]) -> list[np.ndarray]:
    """Rms error about each time, (T, C) each, since errors pass through zero."""
    levels = []
    for error, record in zip(errors, records, strict=True):
        width = max(1, round(2.0 * ABOUT / record.dt))
        mean = uniform_filter1d(np.square(error), width, axis=0, mode="nearest")
        levels.append(np.sqrt(np.maximum(mean, 0.0)))  # rounding may make the mean negative
    return levels


def pooled(levels: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """Rms over the measured values of all records, (C,)."""
    pairs = zip(levels, measured, strict=True)
    every = np.concatenate([np.where(np.isfinite(m), e, np.nan) for e, m in pairs])
    count = np.maximum(np.isfinite(every).sum(0), 1)
    return np.sqrt(np.nansum(np.square(every), axis=0) / count)


def finest(forward: Any) -> float:
    """Step ratio to the model's: the finest that is cheap and within the engine's rate limit."""
    rates = [forward._robot(i, {}, 1.0).sim.physics_rate for i in range(len(forward.records))]
    for step in (FINE, 2.0 * FINE) if compiled(forward) and forward.fine_steps else ():
        if 4.0 * max(rates) / step <= FASTEST:
            return step
    return 1.0


def compiled(forward: Any) -> bool:
    """True if no record needs the physics engine, so that fine steps are cheap."""
    return not any(
        needs_engine(forward._robot(i, {}, 1.0), from_list(forward.model.effects))
        for i in range(len(forward.records))
    )


def step_error(
    forward: Any, fine: float, overrides: Mapping[str, Any] | None = None
) -> tuple[dict[float, list[np.ndarray]], list[np.ndarray]]:
    """Error of a model's predictions that is due to its finite physics step.

    Predictions at two steps are extrapolated to a step of zero (Richardson, first order). The error
    of a semi-implicit step acts like a delay of half a step, and would be identified as a delay.

    Args:
        forward: Forward model.
        fine: Step ratio to the model's that the case uses where it can.
        overrides: Values of robot.yaml, over those of the model.

    Returns:
        Correction of a prediction, (T, C) per record, by step; and the remaining error about each
        time, the same shape.
    """
    rate = max(forward._robot(i, {}, 1.0).sim.physics_rate for i in range(len(forward.records)))
    if 4.0 * rate / fine > FASTEST:
        none = [np.zeros(m.shape) for m in forward.measured]  # the step is fine enough
        return {1.0: none}, none
    steps = {1.0, fine, 0.5 * fine, 0.25 * fine}
    runs = {step: forward((), overrides, step=step) for step in sorted(steps)}
    limits = extrapolated(runs[0.5 * fine], runs[0.25 * fine])
    correction = {
        step: [np.nan_to_num(e - p) for e, p in zip(limits, runs[step], strict=True)]
        for step in sorted({1.0, fine})
    }
    coarse = extrapolated(runs[fine], runs[0.5 * fine])
    remains = [np.nan_to_num(a - b) for a, b in zip(limits, coarse, strict=True)]
    return correction, _rms(remains, forward.records)


def extrapolated(full: Sequence[np.ndarray], half: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Predictions, (T, C) each, at a step of zero, from those at a step and at half of it."""
    return [2.0 * h - w for w, h in zip(full, half, strict=True)]
