# SPDX-License-Identifier: Apache-2.0
"""Comparison of four ways to a gait on equal simulated time, to judge the three learning steps.

============  ====================================================================
evolution     CMA-ES searches the gait all the time; oscillators drive, in open loop
two steps     CMA-ES, then FORCE trains the reflex (thesis section 3.5)
three steps   CMA-ES, FORCE, and the policy gradient in the remaining time
ppo           PPO from a readout of zeros, without a gait to imitate
============  ====================================================================

Each seed has one search: a way with a shorter search uses the best result of its beginning, which
is what a search of that length finds. All controllers are then tested in the same way (`trials`).
Finished cases are in the journal, so a comparison can be interrupted at any time; its searches and
the third step are resumed, too.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.checks import keys_of
from loco_control.exceptions import MissingPackageError, ParameterError
from loco_control.params import Params, parameter, to_dict
from loco_learning.gaits.search import GaitProblem, GaitSearchParams
from loco_learning.jobs import pool
from loco_learning.jobs.journal import Journal
from loco_learning.jobs.kept import versions
from loco_learning.reinforce import learn as gradient
from loco_learning.reinforce.episode import first_weights
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.trials import TrialParams, judge
from loco_learning.runs.experiment import Experiment, load
from loco_learning.search import evaluations
from loco_learning.search.population import PopulationParams, minimise

RECORD = "cases.jsonl"
METHODS = ("evolution", "two steps", "three steps", "ppo")


@dataclass(frozen=True)
class ContestParams(Params):
    """Budget of each way, and how it is divided."""

    seconds: float = parameter(600.0, "simulated time of each way (taste)", "s", 1.0, 1e7)
    seeds: int = parameter(5, "seeds of each way (taste)", "-", 1, 1000)
    gait: str = parameter("tigrillo_bound", "gait that CMA-ES searches (taste)")
    reflex: str = parameter("tigrillo_bound_reflex", "experiment of the network (taste)")
    rollout: float = parameter(
        10.0, "of the gait search (battery: gaits that are searched over 6 s fall later)",
        "s", 1.0, 1e3,
    )  # fmt: skip
    population: int = parameter(10, "of the gait search (as `loco optimise`)", "-", 2, 1000)
    share: float = parameter(
        0.5, "of the time for the gait, where reinforcement follows (taste)", "-", 0.01, 0.99
    )
    gradient: ReinforceParams = parameter(
        ReinforceParams(batch=8), "of the third step (taste: more updates in little time)"
    )
    trials: TrialParams = parameter(TrialParams(count=4), "test of each controller")


@dataclass(frozen=True)
class Case:
    """One way with one seed."""

    method: str
    seed: int
    seconds: float  # simulated time of learning, including FORCE and searches [s]
    wall: float  # wall-clock time of learning [s]
    rows: dict[str, dict[str, float]]  # values of `trials.Row` by condition
    reason: str = ""  # why there is no controller to test


def run(
    params: ContestParams,
    folder: Path,
    workers: int = 2,
    report: Callable[[Case, int, int], Any] | None = None,
) -> list[Case]:
    """All ways with all seeds, seed by seed; finished cases in the folder are not run again.

    Args:
        params: Settings.
        folder: Folder of the record, and of a folder for each case.
        workers: Number of processes; 0 runs all in this process.
        report: Called after each case with it and the numbers of finished and of all cases.

    Raises:
        ParameterError: The folder has another comparison.
    """
    engine = load(params.reflex).sim_params.engine
    header = {"kind": "contest", "format": 1, "versions": versions(), "engine": engine}
    header |= {k: v for k, v in to_dict(params).items() if k != "seeds"}
    record = Journal(folder / RECORD, header, keys_of(Case, reason=str))
    jobs_to_do = [(method, seed) for seed in range(params.seeds) for method in METHODS]
    names = [field.name for field in dataclasses.fields(Case)]
    done = [Case(*(row[name] for name in names)) for row in record.rows]
    cases = {(case.method, case.seed): case for case in done}
    todo = [key for key in jobs_to_do if key not in cases]
    try:
        with pool.start(searched, (params, folder), min(workers, len(todo))) as jobs:
            for _ in jobs.results([(seed,) for seed in sorted({seed for _, seed in todo})]):
                pass
        with pool.start(learnt, (params, folder), min(workers, len(todo))) as jobs:
            for _, case in jobs.results(todo):
                record.append(dataclasses.asdict(case))
                cases[case.method, case.seed] = case
                if report:
                    report(case, len(cases), len(jobs_to_do))
    finally:
        record.close()
    return [cases[key] for key in jobs_to_do]


def learnt(params: ContestParams, folder: Path, method: str, seed: int) -> Case:
    """Learn in one way with one seed, and test the result."""
    began = time.perf_counter()
    place = folder / f"{method.replace(' ', '_')}_{seed}"
    learners = {"evolution": _evolution, "ppo": _ppo}
    try:
        controller, seconds = learners.get(method, _steps)(params, place, method, seed)
    except (ParameterError, MissingPackageError) as error:
        return Case(method, seed, 0.0, time.perf_counter() - began, {}, str(error))
    wall = time.perf_counter() - began
    rows = judge(controller, params.trials)
    return Case(
        method, seed, seconds, wall, {name: dataclasses.asdict(r) for name, r in rows.items()}
    )


def searched(params: ContestParams, folder: Path, seed: int) -> None:
    """Search the gait of a seed for the whole time; a search in its folder is resumed."""
    options = PopulationParams(
        seed=seed, sigma=0.2, population=params.population, workers=0,
        evaluations=_evaluations(params, params.seconds),
    )  # fmt: skip
    minimise(GaitProblem(_search(params)), options, _record(folder, seed))


def _search(params: ContestParams) -> GaitSearchParams:
    return GaitSearchParams(gait=params.gait, duration=params.rollout)


def _record(folder: Path, seed: int) -> Path:
    return folder / f"search_{seed}"


def _evaluations(params: ContestParams, seconds: float) -> int:
    """Rollouts of the complete generations within some time [s], at least one generation."""
    return max(1, int(seconds / params.rollout) // params.population) * params.population


def _gait(params: ContestParams, folder: Path, seconds: float, seed: int) -> tuple[Any, float]:
    """Best oscillators of a seed's search after some time [s], and the time used."""
    _, rows = evaluations.read(_record(folder, seed))
    rows = rows[: _evaluations(params, seconds)]
    best = min(rows, key=lambda row: row["value"])
    target = GaitProblem(_search(params)).target(np.array(best["x"]))
    return target, len(rows) * params.rollout


