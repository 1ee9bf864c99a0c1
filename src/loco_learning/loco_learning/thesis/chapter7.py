# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 7 and section 9: compliance of HyQ in open and closed loop."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.stats import linregress, spearmanr

from ..metrics import signals
from ..reflex.senses import FootForces
from ..runs import experiment as experiments
from ..runs.rollout import build, rollout
from ..study import maps
from ..study.case import CaseResult
from ..study.maps import Sheet
from .evidence import Evidence, column, over
from .registry import Numbers, measure

UNDER = {"kp": (107.0, np.inf), "kappa": (0.0, 0.1)}  # parts of the map of impedances
GOOD = {"kp": (50.0, 1500.0), "kappa": (0.3, 2.0)}
OVER = {"kp": (50.0, np.inf), "kappa": (3.0, np.inf)}
TICK = 0.004  # control period at which the network has to answer [s]


def _sheet(evidence: Evidence, name: str = "map") -> tuple[Sheet, maps.MapSpec]:
    study, cases = evidence.study(name)
    return maps.sheets(study, cases)[0], study.map


@measure
def regions(evidence: Evidence) -> Numbers:
    """Share of each region of the map in which the robot has the behaviour of the region."""
    return {name: region.share for name, region in maps.regions(*_sheet(evidence)).items()}


@measure
def damping(evidence: Evidence) -> Numbers:
    """Under- and overdamped impedances compared with good ones: falls, power, impacts, trunk."""
    sheet, _ = _sheet(evidence)

    def middle(place: dict, name: str) -> float:
        values = sheet.columns[name][sheet.within({**place, "survived": (0.0, 1.0)})]
        return float(np.nanmedian(values)) if np.isfinite(values).any() else np.nan

    def falls(place: dict) -> float:
        survived = sheet.columns["survived"][sheet.within({**place, "survived": (0.0, 1.0)})]
        return float(1.0 - survived.mean()) if survived.size else np.nan

    return {
        "falls_underdamped": falls(UNDER),
        "falls_good": falls(GOOD),
        "power_ratio": middle(UNDER, "positive_power") / middle(GOOD, "positive_power"),
        "impact_ratio": middle(UNDER, "grf_max") / middle(GOOD, "grf_max"),
        "overdamped_shake_ratio": middle(OVER, "stability") / middle(UNDER, "stability"),
    }


@measure
def compliant_and_stiff(evidence: Evidence) -> Numbers:
    """Open-loop metrics of the stiff robot over those of the compliant one."""
    _, cases = evidence.study("complexity")
    names = ("stability", "power", "speed", "grf_max")
    return {f"{name}_ratio": _stiff_over_soft(cases, name, "train") for name in names}


def _stiff_over_soft(cases: list[CaseResult], metric: str, phase: str) -> float:
    soft, stiff = (
        float(np.nanmean(column(cases, metric, phase, name))) for name in ("compliant", "stiff")
    )
    return stiff / soft


