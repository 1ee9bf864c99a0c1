# SPDX-License-Identifier: Apache-2.0
"""Step one of a mass-spring-damper network: a gait by CMA-ES, with a saturated cost of transport.

Each link has an amplitude, a phase and a stiffness; the frequency is common to all, or fixed. A
generation is simulated by one call of the batched kernel. Source: thesis section 6.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from loco_control.params import Params, from_dict, parameter, to_dict
from loco_sim.msd.network import Network, chain
from loco_sim.msd.params import MsdParams, NoiseParams, preset
from loco_sim.msd.simulation import Drive, MsdSimulation

from .. import archive
from ..search.cma import Search

SATURATION = math.atanh(1.0 / math.sqrt(2.0))  # C of the author's code


@dataclass(frozen=True)
class MsdTask(Params):
    """One optimisation. Defaults are those of the thesis; see `task` for the author's."""

    preset: str = parameter("thesis", "constants of the network, a name of loco_sim.msd.params")
    nodes: int = parameter(20, "nodes of the network", low=2, high=1000)
    total_mass: float = parameter(20.0, "mass of all nodes", "kg", low=0.0)
    duration: float = parameter(10.0, "length of an evaluation", "s", low=0.1)
    frequency: float = parameter(0.0, "of the actuation; 0 is searched", "Hz", low=0.0)
    max_frequency: float = parameter(10.0, "upper bound of the search", "Hz", low=0.0)
    max_amplitude: float = parameter(0.25, "upper bound of the relative amplitudes", low=0.0)
    max_stiffness: float = parameter(100.0, "upper bound of the stiffnesses", "N/m", low=0.0)
    speed_ref: float = parameter(10.0, "V_ref of eq. 6.4", "m/s", low=1e-9)
    power_ref: float = parameter(3600.0, "P_ref of eq. 6.4", "W", low=1e-9)
    power: str = parameter(
        "thesis",
        "thesis: eq. 6.3 as written, an energy; cycle: that energy once per cycle, a power; "
        "author: sum of k (a l)² omega of the author's code",
        choices=("thesis", "cycle", "author"),
    )
    score: str = parameter(
        "product",
        "product: eq. 6.4; budget: the power counts only above power_ref (author's powersat)",
        choices=("product", "budget"),
    )
    saturation: float = parameter(1.0, "factor in both tanh, 0.881 in the author's code", low=0.0)
    noisy: bool = parameter(True, "disturb the evaluations with the noise of the preset")
    noise_of: str = parameter("", "preset whose noise that is; empty: `preset`")
    dampers_of: str = parameter("", "preset whose dampers the links have; empty: `preset`")
    evaluations: int = parameter(15000, "stop after so many", low=1)
    sigma: float = parameter(0.2, "first step size in the unit box", low=1e-6, high=1.0)
    seed: int = parameter(0, "of the search and its noise", low=0)

    def params(self) -> MsdParams:
        """Parameters of the network."""
        dampers = preset(self.dampers_of or self.preset).params
        return preset(self.preset).params.replace(
            nodes=self.nodes, total_mass=self.total_mass, stiffness=self.max_stiffness,
            damping=dampers.damping, damper=dampers.damper,
        )  # fmt: skip

    def noise(self) -> NoiseParams:
        """Disturbances of the evaluations."""
        return preset(self.noise_of or self.preset).noise if self.noisy else NoiseParams()


def task(name: str, **changes: Any) -> MsdTask:
    """Optimisation under a preset: ``thesis`` or ``author_code``, with changes."""
    settings = {}
    if name == "author_code":  # its experiment on the number of nodes uses 1 Hz: facts, 5.4
        settings = {
            "frequency": 1.0, "max_stiffness": 1000.0, "power": "author",
            "saturation": SATURATION,
        }  # fmt: skip
    preset(name)
    return MsdTask(**{"preset": name, **settings, **changes})


@dataclass(frozen=True, eq=False)
class Gait:
    """Actuation and stiffness of a network; for several networks, with a leading axis."""

    amplitude: np.ndarray  # relative to the rest lengths [-], (links,)
    phase: np.ndarray  # [rad], (links,)
    stiffness: np.ndarray  # [N/m], (links,)
    frequency: np.ndarray | float  # [Hz]

    def drive(self) -> Drive:
        """The gait as input of the simulation."""
        return Drive(self.amplitude, self.phase, self.frequency, self.stiffness)


def decode(task: MsdTask, links: int, x: np.ndarray) -> Gait:
    """Gait from a point (…, 3 links [+ 1]) of the unit box: eq. (6.2)."""
    amplitude, phase, stiffness = (x[..., k * links : (k + 1) * links] for k in range(3))
    searched = task.frequency == 0.0
    frequency = task.max_frequency * x[..., 3 * links] if searched else task.frequency
    return Gait(
        task.max_amplitude * amplitude, 2.0 * np.pi * phase, task.max_stiffness * stiffness,
        frequency,
    )  # fmt: skip


def driving_power(task: MsdTask, network: Network, gait: Gait) -> np.ndarray:
    """P of eq. (6.3) in its three variants, see `MsdTask.power`."""
    beta = task.params().nonlinearity
    energy = gait.stiffness * (gait.amplitude * network.rest) ** 2
    if task.power == "author":
        return 2.0 * np.pi * np.asarray(gait.frequency) * energy.sum(axis=-1)
    total = np.sum(energy * (1.0 + (beta * gait.amplitude) ** 2), axis=-1) / (4.0 * np.pi)
    return total * np.asarray(gait.frequency) if task.power == "cycle" else total


