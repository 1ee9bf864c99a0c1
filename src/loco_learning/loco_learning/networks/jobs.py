# SPDX-License-Identifier: Apache-2.0
"""Chapter 6 as a list of jobs with one file each: resumable, in processes or on dask.

Stages: gaits of networks of increasing size (figs. 6.1 to 6.3), at fixed frequencies (6.4), with
limited power (6.5); then noise on the actuation (6.7) and closed loops (6.8 to 6.11) of
the first gaits.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError, NameUnknownError
from loco_control.files import write_whole
from loco_control.params import to_dict
from loco_sim.msd.network import chain
from loco_sim.msd.params import NoiseParams
from loco_sim.msd.simulation import MsdSimulation

from .. import archive
from ..jobs import pool
from .gait import Gait, MsdResult, MsdTask, optimise, task
from .reservoir import LOOPS, LoopParams, nrmse, run_loop

log = logging.getLogger(__name__)


def _levels(count: int) -> tuple[float, ...]:
    return tuple(float(v) for v in np.logspace(-6.0, 0.0, count))


@dataclass(frozen=True)
class Plan:
    """Numbers of jobs and their budgets; by default those of the plan ``quick``."""

    nodes: tuple[int, ...] = (3, 4, 5, 6, 8, 10, 12, 15, 20, 26)
    repetitions: int = 10
    disturbed: tuple[int, int] = (10, 1)  # gaits of 20 nodes with noise in their loop; draws of it
    budget: tuple[int, int] = (250, 1500)  # number of evaluations: per node, and constant
    omega_nodes: tuple[int, ...] = (5, 10, 15, 20)
    frequencies: tuple[float, ...] = tuple(float(f) for f in np.logspace(-0.7, 1.0, 10))  # [Hz]
    omega_repetitions: int = 5
    omega_evaluations: int = 1000
    powers: tuple[float, ...] = (500.0, 2.5e3, 7.5e3, 1.5e4, 2e4)  # [W]
    power_frequencies: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0)  # [Hz]
    power_repetitions: int = 1
    power_evaluations: int = 4000
    loop_repetitions: int = 10
    noises: tuple[float, ...] = _levels(25)
    regularisations: tuple[float, ...] = (1e-6, 1e-4, 1e-2, 1.0, 100.0, 1e4)
    search: dict[str, Any] = field(default_factory=dict)  # values of each search's `MsdTask`
    loop: dict[str, Any] = field(default_factory=dict)  # values of each closed loop's `LoopParams`


PLANS = {
    "quick": Plan(),
    "medium": Plan(  # the grid of quick with the budgets of full
        budget=(1100, 3000), omega_evaluations=8000, power_evaluations=15000, noises=_levels(49)
    ),
    "full": Plan(
        nodes=tuple(range(3, 27)),
        disturbed=(10, 10),
        budget=(1100, 3000),
        omega_evaluations=10000,
        powers=(100.0, 500.0, 1e3, 2.5e3, 5e3, 7.5e3, 1e4, 1.25e4, 1.5e4, 1.75e4, 2e4),
        power_repetitions=5,
        power_evaluations=15000,
        noises=_levels(75),
    ),
    "small": Plan(  # the small networks of quick alone: claims 6.1 to 6.3
        nodes=(3, 4, 5, 6), repetitions=5, omega_nodes=(), powers=(), loop_repetitions=0,
        disturbed=(0, 0), noises=(),
    ),
    "loops": Plan(  # gaits of full at the sizes of quick, and their loops: 6.4, 6.10, 6.13 to 6.15
        budget=(1100, 3000), omega_nodes=(), powers=(), regularisations=(), noises=_levels(75)
    ),
    "band": Plan(  # the frequencies of two sizes alone: 6.6 and 6.7
        nodes=(), omega_nodes=(5, 20), omega_evaluations=4000, powers=(), loop_repetitions=0,
        disturbed=(0, 0),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Job:
    """One result: the name of its file without extension, and its inputs."""

    name: str
    task: MsdTask
    loop: LoopParams | None = None  # settings for a closed loop of the gait in `source`
    noises: tuple[float, ...] = ()  # levels for a sweep of actuation noise of that gait
    source: str = ""

    @property
    def cost(self) -> float:
        """Rough duration, so that the longest jobs start first."""
        return self.task.nodes * (self.task.evaluations if not self.source else 2000.0)


def plan(name: str, **changes: Any) -> Plan:
    """One of `PLANS`, with other values of some fields.

    Raises:
        NameUnknownError: The plan, or a field, does not exist.
    """
    if name not in PLANS:
        raise NameUnknownError("plan", name, PLANS)
    for key in changes:
        if key not in (names := [each.name for each in fields(Plan)]):
            raise NameUnknownError("value of a plan of chapter 6", key, names)
    return replace(PLANS[name], **changes)


def gait_jobs(p: Plan, preset: str) -> list[Job]:
    """Optimisations of a plan."""
    jobs = []
    for nodes in p.nodes:
        evaluations = p.budget[0] * nodes + p.budget[1]
        extra = p.disturbed[0] if nodes == biggest(p) else 0
        for seed in range(max(p.repetitions, extra)):
            t = task(preset, nodes=nodes, evaluations=evaluations, seed=seed, **p.search)
            jobs.append(Job(f"nodes_{nodes}_{seed}", t))
    for nodes in p.omega_nodes:
        for k, frequency in enumerate(p.frequencies):
            for seed in range(p.omega_repetitions):
                t = task(preset, nodes=nodes, frequency=frequency, seed=seed,
                         evaluations=p.omega_evaluations, **p.search)  # fmt: skip
                jobs.append(Job(f"omega_{nodes}_{k}_{seed}", t))
    for power in p.powers:
        for frequency in p.power_frequencies:
            for seed in range(p.power_repetitions):
                # Eq. 6.3 as printed stays below 200 for any gait: the powers in the figure are
                # those of the author's code.
                t = task(
                    preset, frequency=frequency, seed=seed, evaluations=p.power_evaluations,
                    power="author", score="budget", power_ref=power, speed_ref=100.0, **p.search,
                )  # fmt: skip
                jobs.append(Job(f"power_{power:g}_{frequency:g}_{seed}", t))
    return jobs


def biggest(p: Plan) -> int:
    """Size of the networks whose loops are disturbed: 20 nodes, as in the thesis."""
    return 20 if 20 in p.nodes else max(p.nodes, default=0)


def later_jobs(p: Plan, preset: str) -> list[Job]:
    """Jobs that need the gaits of earlier jobs."""
    loop, jobs = LOOPS[preset].replace(**p.loop), []
    gaits = {job.name: job for job in gait_jobs(p, preset)}
    for nodes in p.nodes:
        for seed in range(p.loop_repetitions):
            source = f"nodes_{nodes}_{seed}"
            jobs.append(Job(f"loop_{nodes}_{seed}", gaits[source].task, loop, source=source))
    gaits_of_biggest, draws = p.disturbed
    for seed in range(gaits_of_biggest):
        source = f"nodes_{biggest(p)}_{seed}"
        for k, alpha in enumerate(p.regularisations):
            for draw in range(draws):
                settings = loop.replace(regularisation=alpha, noise=0.01, seed=draw)
                name = f"alpha_{k}_{seed}_{draw}"
                jobs.append(Job(name, gaits[source].task, settings, source=source))
        if p.noises:
            jobs.append(Job(f"noise_{seed}", gaits[source].task, noises=p.noises, source=source))
    return jobs


@dataclass(frozen=True, eq=False)
class Curves:
    """Numbers and arrays of a closed loop, or of a noise sweep."""

    values: dict[str, float]
    arrays: dict[str, np.ndarray]


def do(job: Job, folder: str) -> Any:
    """Run one job; gaits that it needs are read from `folder`."""
    if not job.source:
        return optimise(job.task)
    gait = MsdResult.load(Path(folder) / f"{job.source}.npz").gait
    return _loop(job, gait) if job.loop else _noise(job, gait)


def _loop(job: Job, gait: Gait) -> Curves:
    done = run_loop(job.task.params(), gait, job.loop)
    closing, test, end = done.starts
    period = 1.0 / float(gait.frequency)

    def travelled(t: np.ndarray, x: np.ndarray, start: float, stop: float) -> float:
        return float(np.interp(stop, t, x) - np.interp(start, t, x))

    open_loop = _run(job.task, gait, end)
    values = {
        "closed": travelled(done.t, done.distance, end - 10.0, end),
        "open": travelled(*open_loop, end - 10.0, end),
        "nrmse": nrmse(done, closing, end),
        "nrmse_test": nrmse(done, test, end),
        "nrmse_trained": nrmse(done, closing - 2.0, closing),
        "diverged": float(done.diverged),
        "closing": closing, "test": test, "end": end, "period": period,
    }  # fmt: skip
    error = np.sqrt(np.mean((done.said - done.target) ** 2, axis=1))
    sensed = done.sensed[done.t > test]
    centred = sensed - sensed.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    arrays = {"t": done.t, "error": error, "distance": done.distance, "cycle": centred @ axes[:2].T}
    return Curves(values, {key: v.astype(np.float32) for key, v in arrays.items()})


def _run(task: MsdTask, gait: Gait, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and distance [m] of the open loop."""
    network, dt = chain(task.params()), task.params().step
    history = MsdSimulation(network, task.params(), gait.drive()).run(round(seconds / dt), every=1)
    x = network.centre_of_mass(history.position)[:, 0]
    return history.t, x - x[0]


