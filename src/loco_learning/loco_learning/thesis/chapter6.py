# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 6: networks of masses and springs.

A run is a repetition of a search with another seed: one value is a trend over the sizes, or a
number of one gait, within a repetition. Repetitions that lack a size do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from loco_sim.msd.network import Network
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import MsdSimulation

from ..networks import results
from ..networks.gait import MsdResult
from ..networks.results import Results
from .evidence import Evidence
from .registry import NotRunError, Numbers, measure

ALPHA = 0.01  # the regularisation of the thesis
FAST = 4.0  # frequency of claim 6.7 [Hz]
LEAST_NODES = 6  # the thesis calls smaller networks bad in open loop, too
RATIOS = (14.2, 100.0, 127.9)  # k/m of the two ends in the thesis, and of 100 N/m and 1 kg [1/s²]


def _results(evidence: Evidence) -> Results:
    return evidence.other("msd")


def _repetitions(table: Mapping[tuple, Any], what: str) -> list[dict[Any, Any]]:
    """Results of each repetition with all sizes or settings, by the rest of their key.

    Raises:
        NotRunError: There is no result.
    """
    groups: dict[int, dict[Any, Any]] = {}
    for (*key, seed), result in sorted(table.items()):
        groups.setdefault(seed, {})[key[0] if len(key) == 1 else tuple(key)] = result
    if not groups:
        raise NotRunError(f"chapter 6 has no {what}")
    full = max(len(group) for group in groups.values())
    return [group for group in groups.values() if len(group) == full]


def _values(
    groups: Iterable[dict[int, Any]], value: Callable[[Any], float], min_nodes: int = 0
) -> list[dict[int, float]]:
    """A number of each result, by size, for each repetition."""
    return [{n: value(r) for n, r in group.items() if n >= min_nodes} for group in groups]


def _trends(groups: Iterable[Mapping[int, float]]) -> np.ndarray:
    """Spearman's rank correlation of each repetition with the size; NaN below 3 values."""
    return np.array([
        spearmanr(list(g), list(g.values())).statistic if len(set(g.values())) > 2 else np.nan
        for g in groups
    ])  # fmt: skip


def _at(groups: Iterable[Mapping[int, float]], size: int) -> np.ndarray:
    return np.array([group.get(size, np.nan) for group in groups])


def _still_rising(gaits: Iterable[MsdResult]) -> float:
    """Share of the searches whose score still rose at their end."""
    return float(np.mean([results.rising(g) for g in gaits]))


@measure
def score_grows(evidence: Evidence) -> Numbers:
    """Trend of the best score from 6 nodes on, and the score of 5 nodes over that of 3."""
    best = _values(_repetitions(_results(evidence).gaits, "gaits"), lambda g: g.best)
    larger = [{n: v for n, v in group.items() if n >= LEAST_NODES} for group in best]
    return {"rho": _trends(larger), "five_over_three": _at(best, 5) / _at(best, 3),
            "largest_score": np.array([list(g.values())[-1] for g in best])}  # fmt: skip


@measure
def gap_shrinks(evidence: Evidence) -> Numbers:
    """Noisy best minus clean retest: mean up to 5 nodes, and its trend."""
    groups = _repetitions(_results(evidence).gaits, "gaits")
    gaps = _values(groups, lambda g: g.best - g.clean)
    small = [np.mean([v for n, v in g.items() if n < LEAST_NODES] or [np.nan]) for g in gaps]
    return {"rho": _trends(gaps), "small_gap": np.array(small)}


@measure
def convergence(evidence: Evidence) -> Numbers:
    """Trend of the evaluations, and at 3 nodes the last generations' mean score over the best."""
    table = _results(evidence).gaits
    groups = _repetitions(table, "gaits")
    last = _values(groups, lambda g: float(g.course[-20:, 1].mean() / g.best))
    return {"rho": _trends(_values(groups, results.converged_at)), "three_mean_over_best":
            _at(last, 3), "still_rising": _still_rising(table.values())}  # fmt: skip


