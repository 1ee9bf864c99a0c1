# SPDX-License-Identifier: Apache-2.0
"""Results of chapter 6 from a folder, and the quantities computed from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from loco_control.exceptions import LocoError
from loco_sim.msd.network import chain
from loco_sim.msd.simulation import MsdSimulation

from .gait import MsdResult, driving_power
from .jobs import Curves, Plan, gait_jobs, later_jobs, load_curves

KMH = 3.6  # per m/s


@dataclass
class Results:
    """All files of a folder that belong to a plan."""

    gaits: dict[tuple[int, int], MsdResult] = field(default_factory=dict)  # nodes, seed
    omega: dict[tuple[int, int, int], MsdResult] = field(default_factory=dict)  # nodes, f, seed
    powers: dict[tuple[float, float, int], MsdResult] = field(default_factory=dict)  # W, Hz, seed
    loops: dict[tuple[int, int], Curves] = field(default_factory=dict)
    alphas: dict[tuple[float, int, int], Curves] = field(default_factory=dict)  # gait, noise
    noise: dict[int, Curves] = field(default_factory=dict)  # by gait
    frequencies: tuple[float, ...] = ()
    preset: str = "thesis"

    @property
    def sizes(self) -> list[int]:
        """Numbers of nodes with a gait."""
        return sorted({nodes for nodes, _ in self.gaits})

    @property
    def loops_by_size(self) -> dict[int, list[Curves]]:
        """Closed loops of each network size, by repetition."""
        groups: dict[int, list[Curves]] = {}
        for (nodes, _), curves in sorted(self.loops.items()):
            groups.setdefault(nodes, []).append(curves)
        return groups

    def over_sizes(self, value: Callable[[MsdResult], float]) -> dict[int, np.ndarray]:
        """A number of each gait, by network size."""
        return {
            n: np.array([value(r) for (m, _), r in sorted(self.gaits.items()) if m == n])
            for n in self.sizes
        }


def load(p: Plan, preset: str, folder: str | Path) -> Results:
    """Read all available results of a plan."""
    folder = Path(folder)
    out = Results(frequencies=p.frequencies, preset=preset)
    for job in (*gait_jobs(p, preset), *later_jobs(p, preset)):
        kind, *key = job.name.split("_")
        path = folder / f"{job.name}.npz"
        try:
            result = load_curves(path) if job.source else MsdResult.load(path)
        except LocoError:
            continue
        if kind == "nodes":
            out.gaits[int(key[0]), int(key[1])] = result
        elif kind == "omega":
            out.omega[int(key[0]), int(key[1]), int(key[2])] = result
        elif kind == "power":
            out.powers[float(key[0]), float(key[1]), int(key[2])] = result
        elif kind == "loop":
            out.loops[int(key[0]), int(key[1])] = result
        elif kind == "alpha":
            out.alphas[job.loop.regularisation, int(key[1]), int(key[2])] = result
        else:
            out.noise[int(key[0])] = result
    return out


def converged_at(g: MsdResult) -> float:
    """Evaluations until the smoothed mean score of the generations reaches 90 % of its maximum."""
    mean = np.convolve(g.course[:, 1], np.ones(9) / 9.0, mode="valid")
    return float(g.population * (np.argmax(mean >= 0.9 * mean.max()) + 5))


def rising(g: MsdResult) -> bool:
    """True if the mean score of the last eighth of the generations is 3 % above that before."""
    span = max(1, len(g.course) // 8)
    last, before = g.course[-span:, 1].mean(), g.course[-2 * span : -span, 1].mean()
    return bool(last > 1.03 * before)


def author_power(g: MsdResult) -> float:
    """Power of a gait by the author's formula, for any setting of its task [W]."""
    task = g.task.replace(power="author")
    return float(driving_power(task, chain(task.params()), g.gait))


def band(f: np.ndarray, score: np.ndarray, level: float = 2.0**-0.5) -> tuple[float, float]:
    """Frequencies between which a score exceeds `level` of its maximum [Hz].

    Args:
        f: Frequencies, increasing [Hz], (n,).
        score: Score at each, (n,).
        level: Share of the maximum; -3 dB by default.
    """
    above = np.flatnonzero(score >= level * score.max())

    def crossing(inner: int, outer: int) -> float:
        if not 0 <= outer < len(f):
            return float(f[inner])
        share = (score[inner] - level * score.max()) / (score[inner] - score[outer])
        return float(np.exp(np.log(f[inner]) + share * np.log(f[outer] / f[inner])))

    return crossing(above[0], above[0] - 1), crossing(above[-1], above[-1] + 1)


def power_speed(r: Results, power: float, frequency: float) -> float:
    """Mean clean speed of the gaits at a power and frequency [m/s]."""
    return float(
        np.mean([g.speed for (p, f, _), g in r.powers.items() if (p, f) == (power, frequency)])
    )


def gait_shape(g: MsdResult) -> tuple[float, float]:
    """99th percentile of spring stretch [-], and correlation of node heights one cycle apart."""
    network, params = chain(g.task.params()), g.task.params()
    simulation = MsdSimulation(network, params, g.gait.drive())
    simulation.run(1000)
    z = simulation.run(1000, every=1).position
    i, j = network.links.T
    stretch = np.linalg.norm(z[:, j] - z[:, i], axis=-1) / network.rest - 1.0
    cycle = round(1.0 / (float(g.gait.frequency) * params.step))
    a, b = z[:-cycle, :, 1], z[cycle:, :, 1]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    likeness = np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b))
    return float(np.percentile(np.abs(stretch), 99.0)), float(likeness)


def knee(c: Curves) -> float:
    """Relative noise above which the smoothed distance stays below 90 % of the undisturbed."""
    distance = c.arrays["distance"].mean(axis=1)
    width = max(1, len(distance) // 10) | 1
    smooth = np.convolve(np.pad(distance, width // 2, mode="edge"), np.ones(width) / width, "valid")
    plateau = smooth >= 0.9 * smooth[: len(smooth) // 3].mean()
    last = np.flatnonzero(plateau)
    return float(c.arrays["noise"][last[-1]])


def loop_share(c: Curves) -> float:
    """Distance in the last 10 s, closed over open loop; 0 if the open loop does not move."""
    return c.values["closed"] / c.values["open"] if abs(c.values["open"]) > 0.01 else 0.0


def roughness(c: Curves) -> float:
    """Distance of the limit cycle to itself one period later, over its size; inf at rest."""
    path, dt = c.arrays["cycle"], float(c.arrays["t"][1] - c.arrays["t"][0])
    lag = min(max(1, round(c.values["period"] / dt)), len(path) // 2)
    distance = np.linalg.norm(path[lag:] - path[:-lag], axis=1)
    size = float(np.mean(np.sum(path**2, axis=1)))
    return float(np.sqrt(np.mean(distance**2) / size)) if size > 1e-3 else np.inf
