# SPDX-License-Identifier: Apache-2.0
"""The sixteen claims of chapter 6, judged by the results of `jobs`.

The verdict on a claim is agrees, disagrees, or not decided: if the required jobs were not run,
or if more evaluations could change it. Bounds are not from the thesis; each claim states them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from loco_sim.msd.network import Network
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import MsdSimulation

from . import results
from .gait import MsdResult
from .results import Results


@dataclass(frozen=True)
class Verdict:
    """Verdict on a claim."""

    claim: str
    item: str
    wanted: str
    found: str
    verdict: str  # agrees, disagrees, not decided


Judge = Callable[[Results], tuple[str, bool | None]]  # result; whether it agrees, None: undecided

CLAIMS: list[tuple[str, str, str, str, Judge]] = []


def claim(number: str, item: str, expected: str, needs: str = "gaits") -> Callable:
    """Register the function that judges a claim; it returns the measured values and a verdict.

    Args:
        number: Number of the claim.
        item: Figure or line of the thesis.
        expected: The claim with its bounds.
        needs: Part of the results that is required for a verdict.
    """

    def keep(function: Judge) -> Judge:
        CLAIMS.append((number, item, expected, needs, function))
        return function

    return keep


def judge(r: Results) -> list[Verdict]:
    """Verdicts of all claims, in order."""
    verdicts = []
    for number, item, expected, needs, function in CLAIMS:
        result, verdict = f"no {needs}", "not decided"
        if not needs or getattr(r, needs):
            try:
                result, right = function(r)
                verdict = {True: "agrees", False: "disagrees"}.get(right, "not decided")
            except (KeyError, IndexError, ValueError) as error:
                result = f"lacks results ({error})"
        verdicts.append(Verdict(number, item, expected, result, verdict))
    return verdicts


def _unless_rising(text: str, right: bool, gaits: Iterable[MsdResult]):
    """Verdict that is undecided if more evaluations could change it."""
    share = float(np.mean([results.rising(g) for g in gaits]))
    text += f"; {share:.0%} of the searches still rose at their end"
    return text, None if share > 0.5 else right


def _rank(x: list[float], y: list[float]) -> float:
    """Spearman's rank correlation."""
    if len(x) < 3:
        raise ValueError(f"a trend over {len(x)} sizes")
    return float(spearmanr(x, y).statistic)


def _means(values: dict[int, np.ndarray], low: int = 0) -> tuple[list[int], list[float]]:
    sizes = [n for n in values if n >= low]
    return sizes, [float(values[n].mean()) for n in sizes]


@claim("6.1", "Fig. 6.1", "score falls from 3 to 5 nodes, rises from 6 (rho > 0.7), saturates")
def _score_grows(r: Results):
    best = r.over_sizes(lambda g: g.best)
    sizes, means = _means(best, 6)
    rho, three, five = _rank(sizes, means), best[3].mean(), best[5].mean()
    text = f"rho {rho:.2f} from 6 nodes on; 3 nodes {three:.3f}, 5 nodes {five:.3f}"
    text += f", 6 {means[0]:.3f}, {sizes[-1]} {means[-1]:.3f}"
    return text, rho > 0.7 and five < three


@claim("6.2", "Fig. 6.1", "noisy best minus clean retest: > 0.02 up to 5 nodes, rho < -0.5")
def _gap_shrinks(r: Results):
    sizes, gaps = _means(r.over_sizes(lambda g: g.best - g.clean))
    rho, small = _rank(sizes, gaps), np.mean([v for n, v in zip(sizes, gaps, strict=True) if n < 6])
    text = f"rho {rho:.2f}; gap {small:.3f} up to 5 nodes, {gaps[-1]:.3f} at {sizes[-1]}"
    return text, rho < -0.5 and small > 0.02


@claim("6.3", "Fig. 6.2", "larger networks take longer (rho > 0.7); 3 nodes do not converge")
def _convergence(r: Results):
    sizes, evaluations = _means(r.over_sizes(results.converged_at))
    rho = _rank(sizes, evaluations)
    share = {
        n: np.mean([g.course[-20:, 1].mean() / g.best for (m, _), g in r.gaits.items() if m == n])
        for n in (3, sizes[-1])
    }
    text = f"rho {rho:.2f}; last generations' mean over best: {share[3]:.0%} at 3 nodes, "
    text += f"{share[sizes[-1]]:.0%} at {sizes[-1]}"
    if share[3] < 0.5:
        return _unless_rising(text, rho > 0.7, r.gaits.values())
    return text, False


