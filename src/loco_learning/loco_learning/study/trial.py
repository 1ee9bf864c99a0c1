# SPDX-License-Identifier: Apache-2.0
"""Verdict on a run: the failed criteria, by how much, and lag and frequency of the gait."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..metrics import quantities, signals
from ..params import CriterionParams
from ..reflex.schedule import CLOSING
from ..runs.log import Log

CONFIDENCE = 0.9  # of intervals of shares and medians [-]
TAIL = 10.0  # frequency and lag are reported for the last seconds of a run [s]


@dataclass(frozen=True)
class Verdict:
    """Outcome of a trial. Numbers are NaN if the prediction drove for less than a stride."""

    survived: bool  # no criterion failed
    failed: list[str]  # names of `CriterionParams` that failed
    fall: str  # reason of the fall; empty if there was none
    end: float  # simulated time reached [s]
    nrmse: float = float("nan")  # largest smoothed NRMSE while the prediction drove [-]
    amplitude: float = float("nan")  # smallest stride amplitude over the target's [-]
    slip: float = float("nan")  # largest absolute lag [stride]
    lag: float = float("nan")  # lag at the end, positive behind [stride]
    frequency: float = float("nan")  # frequency of the prediction in the last 10 s [Hz]
    target_frequency: float = float("nan")  # frequency of the target in the last 10 s [Hz]

    def as_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)


@dataclass(frozen=True)
class Course:
    """Prediction compared with its target, tick by tick while it drives."""

    t: np.ndarray = field(repr=False)  # [s], (T,)
    nrmse: np.ndarray = field(repr=False)  # smoothed over one stride [-], (T,)
    lag: np.ndarray = field(repr=False)  # [stride], (T,)
    amplitude: np.ndarray = field(repr=False)  # over the target's, two strides long [-], (T,)


def driven(log: Log) -> Log:
    """The part of a run in which the prediction drives: closing and test."""
    if not log.experiment.learner.enabled:
        return log.cut(slice(0, 0))
    return log.cut(slice(int(np.searchsorted(log.phase, CLOSING)), None))


def course(log: Log) -> Course | None:
    """Comparison of a run, None if the prediction drove for less than two strides."""
    log = driven(log)
    if not len(log) or len(log) < 2 * quantities.period(log):
        return None
    stride = quantities.period(log)
    target, prediction = quantities.target_and_prediction(log)
    amplitude = np.nanmedian(signals.stride_amplitude(target, 2 * stride))
    return Course(
        log.t,
        signals.smoothed_nrmse(target, prediction, stride),
        quantities.lag(log),
        signals.stride_amplitude(prediction, 2 * stride) / amplitude,
    )


def judge(log: Log, criterion: CriterionParams | None = None) -> Verdict:
    """Verdict on a run by a failure criterion, by default that of its experiment."""
    courses = course(log)
    numbers = _numbers(log, courses) if courses else {}
    end = float(log.t[-1]) if len(log) else 0.0
    bounds = criterion or log.experiment.criterion
    failed = [
        name
        for name, fails in {
            "fall": bounds.fall and bool(log.fall),
            "phase_slip": numbers.get("slip", 0.0) >= bounds.phase_slip,
            "freeze": numbers.get("amplitude", 1.0) < bounds.freeze,
            "nrmse": numbers.get("nrmse", 0.0) > bounds.nrmse,
        }.items()
        if fails
    ]
    return Verdict(not failed, failed, log.fall, end, **numbers)


def _numbers(log: Log, course: Course) -> dict[str, float]:
    tail = driven(log)
    tail = tail.cut(slice(max(0, len(tail) - round(TAIL / log.dt)), None))
    target, prediction = quantities.target_and_prediction(tail)
    return {
        "nrmse": float(np.max(course.nrmse)),
        "amplitude": float(np.nanmin(course.amplitude)),
        "slip": float(np.max(np.abs(course.lag))),
        "lag": float(course.lag[-1]),
        "frequency": signals.stride_frequency(prediction, log.dt),
        "target_frequency": signals.stride_frequency(target, log.dt),
    }


def share_interval(values: np.ndarray) -> tuple[float, float]:
    """Interval of a share at `CONFIDENCE` (Clopper and Pearson), from values 0 or 1, (n,)."""
    from scipy.stats import beta  # takes long to import

    hits, count, tail = int(np.sum(values)), len(values), (1.0 - CONFIDENCE) / 2.0
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return low, high