@measure
def speeds(evidence: Evidence) -> Numbers:
    """Speed of 6 and 20 nodes [km/h], and largest over smallest power by the author's formula."""
    table = _results(evidence).gaits
    groups = _repetitions(table, "gaits")
    speed = _values(groups, lambda g: g.speed * results.KMH)
    watts = [list(g.values()) for g in _values(groups, results.author_power, LEAST_NODES)]
    return {
        "kmh_of_6": _at(speed, 6), "kmh_of_20": _at(speed, 20),
        "power_ratio": np.array([max(w) / min(w) if w else np.nan for w in watts]),
        "still_rising": _still_rising(table.values()),
    }  # fmt: skip


@measure
def resonance(evidence: Evidence) -> Numbers:
    """Frequency of one node on a spring [Hz], of the k/m in `RATIOS`."""
    params = MsdParams(ground="none", gravity=0.0, drag=0.0, nonlinearity=0.0)
    peaks = []
    for ratio in RATIOS:
        network = Network([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [1e9, 1.0], ratio, 0.0)
        simulation = MsdSimulation(network, params)
        simulation.place(np.array([[0.0, 0.0], [1.2, 0.0]]), np.zeros((2, 2)))
        x = simulation.run(12000, every=1).position[:, 1, 0] - 1.0
        up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
        peaks.append((len(up) - 1) / ((up[-1] - up[0]) * params.step))
    return dict(zip(("softest", "usual", "stiffest"), peaks, strict=True))


def _clean_scores(evidence: Evidence) -> list[dict[tuple[int, int], float]]:
    groups = _repetitions(_results(evidence).omega, "gaits at fixed frequencies")
    return [{key: g.clean for key, g in group.items()} for group in groups]


@measure
def bandwidth(evidence: Evidence) -> Numbers:
    """Edges of the -3 dB band of the mean clean score over all sizes [Hz]."""
    rates = _results(evidence).frequencies
    bands = []
    for group in _clean_scores(evidence):
        score = [np.mean([v for (_, j), v in group.items() if j == k]) for k in range(len(rates))]
        bands.append(results.band(np.array(rates), np.array(score)))
    low, high = np.array(bands).T
    return {"low": low, "high": high}


@measure
def high_frequencies(evidence: Evidence) -> Numbers:
    """Clean score above 4 Hz, largest minus smallest network; best score of the smallest one.

    The best score of the smallest network is over the least best score of the remaining.
    """
    fast = [k for k, f in enumerate(_results(evidence).frequencies) if f > FAST]
    gains, ratios = [], []
    for group in _clean_scores(evidence):
        sizes = sorted({n for n, _ in group})
        high = [np.mean([group[n, k] for k in fast]) for n in sizes]
        top = [max(v for (m, _), v in group.items() if m == n) for n in sizes]
        gains.append(high[-1] - high[0])
        ratios.append(top[0] / min(top[1:]))
    return {"fast_gain": np.array(gains), "least_best_ratio": np.array(ratios)}


@measure
def power_budget(evidence: Evidence) -> Numbers:
    """Best rate [Hz], and at it the speed at the largest power [m/s] and the fit up to 15 kW."""
    table = _results(evidence).powers
    rows = []
    for group in _repetitions(table, "gaits with limited power"):
        watts, rates = (sorted(set(each)) for each in zip(*group, strict=True))
        speed = {f: [group[p, f].speed for p in watts] for f in rates}
        best = max(rates, key=lambda f: np.mean(speed[f]))
        low = [k for k, p in enumerate(watts) if p <= 15e3]
        line = np.corrcoef(np.array(watts)[low], np.array(speed[best])[low])
        rows.append((best, speed[best][-1], line[0, 1] ** 2))
    rate, speed_at_end, r2 = np.array(rows).T
    return {"best_rate": rate, "speed_at_most_power": speed_at_end, "r2_to_15_kW": r2,
            "still_rising": _still_rising(table.values())}  # fmt: skip


@measure
def periodicity(evidence: Evidence) -> Numbers:
    """Strong over weak gaits' stretch, and strong minus weak gaits' likeness of cycles."""
    stretch, likeness = [], []
    for group in _repetitions(_results(evidence).powers, "gaits with limited power"):
        watts = sorted({p for p, _ in group})
        weak, strong = (
            np.mean([results.gait_shape(g) for (p, f), g in group.items() if p == w and f >= 3.0],
                    axis=0)
            for w in (watts[0], watts[-1])
        )  # fmt: skip
        stretch.append(strong[0] / weak[0])
        likeness.append(strong[1] - weak[1])
    return {"stretch_ratio": np.array(stretch), "likeness_change": np.array(likeness)}


@measure
def noise_knee(evidence: Evidence) -> Numbers:
    """Relative noise up to which 90 % of the distance are left, of each gait."""
    sweeps = _results(evidence).noise
    if not sweeps:
        raise NotRunError("chapter 6 has no noise on the actuation")
    return {"knee": np.array([results.knee(curves) for curves in sweeps.values()])}


@measure
def training(evidence: Evidence) -> Numbers:
    """Error of the readout of 20 nodes in the first and in the twelfth second [-]."""
    loops = [c for (n, _), c in sorted(_results(evidence).loops.items()) if n == 20]
    if not loops:
        raise NotRunError("chapter 6 has no closed loop of 20 nodes")

    def error(start: float) -> np.ndarray:
        cuts = [(c.arrays["t"] > start) & (c.arrays["t"] < start + 1.0) for c in loops]
        return np.array([c.arrays["error"][cut].mean() for c, cut in zip(loops, cuts, strict=True)])

    return {"first_second": error(0.3), "twelfth_second": error(11.0)}


@measure
def regularisation(evidence: Evidence) -> Numbers:
    """Closed over open loop's distance with 1 % of noise, of each gait.

    The value of the thesis minus the best other value; a gait's share is the median over its
    noises, the best other value that of the largest median over the gaits.
    """
    shares: dict[float, dict[int, list[float]]] = {}
    for (alpha, gait, _), curves in sorted(_results(evidence).alphas.items()):
        shares.setdefault(alpha, {}).setdefault(gait, []).append(results.loop_share(curves))
    gaits = sorted(set.intersection(*(set(each) for each in shares.values()))) if shares else []
    if ALPHA not in shares or len(shares) < 2:
        raise NotRunError("chapter 6 has no closed loops with other regularisations")
    table = {a: np.array([np.median(each[g]) for g in gaits]) for a, each in shares.items()}
    remaining = {a: v for a, v in table.items() if a != ALPHA}
    best = max(remaining, key=lambda a: float(np.median(remaining[a])))
    return {"minus_best": table[ALPHA] - remaining[best], "best_other": best,
            **{f"share_at_{alpha:g}": v for alpha, v in table.items()}}  # fmt: skip


def _loops(evidence: Evidence) -> list[dict[int, Any]]:
    return _repetitions(_results(evidence).loops, "closed loops")


@measure
def closed_loops(evidence: Evidence) -> Numbers:
    """Share of the sizes from 6 nodes on whose closed loop goes more than half as far."""
    shares = _values(_loops(evidence), results.loop_share, LEAST_NODES)
    values = [np.mean([v > 0.5 for v in g.values()]) if len(g) > 2 else np.nan for g in shares]
    return {"stable_sizes": np.array(values)}


@measure
def limit_cycles(evidence: Evidence) -> Numbers:
    """Trend of the roughness of the limit cycles over size."""
    return {"rho": _trends(_values(_loops(evidence), results.roughness))}


@measure
def readout_error(evidence: Evidence) -> Numbers:
    """Trend of the NRMSE from closing on over size."""
    return {"rho": _trends(_values(_loops(evidence), lambda c: c.values["nrmse"]))}


@measure
def parameters(evidence: Evidence) -> Numbers:
    """Numbers that a search of 20 nodes finds: three of each link, and one frequency."""
    gait = _results(evidence).gaits.get((20, 0))
    if gait is None:
        raise NotRunError("chapter 6 has no gait of 20 nodes")
    return {"parameters": 3.0 * len(gait.gait.amplitude) + 1.0}
