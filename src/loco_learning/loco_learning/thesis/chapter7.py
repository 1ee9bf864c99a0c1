# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 7 and section 9: compliance of HyQ in open and closed loop.

Accuracy and NRMSE are those of eq. (3.36) and (3.37) with the range of the author's code, over
all 16 outputs. A value is that of one network (seed), if its measure names no other run.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import linregress, spearmanr

from ..metrics import signals
from ..params import OPEN
from ..reflex.senses import FootForces
from ..runs import experiment as experiments
from ..runs.experiment import Experiment
from ..runs.rollout import build, rollout
from ..study import maps
from ..study.case import CaseResult
from ..study.maps import Sheet
from .evidence import Evidence, by_seed, column, curves
from .registry import LEAST_RUNS, Numbers, measure

UNDER = {"kp": (107.0, np.inf), "kappa": (0.0, 0.1)}  # parts of the map of impedances
TUNED = {"kp": (50.0, 1500.0), "kappa": (0.3, 2.0)}
OVER = {"kp": (50.0, np.inf), "kappa": (3.0, np.inf)}
SOFT, STIFF = 75.0, 1000.0  # the "compliant" and the "stiff" robot [N·m/rad]
TICK = 0.004  # control period at which the network has to answer [s]


def _sheet(evidence: Evidence, name: str = "map") -> tuple[Sheet, maps.MapSpec]:
    study, cases = evidence.study(name)
    return maps.sheets(study, cases)[0], study.map


@measure
def regions(evidence: Evidence) -> Numbers:
    """For each region of the map, whether each impedance behaves as in the region, 0 or 1."""
    regions_by_name = maps.regions(*_sheet(evidence)).items()
    return {name: region.found[region.where].astype(float) for name, region in regions_by_name}


@measure
def damping(evidence: Evidence) -> Numbers:
    """Under- and overdamped impedances over the median of good ones: falls, power, impacts, trunk.

    One value is that of one impedance.
    """
    sheet, _ = _sheet(evidence)

    def at(place: dict, name: str) -> np.ndarray:
        return sheet.columns[name][sheet.within({**place, "survived": (0.0, 1.0)})]

    def over_good(name: str) -> np.ndarray:
        best = at(TUNED, name)
        return at(UNDER, name) / np.nanmedian(best) if np.isfinite(best).any() else np.array([])

    underdamped = at(UNDER, "stability")
    return {
        "falls_underdamped": 1.0 - at(UNDER, "survived"),
        "falls_good": 1.0 - at(TUNED, "survived"),
        "power_ratio": over_good("positive_power"), "impact_ratio": over_good("grf_max"),
        "overdamped_shake_ratio": at(OVER, "stability") / np.nanmedian(underdamped)
        if np.isfinite(underdamped).any() else np.array([]),
    }  # fmt: skip


def _open_loop(evidence: Evidence, metric: str) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness [N·m/rad] and a metric of the open loop under drawn pushes, (seeds, n)."""
    _, cases = evidence.study("open_loop")
    return curves(cases, "kp", metric, OPEN)


@measure
def compliant_and_stiff(evidence: Evidence) -> Numbers:
    """Open-loop metrics at 1000 N·m/rad over those at 75, of each run."""
    numbers = {}
    for name in ("stability", "power", "speed", "grf_max"):
        kp, values = _open_loop(evidence, name)
        soft, stiff = (int(np.argmin(np.abs(kp - k))) for k in (SOFT, STIFF))
        numbers[f"{name}_ratio"] = values[:, stiff] / values[:, soft]
    return numbers


def _stiff_over_soft(cases: list[CaseResult], metric: str) -> np.ndarray:
    """A metric of the test of the stiff robot over that of the soft one, of each seed."""
    ratios = []
    for group in by_seed(cases):
        soft, stiff = (_mean(column(group, metric, "test", v)) for v in ("compliant", "stiff"))
        ratios.append(stiff / soft)
    return np.array(ratios)


def _mean(values: np.ndarray) -> float:
    """Mean of the numbers; NaN without one."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _loops(evidence: Evidence, metric: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness [N·m/rad], (n,), and a metric in open and closed loop, (seeds, n) each."""
    _, cases = evidence.study("stiffness")
    kp, opened = curves(cases, "kp", metric, "train")
    return kp, opened, curves(cases, "kp", metric, "test")[1]


def _each(function: Callable, *tables: np.ndarray) -> np.ndarray:
    """A number of each seed's rows; NaN if a row has no number."""
    return np.array([
        function(*rows) if all(np.isfinite(row).any() for row in rows) else np.nan
        for rows in zip(*tables, strict=True)
    ])  # fmt: skip