def _noise(job: Job, gait: Gait, repetitions: int = 10) -> Curves:
    """Distance in 10 s with noise of each level, relative to the largest amplitude."""
    network, params = chain(job.task.params()), job.task.params()
    steps = round(10.0 / params.step)
    distance = np.zeros((len(job.noises), repetitions))
    for i, level in enumerate(job.noises):
        noise = NoiseParams(actuation=level * float(np.max(gait.amplitude)))
        for k in range(repetitions):
            simulation = MsdSimulation(network, params, gait.drive(), noise, seed=1000 * i + k)
            simulation.run(steps)
            end = network.centre_of_mass(simulation.position)[0]
            distance[i, k] = end - network.centre_of_mass(network.positions)[0]
    return Curves({}, {"noise": np.array(job.noises), "distance": distance})


# ---- running and saving


def run(
    p: Plan,
    preset: str,
    folder: str | Path,
    workers: int = 2,
    scheduler: str = "",
    on_progress: Callable[[int, int, str], Any] | None = None,
    finished: Path | None = None,
) -> None:
    """Run all jobs of a plan that have no result yet.

    Args:
        p: The plan.
        preset: ``thesis`` or ``author_code``.
        folder: Folder of the files of the jobs.
        workers: Number of processes; 1 runs in this process.
        scheduler: Address of a dask scheduler to use instead, whose workers access `folder` by
            the same path.
        on_progress: Called with the number of finished jobs, of all jobs, and the latest name.
        finished: Folder of another plan, from which results of the same jobs are copied.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stages = [gait_jobs(p, preset), later_jobs(p, preset)]
    total, count = sum(len(stage) for stage in stages), 0
    for stage in stages:
        missing = [job for job in stage if not is_done(job, folder)]
        if finished:
            for job in (job for job in missing if is_done(job, finished)):
                write_whole(folder / f"{job.name}.npz", (finished / f"{job.name}.npz").read_bytes())
            missing = [job for job in missing if not is_done(job, folder)]
        count += len(stage) - len(missing)
        missing.sort(key=lambda job: -job.cost)
        several = workers > 1 and len(missing) > 1
        with pool.start(do, workers=workers if several else 0, scheduler=scheduler) as place:
            for index, result in place.results([(job, str(folder)) for job in missing]):
                _save(missing[index], result, folder)
                count += 1
                if on_progress:
                    on_progress(count, total, missing[index].name)


def remaining(p: Plan, preset: str, folder: Path) -> tuple[int, int]:
    """Number of jobs of a plan without a result, and of all its jobs; arguments as for `run`."""
    jobs = [*gait_jobs(p, preset), *later_jobs(p, preset)]
    return sum(not is_done(job, folder) for job in jobs), len(jobs)


def is_done(job: Job, folder: Path) -> bool:
    """True if the file of a job exists and is from the same job."""
    path = folder / f"{job.name}.npz"
    if not path.is_file():
        return False
    try:
        if not job.source:
            return MsdResult.load(path).task == job.task
        return archive.read(path, "msd_loop")[0]["job"] == _description(job)
    except LocoError as error:
        log.warning("%s is run again: %s", job.name, error)
        return False


def _save(job: Job, result: Any, folder: Path) -> None:
    path = folder / f"{job.name}.npz"
    if isinstance(result, MsdResult):
        result.save(path)
    else:
        meta = {"job": _description(job), "values": result.values}
        archive.write(path, "msd_loop", meta, result.arrays, compress=True)


def load_curves(path: Path) -> Curves:
    """Read a closed loop or a noise sweep."""
    meta, arrays = archive.read(path, "msd_loop")
    return Curves(meta["values"], arrays)


def _description(job: Job) -> dict[str, Any]:
    """Plain values that identify a job, as read back from JSON."""
    loop = asdict(job.loop) if job.loop else None
    values = {"task": to_dict(job.task), "loop": loop, "noises": list(job.noises)}
    return json.loads(json.dumps(values))