@claim("6.4", "Fig. 6.3", "15 km/h (6 nodes) to 30 km/h (20), within 2 x; power varies < 2 x")
def _speeds(r: Results):
    speed = {n: v.mean() * results.KMH for n, v in r.over_sizes(lambda g: g.speed).items()}
    watts = {n: v.mean() for n, v in r.over_sizes(results.author_power).items() if n >= 6}
    ratio = max(watts.values()) / min(watts.values())
    text = f"{speed[6]:.1f} and {speed[20]:.1f} km/h; power by the author's formula "
    text += f"{min(watts.values()):.0f} to {max(watts.values()):.0f} W ({ratio:.1f} x)"
    fits = 7.5 <= speed[6] <= 30.0 and 15.0 <= speed[20] <= 60.0
    if ratio < 2.0:
        return _unless_rising(text, fits, r.gaits.values())
    return text, False


@claim("6.5", "T:1675", "resonance of one node is sqrt(k/m) / 2 pi: 0.6 to 1.8 Hz", "")
def _resonance(_: Results):
    params = MsdParams(ground="none", gravity=0.0, drag=0.0, nonlinearity=0.0)
    peaks = []
    for ratio in (14.2, 100.0, 127.9):
        network = Network([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [1e9, 1.0], ratio, 0.0)
        simulation = MsdSimulation(network, params)
        simulation.place(np.array([[0.0, 0.0], [1.2, 0.0]]), np.zeros((2, 2)))
        x = simulation.run(12000, every=1).position[:, 1, 0] - 1.0
        up = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
        peaks.append((len(up) - 1) / ((up[-1] - up[0]) * params.step))
    text = "k/m 14.2, 100, 127.9 /s² swing at " + ", ".join(f"{f:.2f}" for f in peaks) + " Hz"
    return text, bool(np.allclose(peaks, [0.6, 1.592, 1.8], atol=0.01))


@claim("6.6", "Fig. 6.4b", "-3 dB band 0.3 to 5.2 Hz, edges within 50 %", "omega")
def _bandwidth(r: Results):
    (low, high), band_half = results.band(r), results.band(r, 0.5)
    text = f"{low:.2f} to {high:.1f} Hz (half the score, as the author's code: "
    text += f"{band_half[0]:.2f} to {band_half[1]:.1f} Hz)"
    fits = [0.15 <= a <= 0.45 and 2.6 <= b <= 7.8 for a, b in ((low, high), band_half)]
    return text, any(fits)


@claim(
    "6.7", "Fig. 6.4a", "larger networks still converge above 4 Hz; 5 nodes score least", "omega"
)
def _high_frequencies(r: Results):
    sizes = sorted({n for n, _, _ in r.omega})
    fast = [k for k, f in enumerate(r.frequencies) if f > 4.0]

    def score(n: int, ks: list[int]) -> float:
        return float(np.mean([g.clean for (m, k, _), g in r.omega.items() if m == n and k in ks]))

    high = [score(n, fast) for n in sizes]
    top = [max(score(n, [k]) for k in range(len(r.frequencies))) for n in sizes]
    text = "score above 4 Hz " + ", ".join(
        f"{n}: {v:.3f}" for n, v in zip(sizes, high, strict=True)
    )
    text += "; best " + ", ".join(f"{n}: {v:.3f}" for n, v in zip(sizes, top, strict=True))
    return text, high[-1] > high[0] and int(np.argmin(top)) == 0


@claim(
    "6.8", "Fig. 6.5", "3 Hz best; speed linear in power to 15 kW; 14 ± 3 m/s at 20 kW", "powers"
)
def _power(r: Results):
    rates = sorted({f for _, f, _ in r.powers})
    watts = sorted({p for p, _, _ in r.powers})
    speed = {f: [results.power_speed(r, p, f) for p in watts] for f in rates}
    best = max(rates, key=lambda f: np.mean(speed[f]))
    line = np.corrcoef(
        [p for p in watts if p <= 15e3], speed[best][: sum(p <= 15e3 for p in watts)]
    )
    text = f"best at {best:g} Hz; {speed[best][-1]:.1f} m/s at {watts[-1] / 1e3:g} kW; "
    text += f"linear to 15 kW with r² {line[0, 1] ** 2:.2f}"
    fits = best == 3.0 and 11.0 <= speed[best][-1] <= 17.0 and line[0, 1] ** 2 > 0.8
    return _unless_rising(text, bool(fits), r.powers.values())


@claim(
    "6.9",
    "T:1728",
    "strong gaits stretch springs more and repeat less from cycle to cycle",
    "powers",
)
def _periodicity(r: Results):
    watts = sorted({p for p, _, _ in r.powers})
    fast = [(key, g) for key, g in sorted(r.powers.items()) if key[1] >= 3.0]
    weak, strong = (
        np.mean([results.gait_shape(g) for (power, *_), g in fast if power == w], axis=0)
        for w in (watts[0], watts[-1])
    )
    text = f"stretch {weak[0]:.0%} and {strong[0]:.0%}, likeness of cycles {weak[1]:.2f} and "
    text += f"{strong[1]:.2f} at {watts[0]:g} and {watts[-1]:g} W"
    return text, bool(strong[0] > weak[0] and strong[1] < weak[1])


@claim(
    "6.10",
    "Fig. 6.7",
    "distance falls from a relative noise of 0.01 on (knee in 0.01 to 0.1)",
    "noise",
)
def _noise_knee(r: Results):
    at = results.knee(r.noise)
    return f"90 % of the distance are left up to {at:.2g}", 0.01 <= at <= 0.1


@claim(
    "6.11", "Fig. 6.8", "12 s train the readout: error then below 1 % of the rest lengths", "loops"
)
def _training(r: Results):
    loop = r.loops[20, 0]
    t, error = loop.arrays["t"], loop.arrays["error"]
    first, last = error[(t > 0.3) & (t < 1.3)].mean(), error[(t > 11.0) & (t < 12.0)].mean()
    return f"error {first:.4f} in the first second, {last:.4f} in the twelfth", last < 0.01


@claim(
    "6.12",
    "§6.3.2",
    "alpha = 0.01 is a good compromise: within 10 % of the best test speed",
    "alphas",
)
def _alpha(r: Results):
    share = {a: results.loop_share(c) for a, c in sorted(r.alphas.items())}
    text = ", ".join(f"{a:g}: {v:.0%}" for a, v in share.items())
    return f"closed over open distance with 1 % noise: {text}", share[0.01] > 0.9 * max(
        share.values()
    )


@claim("6.13", "Fig. 6.9", "closed over open loop distance > 0.5 from 6 nodes on", "loops")
def _closed(r: Results):
    ratio = {n: v for n, v in results.loop_ratio(r).items() if n >= 6}
    if len(ratio) < 3:
        raise ValueError(f"closed loops of {len(ratio)} sizes")
    stable = [n for n, v in ratio.items() if v > 0.5]
    text = f"{len(stable)} of {len(ratio)} sizes; " + ", ".join(
        f"{n}: {v:.2f}" for n, v in ratio.items()
    )
    return text, len(stable) >= 0.8 * len(ratio)


@claim(
    "6.14", "Fig. 6.10", "limit cycles smoother with size (rho < -0.5 of their roughness)", "loops"
)
def _cycles(r: Results):
    sizes, groups = list(r.loops_by_size), r.loops_by_size.values()
    roughnesses = [float(np.median([results.roughness(c) for c in loops])) for loops in groups]
    text = ", ".join(f"{n}: {v:.2f}" for n, v in zip(sizes, roughnesses, strict=True))
    rho = _rank(sizes, roughnesses)
    return f"rho {rho:.2f}; {text}", rho < -0.5


@claim("6.15", "Fig. 6.11", "NRMSE from closing on falls with size (rho < -0.5)", "loops")
def _nrmse(r: Results):
    sizes, groups = list(r.loops_by_size), r.loops_by_size.values()
    error = [float(np.mean([c.values["nrmse"] for c in loops])) for loops in groups]
    text = ", ".join(f"{n}: {v:.3f}" for n, v in zip(sizes, error, strict=True))
    rho = _rank(sizes, error)
    return f"rho {rho:.2f}; {text}", rho < -0.5


@claim("6.16", "T:1621", "163 parameters for 20 nodes")
def _count(r: Results):
    links = len(r.gaits[20, 0].gait.amplitude)
    return f"3 x {links} + 1 = {3 * links + 1}", 3 * links + 1 == 163