@measure
def cost_rises(evidence: Evidence) -> Numbers:
    """Linear fit of the logarithm of the closed loop's cost of transport over stiffness."""
    kp, _, closed = _loops(evidence, "cost_of_transport")
    fits = []
    for cost in closed:
        valid = np.isfinite(cost) & (cost > 0.0)
        if valid.sum() > 2:
            fit = linregress(kp[valid], np.log(cost[valid]))
            fits.append((fit.rvalue**2, 1000.0 * fit.slope))
    r2, slope = np.array(fits).reshape(-1, 2).T
    return {"r2": r2, "slope_per_1000": slope, "softest_cost": closed[:, 0],
            "stiffest_cost": closed[:, -1]}  # fmt: skip


@measure
def crossing(evidence: Evidence) -> Numbers:
    """Closed over open loop's cost of transport with the softest and the stiffest legs."""
    _, opened, closed = _loops(evidence, "cost_of_transport")
    ratio = closed / opened
    return {"ratio_softest": ratio[:, 0], "ratio_stiffest": ratio[:, -1],
            "least": _each(np.nanmin, ratio)}  # fmt: skip


@measure
def never_better(evidence: Evidence) -> Numbers:
    """Least ratio of the costs of transport and largest of the speeds, closed over open loop."""
    _, opened, closed = _loops(evidence, "cost_of_transport")
    _, open_speed, closed_speed = _loops(evidence, "speed")
    return {"least_cost_ratio": _each(np.nanmin, closed / opened),
            "speed_ratio": _each(np.nanmax, closed_speed / open_speed)}  # fmt: skip


@measure
def speed_peak(evidence: Evidence) -> Numbers:
    """Stiffness of the highest closed-loop speed, metrics beyond it, and power's share of cost."""
    kp, _, speed = _loops(evidence, "speed")
    _, _, step = _loops(evidence, "step_length")
    _, _, power = _loops(evidence, "power")
    _, _, cost = _loops(evidence, "cost_of_transport")

    def share(power: np.ndarray, cost: np.ndarray) -> float:
        valid = np.isfinite(cost) & (cost > 0.0) & (power > 0.0)
        logs = np.cov(np.log(power[valid]), np.log(cost[valid]))
        return logs[0, 1] / logs[1, 1]

    return {
        "peak_at": _each(lambda v: kp[np.nanargmax(v)], speed),
        "last_over_peak": _each(lambda v: v[-1] / np.nanmax(v), speed),
        "step_last_over_peak": _each(lambda s, v: s[-1] / s[np.nanargmax(v)], step, speed),
        "share_of_power": _each(share, power, cost),
    }  # fmt: skip


@measure
def open_speed_peak(evidence: Evidence) -> Numbers:
    """Open-loop speed at both ends over that at the peak which the other runs have.

    The highest of several noisy values is above the ends by chance; the peak of the other runs
    is not chosen by the run that it is compared with.
    """
    kp, speed = _open_loop(evidence, "speed")
    first, last, at = [], [], []
    for i, run in enumerate(speed):
        remaining = np.delete(speed, i, axis=0)
        if not len(remaining) or not np.isfinite(remaining).all(axis=0).any():
            continue
        peak = int(np.nanargmax(np.mean(remaining, axis=0)))
        first.append(run[0] / run[peak])
        last.append(run[-1] / run[peak])
        at.append(kp[peak])
    return {"first_over_peak": np.array(first), "last_over_peak": np.array(last),
            "peak_at": np.array(at)}  # fmt: skip


@measure
def accuracy_steady(evidence: Evidence) -> Numbers:
    """Largest over smallest accuracy; impacts and oscillation, stiffest over softest."""
    _, _, accuracy = _loops(evidence, "accuracy_author")
    _, _, force = _loops(evidence, "grf_max")
    _, _, shake = _loops(evidence, "stability")
    return {"accuracy_spread": _each(lambda v: np.nanmax(v) / np.nanmin(v), accuracy),
            "impact_ratio": force[:, -1] / force[:, 0],
            "shake_ratio": shake[:, -1] / shake[:, 0]}  # fmt: skip


def _rho(x: np.ndarray, y: np.ndarray) -> float:
    valid = np.isfinite(x) & np.isfinite(y)
    return float(spearmanr(x[valid], y[valid]).statistic) if valid.sum() > 3 else np.nan


