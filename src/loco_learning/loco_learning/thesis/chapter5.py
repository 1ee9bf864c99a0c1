# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 5: the calibration of Tigrillo against the surrogate robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calibration.parameters import parameter_set
from ..calibration.results import Comparison
from ..params import OPEN
from .evidence import Evidence, column
from .registry import Numbers, measure

BOUND, WALK = "surrogate_bound", "surrogate_walk"


def _comparison(evidence: Evidence, name: str) -> Comparison:
    return next(c for c in evidence.other("calibration").comparisons if c.name == name)


def _bodies(evidence: Evidence, name: str) -> tuple[float, np.ndarray]:
    """Default value of a body parameter, and its values from all searches."""
    result = evidence.other("calibration")
    default = parameter_set(result.options["parameters"]).default[name]
    return default, np.array([fit.values[name] for fit in result.fits])


@measure
def calibration_converges(evidence: Evidence) -> Numbers:
    """Generation of the plateau and final error of each search.

    Also its distance from the median of the searches; errors are over the initial error.
    """
    fits = evidence.other("calibration").fits
    errors = np.array([fit.error / fit.before for fit in fits])
    return {
        "plateau_generation": np.array([float(fit.plateau) for fit in fits]),
        "final_over_initial": errors,
        "distance_from_median": np.abs(errors - np.median(errors)),
    }


@measure
def calibration_ratio(evidence: Evidence) -> Numbers:
    """Error of the default body over that of the body of each search."""
    fits = evidence.other("calibration").fits
    return {"ratio": np.array([fit.before / fit.error for fit in fits])}


@measure
def calibrated_body(evidence: Evidence) -> Numbers:
    """Hind over front stiffness, and contact depths over their defaults, medians of searches."""
    values: dict[str, Any] = {}
    for part in ("front", "hind"):
        values[part] = np.median(_bodies(evidence, f"stiffness_{part}")[1])
        default, calibrated = _bodies(evidence, f"depth_{part}")
        values[f"{part}_depth_ratio"] = float(np.median(calibrated) / default)
    ratio = float(values.pop("hind") / values.pop("front"))
    return {"hind_over_front": ratio, **values}


@measure
def slip_is_seen(evidence: Evidence) -> Numbers:
    """Correlation of the left front knee's average period with the robot's.

    Each model is compared at its lag from the windowed error: the slip lasts a tenth of a second,
    and a robot with a delay of the commands has it at another phase.
    """
    result = evidence.other("calibration")
    comparison = result.comparisons[0]

    def likeness(name: str, lag: float) -> float:
        robot, model = comparison.curves["robot"][:, 0], comparison.curves[name][:, 0]
        rows = round(lag / comparison.period * len(robot))
        return float(np.corrcoef(robot, np.roll(model, rows))[0, 1])

    return {"default": likeness("default", comparison.lag_before),
            "calibrated": likeness("calibrated", comparison.lag_after),
            "searches": float(len(result.fits))}  # fmt: skip


@measure
def bound_transfers(evidence: Evidence) -> Numbers:
    """Bound that was not fitted: error ratio, spread between periods, and largest slopes."""
    comparison = _comparison(evidence, BOUND)
    slope = {k: float(np.max(np.abs(np.diff(comparison.curves[k], axis=0))))
             for k in ("robot", "default", "calibrated")}  # fmt: skip
    mean_spread = {
        k: float(np.mean(comparison.curves[f"{k}_spread"])) for k in ("default", "calibrated")
    }
    return {
        "ratio": comparison.ratio("thesis"),
        "spread_ratio": mean_spread["calibrated"] / mean_spread["default"],
        "calibrated_slope": slope["calibrated"] / slope["robot"],
        "default_slope": slope["default"] / slope["robot"],
    }


@measure
def walk_transfers(evidence: Evidence) -> Numbers:
    """Walk that was not fitted: error ratio, lag, and whether the default model falls."""
    comparison = _comparison(evidence, WALK)
    return {"ratio": comparison.ratio("thesis"), "lag_ms": 1e3 * comparison.lag_after,
            "default_falls": float(bool(comparison.fall_before))}  # fmt: skip


@measure
def gaits_travel(evidence: Evidence) -> Numbers:
    """Distance over 15 s [m] of the bound and of the walk, and whether they fell, 0 or 1."""
    _, cases = evidence.study("gaits")
    numbers: dict[str, Any] = {}
    for gait in ("bound", "walk"):
        numbers[f"{gait}_distance"] = column(cases, "distance", OPEN, gait)
        runs = [case for case in cases if case.variant == gait]
        numbers[f"{gait}_fell"] = np.array([float(bool(c.verdict["fall"])) for c in runs])
    return numbers


@measure
def falls_coincide(evidence: Evidence) -> Numbers:
    """For each actuation, whether robot and model both fall or both stand, 0 or 1."""
    _, cases = evidence.study("amplitudes")
    falls = {
        variant: np.array([float(bool(c.verdict["fall"])) for c in cases if c.variant == variant])
        for variant in ("robot", "calibrated", "default")
    }
    return {
        "agree": (falls["robot"] == falls["calibrated"]).astype(float),
        "default_agrees": (falls["robot"] == falls["default"]).astype(float),
        "robot_falls": falls["robot"],
    }