def _evolution(p: ContestParams, place: Path, method: str, seed: int) -> tuple[Experiment, float]:
    target, seconds = _gait(p, place.parent, p.seconds, seed)
    return load(p.gait).replace(target=target), seconds


def _steps(p: ContestParams, place: Path, method: str, seed: int) -> tuple[Experiment, float]:
    """Gait and FORCE, and with three steps the gradient in the remaining time."""
    reflex = load(p.reflex, {"seed": seed})
    teaching_time = reflex.learner.duration - reflex.learner.test
    third = method == METHODS[2]
    search_time = p.seconds * p.share if third else p.seconds - teaching_time
    target, seconds = _gait(p, place.parent, search_time, seed)
    target = target.replace(start_time=reflex.target.start_time)
    reflex = reflex.replace(target=target)
    start = place / gradient.START
    seconds += first_weights(reflex, start)
    settings = p.gradient.replace(seed=seed, seconds=p.seconds - seconds)
    if not third:
        return _playing(reflex, start, settings.lead), seconds
    result = gradient.learn(reflex, settings, place, workers=0)
    weights, _ = gradient.write(reflex, settings, place, result.readout)
    return _playing(reflex, weights, settings.lead), seconds + result.seconds


def _ppo(p: ContestParams, place: Path, method: str, seed: int) -> tuple[Experiment, float]:
    from .ppo import learn_by_ppo  # optional dependency

    # The robot stands until the delay line is full, without a gait.
    reflex = load(p.reflex, {"seed": seed})
    stand = reflex.learner.memory * reflex.dt
    reflex = reflex.replace(
        learner=reflex.learner.replace(stand=stand),
        target=reflex.target.replace(start_time=2.0 * stand),
    )
    settings = p.gradient.replace(seed=seed, seconds=p.seconds, lead=0.0)
    start = place / gradient.START
    first_weights(reflex, start, zero=True)
    readout, seconds = learn_by_ppo(reflex, settings, start)
    weights, _ = gradient.write(reflex, settings, place, readout)
    return _playing(reflex, weights, 0.0), seconds


def _playing(reflex: Experiment, weights: Path, lead: float) -> Experiment:
    """Experiment in which a trained readout drives after the lead [s]."""
    learner = reflex.learner.replace(weights=str(weights), train=lead, closing=0.0)
    return reflex.replace(learner=learner)