def _complexity(evidence: Evidence, variant: str) -> Numbers:
    """Rank correlations of a robot's accuracy with M, N, speed and stability, of each seed."""
    _, cases = evidence.study("complexity")
    rows = []
    for group in by_seed([case for case in cases if case.variant == variant]):
        accuracy = column(group, "accuracy_author", "test")
        with_size = [_rho(np.array([float(c.at[axis]) for c in group]), accuracy) for axis in "MN"]
        with_behaviour = [
            _rho(accuracy, column(group, name, "test")) for name in ("speed", "stability")
        ]
        rows.append(with_size + with_behaviour)
    names = ("rho_M", "rho_N", "rho_speed", "rho_range_of_height")
    return dict(zip(names, np.array(rows).T, strict=True))


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
    """Best accuracy of the networks that train at 250 Hz, compliant over stiff, of each seed.

    Also the slowest training step [ms], which tells whether 250 Hz excludes a network at all.
    """
    _, cases = evidence.study("complexity")
    ratios, soft_best = [], []
    for group in by_seed(cases):
        time, accuracy = (
            column(group, "step_time", "train"),
            column(group, "accuracy_author", "test"),
        )
        soft = np.array([case.variant == "compliant" for case in group])
        best = [
            float(np.nanmax(accuracy[(time < TICK) & kind], initial=0.0)) for kind in (soft, ~soft)
        ]
        ratios.append(best[0] / best[1] if best[1] else np.inf)
        soft_best.append(best[0])
    slowest = 1e3 * float(np.nanmax(column(cases, "step_time", "train")))
    return {"compliant_over_stiff": np.array(ratios), "compliant_accuracy": np.array(soft_best),
            "slowest_ms": slowest}  # fmt: skip


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
    return {"nrmse_ratio": _stiff_over_soft(closest, "nrmse_author"),
            "shake_ratio": _stiff_over_soft(closest, "stability")}  # fmt: skip


@measure
def impacts(evidence: Evidence) -> Numbers:
    """Correlation of height range and impacts, and the share of power explained by stiffness."""
    _, cases = evidence.study("complexity")
    rho, explained = [], []
    for group in by_seed(cases):
        rho.append(_rho(column(group, "stability", "test"), column(group, "grf_max", "test")))
        power = np.log(np.maximum(column(group, "positive_power", "test"), 1e-3))
        soft = np.array([case.variant == "compliant" for case in group])
        finite = np.isfinite(power)
        parts = power[finite & soft], power[finite & ~soft]
        total = float(np.sum((power[finite] - power[finite].mean()) ** 2))
        within = sum(float(np.sum((p - p.mean()) ** 2)) for p in parts if len(p))
        explained.append(1.0 - within / total)
    return {"rho_shake_impact": np.array(rho), "power_by_stiffness": np.array(explained)}


@measure
def real_like(evidence: Evidence) -> Numbers:
    """The network on the real-like HyQ, compared with the ideal one, of each seed."""
    _, cases = evidence.study("real_like")
    runs = [c for c in cases if c.variant == "real_like"]

    def ratio(metric: str, over: str, under: str) -> np.ndarray:
        return np.array([
            _mean(column(g, metric, "test", over)) / _mean(column(g, metric, "test", under))
            for g in by_seed(cases)
        ])  # fmt: skip

    return {
        "survived": np.array([float(not c.verdict["fall"]) for c in runs]),
        "nrmse": column(runs, "nrmse_author", "test"),
        "roll_ratio": ratio("roll_range", "real_like", "ideal"),
        "disturbed_nrmse_ratio": ratio("nrmse_author", "disturbed_real_like", "disturbed"),
    }


def _forces(experiment: Experiment, seed: int) -> np.ndarray:
    """Vertical forces on the feet in an open loop of 12 s [N], the last 8 s, (T, 4)."""
    changes = {"learner.enabled": False, "learner.train": 11.0, "learner.closing": 0.0,
               "learner.test": 0.0}  # fmt: skip
    return rollout(experiments.override(experiment, changes), seed).grf[-2000:, :, 2]


@measure
def force_filter(evidence: Evidence) -> Numbers:
    """Phase and amplitude of raw and filtered forces, compared with those of the ideal plant.

    One value is that of one draw of the noise and of the pushes.
    """
    variants = evidence.planned("real_like").variants
    ideal = _forces(variants["ideal"], 0)
    scale = float(np.mean(np.ptp(ideal, axis=0)))
    angle = 1.7 * TICK * np.arange(len(ideal))
    rows = []
    for seed in range(LEAST_RUNS):
        raw = _forces(variants["real_like"], seed)
        step = FootForces(variants["real_like"].learner).grf_filter.step
        filtered = np.array([step(row).copy() for row in raw])
        errors = [abs(float(np.mean(np.ptp(f, axis=0))) / scale - 1.0) for f in (raw, filtered)]
        lag = signals.phase_lag(raw, filtered, angle, round(1.0 / (1.7 * TICK)))
        improved = errors[1] / errors[0] if errors[0] else np.inf
        rows.append((abs(float(np.nanmedian(lag))), improved, errors[0]))
    names = ("phase_shift_strides", "filtered_over_raw", "raw_amplitude_error")
    return dict(zip(names, np.array(rows).T, strict=True))