def _curves(evidence: Evidence, metric: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness [N·m/rad], and a metric in open and closed loop at each."""
    _, cases = evidence.study("stiffness")
    kp, opened = over(cases, "kp", metric, "train")
    return kp, opened, over(cases, "kp", metric, "test")[1]


@measure
def cost_rises(evidence: Evidence) -> Numbers:
    """Linear fit of the logarithm of the closed loop's cost of transport over stiffness."""
    kp, _, closed = _curves(evidence, "cost_of_transport")
    valid = np.isfinite(closed) & (closed > 0.0)
    if valid.sum() < 3:
        return {}
    fit = linregress(kp[valid], np.log(closed[valid]))
    costs = {"softest_cost": closed[valid][0], "stiffest_cost": closed[valid][-1]}
    return {"r2": fit.rvalue**2, "slope_per_1000": 1000.0 * fit.slope, **costs}


@measure
def crossing(evidence: Evidence) -> Numbers:
    """Closed over open loop's cost of transport with the softest and the stiffest legs."""
    _, opened, closed = _curves(evidence, "cost_of_transport")
    ratio = closed / opened
    return {"ratio_softest": ratio[0], "ratio_stiffest": ratio[-1], "least": np.nanmin(ratio)}


@measure
def never_better(evidence: Evidence) -> Numbers:
    """Closed over open loop's cost of transport and speed, over all stiffnesses."""
    _, opened, closed = _curves(evidence, "cost_of_transport")
    _, at_low_speed, at_high_speed = _curves(evidence, "speed")
    return {
        "least_cost_ratio": np.nanmin(closed / opened),
        "speed_ratio": np.nanmax(at_high_speed / at_low_speed),
    }


@measure
def speed_peak(evidence: Evidence) -> Numbers:
    """Stiffness of the highest closed-loop speed, metrics beyond it, and power's share of cost."""
    kp, _, speed = _curves(evidence, "speed")
    _, _, step = _curves(evidence, "step_length")
    _, _, power = _curves(evidence, "power")
    _, _, cost = _curves(evidence, "cost_of_transport")
    best = int(np.nanargmax(speed))
    valid = np.isfinite(cost) & (cost > 0.0) & (power > 0.0)
    logs = np.cov(np.log(power[valid]), np.log(cost[valid]))
    return {
        "peak_at": kp[best], "last_over_peak": speed[-1] / speed[best],
        "step_last_over_peak": step[-1] / step[best], "share_of_power": logs[0, 1] / logs[1, 1],
    }  # fmt: skip


@measure
def open_speed_peak(evidence: Evidence) -> Numbers:
    """Stiffness of the highest open-loop speed, and the speeds at both ends over it."""
    kp, speed, _ = _curves(evidence, "speed")
    best = int(np.nanargmax(speed))
    first, last = speed[0] / speed[best], speed[-1] / speed[best]
    return {"peak_at": kp[best], "first_over_peak": first, "last_over_peak": last}


@measure
def accuracy_steady(evidence: Evidence) -> Numbers:
    """Spread of the accuracy over stiffness; impacts and oscillation, stiffest over softest."""
    _, _, accuracy = _curves(evidence, "accuracy")
    _, _, force = _curves(evidence, "grf_max")
    _, _, shake = _curves(evidence, "stability")
    return {
        "accuracy_spread": np.nanmax(accuracy) / np.nanmin(accuracy),
        "impact_ratio": force[-1] / force[0], "shake_ratio": shake[-1] / shake[0],
    }  # fmt: skip


def _rho(x: np.ndarray, y: np.ndarray) -> float:
    valid = np.isfinite(x) & np.isfinite(y)
    return float(spearmanr(x[valid], y[valid]).statistic) if valid.sum() > 3 else np.nan


def _complexity(evidence: Evidence, variant: str) -> Numbers:
    """Rank correlations of a robot's accuracy with M, N, speed and stability."""
    _, cases = evidence.study("complexity")
    cases_of_variant = [case for case in cases if case.variant == variant]
    accuracy = column(cases_of_variant, "accuracy", "test")
    size = {
        axis: np.array([case.at[axis] for case in cases_of_variant], dtype=float) for axis in "MN"
    }
    return {
        "rho_M": _rho(size["M"], accuracy), "rho_N": _rho(size["N"], accuracy),
        "rho_speed": _rho(accuracy, column(cases_of_variant, "speed", "test")),
        "rho_range_of_height": _rho(accuracy, column(cases_of_variant, "stability", "test")),
    }  # fmt: skip


@measure
def complexity_compliant(evidence: Evidence) -> Numbers:
    """Rank correlations of the compliant robot's accuracy."""
    return _complexity(evidence, "compliant")


@measure
def complexity_stiff(evidence: Evidence) -> Numbers:
    """Rank correlations of the stiff robot's accuracy."""
    return _complexity(evidence, "stiff")


@measure
def training_time(evidence: Evidence) -> Numbers:
    """Slowest training step, and the best accuracy of networks that train at 250 Hz."""
    _, cases = evidence.study("complexity")
    time, accuracy = column(cases, "step_time", "train"), column(cases, "accuracy", "test")
    soft = np.array([case.variant == "compliant" for case in cases])
    in_time = time < TICK
    best = [float(np.nanmax(accuracy[in_time & kind], initial=0.0)) for kind in (soft, ~soft)]
    return {
        "slowest_ms": 1e3 * np.nanmax(time), "compliant_accuracy": best[0],
        "compliant_over_stiff": best[0] / best[1] if best[1] else np.inf,
    }  # fmt: skip


@measure
def operations(evidence: Evidence) -> Numbers:
    """Multiplications in one step of the network, counted in its matrices (eq. 7.3)."""
    counts = {}
    for size in (50, 80):
        changes = {"learner.memory": size, "learner.neurons": size}
        loop = build(experiments.load("hyq_compliant", changes))
        loop.close()
        hidden, readout = loop.reflex.hidden.weights, loop.reflex.readout.weights
        counts[f"operations_{size}"] = float(hidden.size + readout.size)
    return counts


@measure
def trajectories(evidence: Evidence) -> Numbers:
    """Error and trunk motion in the test, stiff over compliant, for M and N closest to 50."""
    _, cases = evidence.study("complexity")
    distance = min(abs(c.at["M"] - 50) + abs(c.at["N"] - 50) for c in cases)
    closest = [c for c in cases if abs(c.at["M"] - 50) + abs(c.at["N"] - 50) == distance]
    return {
        "nrmse_ratio": _stiff_over_soft(closest, "nrmse", "test"),
        "shake_ratio": _stiff_over_soft(closest, "stability", "test"),
    }


@measure
def impacts(evidence: Evidence) -> Numbers:
    """Correlation of height range and impacts, and the share of power explained by stiffness."""
    _, cases = evidence.study("complexity")
    shake, force = column(cases, "stability", "test"), column(cases, "grf_max", "test")
    power = np.log(np.maximum(column(cases, "positive_power", "test"), 1e-3))
    soft = np.array([case.variant == "compliant" for case in cases])
    finite = np.isfinite(power)
    within = sum(float(np.sum((p - p.mean()) ** 2)) for p in (power[finite & soft],
                                                              power[finite & ~soft]))  # fmt: skip
    total = float(np.sum((power[finite] - power[finite].mean()) ** 2))
    return {"rho_shake_impact": _rho(shake, force), "power_by_stiffness": 1.0 - within / total}


@measure
def real_like(evidence: Evidence) -> Numbers:
    """The network on the real-like HyQ, compared with the ideal one."""
    _, cases = evidence.study("real_like")

    def of(variant: str, metric: str) -> float:
        values = column(cases, metric, "test", variant)
        return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan

    cases_of_variant = [c for c in cases if c.variant == "real_like"]
    return {
        "survived": float(np.mean([not c.verdict["fall"] for c in cases_of_variant])),
        "nrmse": of("real_like", "nrmse"),
        "roll_ratio": of("real_like", "roll_range") / of("ideal", "roll_range"),
        "disturbed_nrmse_ratio": of("disturbed_real_like", "nrmse") / of("disturbed", "nrmse"),
    }


@cache
def _forces(name: str, effects: bool) -> np.ndarray:
    """Vertical forces on the feet in an open loop of 12 s [N], the last 8 s, (T, 4)."""
    changes = {"learner.enabled": False, "learner.train": 11.0, "learner.closing": 0.0,
               "learner.test": 0.0}  # fmt: skip
    log = rollout(experiments.load(name, changes if effects else {**changes, "effects": []}))
    return log.grf[-2000:, :, 2]


@measure
def force_filter(evidence: Evidence) -> Numbers:
    """Phase and amplitude of raw and filtered forces, compared with those of the ideal plant."""
    raw, ideal = _forces("hyq_real_like", True), _forces("hyq_real_like", False)
    step = FootForces(experiments.load("hyq_real_like").learner).grf_filter.step
    filtered = np.array([step(row).copy() for row in raw])
    scale = float(np.mean(np.ptp(ideal, axis=0)))
    errors = [abs(float(np.mean(np.ptp(f, axis=0))) / scale - 1.0) for f in (raw, filtered)]
    angle = 1.7 * TICK * np.arange(len(raw))
    lag = signals.phase_lag(raw, filtered, angle, round(1.0 / (1.7 * TICK)))
    return {
        "phase_shift_strides": abs(float(np.nanmedian(lag))), "raw_amplitude_error": errors[0],
        "filtered_over_raw": errors[1] / errors[0] if errors[0] else np.inf,
    }  # fmt: skip