def score(task: MsdTask, speed: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Saturated cost of transport, eq. (6.4), larger is better; 0 if the simulation diverged."""
    c = task.saturation
    with np.errstate(divide="ignore", invalid="ignore"):
        thrift = np.tanh(c * task.power_ref / np.maximum(power, 1e-12))
        if task.score == "budget":
            thrift = np.where(power <= task.power_ref, 1.0, thrift)
        return np.nan_to_num(np.tanh(c * speed / task.speed_ref) * thrift)


class Evaluator:
    """Simulator for populations of gaits of one task: `size` gaits in one call."""

    def __init__(self, task: MsdTask, size: int, with_noise: bool | None = None, threads: int = 1):
        self.task, self.network = task, chain(task.params())
        shape = (size, self.network.count)
        stiff = np.full(shape, task.max_stiffness)
        noise = task.noise() if with_noise is None or with_noise == task.noisy else NoiseParams()
        self.simulation = MsdSimulation(
            self.network, task.params(), Drive(np.zeros(shape), np.zeros(shape), 0.0, stiff),
            noise, threads=threads,
        )  # fmt: skip
        self.steps = round(task.duration / task.params().step)

    def __call__(self, gait: Gait, seeds: np.ndarray) -> tuple[np.ndarray, ...]:
        """Score [-], speed [m/s] and power [W] of each gait, (size,) arrays."""
        self.simulation.replace(gait.drive(), seeds)
        start = self.network.centre_of_mass(self.network.positions)[0]
        self.simulation.run(self.steps)
        with np.errstate(invalid="ignore", over="ignore"):
            end = self.network.centre_of_mass(self.simulation.position)[..., 0]
            speed = np.where(np.abs(end) < 1e6, (end - start) / self.task.duration, np.nan)
        power = driving_power(self.task, self.network, gait)
        return score(self.task, speed, power), np.nan_to_num(speed), power


@dataclass(frozen=True, eq=False)
class MsdResult:
    """Result and history of an optimisation."""

    task: MsdTask
    gait: Gait
    best: float  # score of the best evaluation, including the luck of its noise
    clean: float  # score of the same gait without noise
    speed: float  # [m/s], without noise
    power: float  # [W]
    retested: np.ndarray  # scores with new noise
    course: np.ndarray  # best, mean and best-so-far score of each generation, (G, 3)
    parameters: int
    population: int

    def save(self, path: str | Path) -> None:
        """Write to a ``.npz`` file."""
        meta = {
            "task": to_dict(self.task), "parameters": self.parameters,
            "population": self.population,
            **{key: getattr(self, key) for key in ("best", "clean", "speed", "power")},
        }  # fmt: skip
        arrays = {key: np.asarray(value) for key, value in vars(self.gait).items()}
        archive.write(
            path, "msd_gait", meta,
            {**arrays, "retested": self.retested, "course": self.course.astype(np.float32)},
        )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> MsdResult:
        """Read a file of `save`."""
        with archive.reading(path, "msd_gait") as (meta, arrays):
            keys = ("amplitude", "phase", "stiffness", "frequency")
            return cls(
                from_dict(MsdTask, meta.pop("task")), Gait(*(arrays.pop(key) for key in keys)),
                **meta, **arrays,
            )  # fmt: skip


def optimise(task: MsdTask, on_progress: Callable[[int, float], Any] | None = None) -> MsdResult:
    """Search a gait by CMA-ES with its default population.

    Args:
        task: Gait to search and settings of the search.
        on_progress: Called after each generation with the number of evaluations and the best score.
    """
    links = chain(task.params()).count
    count = 3 * links + (task.frequency == 0.0)
    unit_box = {"low": np.zeros(count), "high": np.ones(count), "start": np.full(count, 0.5)}
    problem = SimpleNamespace(names=[f"x{i}" for i in range(count)], **unit_box)
    search = Search(problem, task.seed, task.sigma, 0)
    evaluator = Evaluator(task, search.size)
    course: list[tuple[float, float, float]] = []
    best, best_x = -np.inf, np.full(count, 0.5)
    while len(course) * search.size < task.evaluations:
        x = np.array(search.ask())
        first = (np.uint64(task.seed) << np.uint64(40)) + np.uint64(len(course) * search.size)
        seeds = first + np.arange(search.size, dtype=np.uint64)
        scores, _, _ = evaluator(decode(task, links, x), seeds)
        if scores.max() > best:
            best, best_x = float(scores.max()), x[scores.argmax()]
        course.append((float(scores.max()), float(scores.mean()), best))
        if on_progress:
            on_progress(len(course) * search.size, best)
        if search.tell(list(-scores)):
            break
    gait = decode(task, links, best_x)
    clean, speed, power = (float(v[0]) for v in evaluate(task, gait, 1, with_noise=False))
    retested = evaluate(task, gait, 16, with_noise=True)[0]
    return MsdResult(
        task, gait, best, clean, speed, power, retested, np.array(course), count, search.size
    )


def evaluate(
    task: MsdTask, gait: Gait, times: int, with_noise: bool, seed: int = 10**9
) -> tuple[np.ndarray, ...]:
    """Score, speed and power of one gait, simulated `times` times, (times,) each."""
    evaluator = Evaluator(task, times, with_noise)
    many = Gait(
        *(np.tile(v, (times, 1)) for v in (gait.amplitude, gait.phase, gait.stiffness)),
        np.full(times, float(gait.frequency)),
    )
    return evaluator(many, seed + np.arange(times))
