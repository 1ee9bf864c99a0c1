# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 5: the calibration of Tigrillo against the surrogate robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calibration.parameters import parameter_set
from ..calibration.results import Comparison
from .evidence import Evidence
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
    """Generation of the plateau, final error, and spread of the searches over the initial error."""
    fits = evidence.other("calibration").fits
    errors = np.array([fit.error for fit in fits])
    return {
        "plateau_generation": float(max(fit.plateau for fit in fits)),
        "final_over_initial": float(np.max(errors / [fit.before for fit in fits])),
        "spread_over_initial": float(np.std(errors) / fits[0].before),
    }


@measure
def calibration_ratio(evidence: Evidence) -> Numbers:
    """Error of the default body over that of the best one."""
    best = evidence.other("calibration").best
    return {"ratio": best.before / best.error}


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
    comparison = evidence.other("calibration").comparisons[0]

    def likeness(name: str, lag: float) -> float:
        robot, model = comparison.curves["robot"][:, 0], comparison.curves[name][:, 0]
        rows = round(lag / comparison.period * len(robot))
        return float(np.corrcoef(robot, np.roll(model, rows))[0, 1])

    return {"default": likeness("default", comparison.lag_before),
            "calibrated": likeness("calibrated", comparison.lag_after)}  # fmt: skip


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
    """Smallest distance over 15 s [m] and falls of the optimised bound and walk."""
    _, cases = evidence.study("gaits")
    phase = "open loop"
    return {
        "least_distance": float(min(case.metrics[phase]["distance"] for case in cases)),
        "falls": float(sum(bool(case.verdict["fall"]) for case in cases)),
    }


@measure
def falls_coincide(evidence: Evidence) -> Numbers:
    """Share of actuations with which robot and calibrated model both fall or both stand."""
    _, cases = evidence.study("amplitudes")
    fall_share = {
        variant: np.array([bool(c.verdict["fall"]) for c in cases if c.variant == variant])
        for variant in ("robot", "calibrated", "default")
    }
    return {
        "agree": float(np.mean(fall_share["robot"] == fall_share["calibrated"])),
        "default_agrees": float(np.mean(fall_share["robot"] == fall_share["default"])),
        "robot_falls": float(fall_share["robot"].mean()),
    }
