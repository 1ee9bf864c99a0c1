# SPDX-License-Identifier: Apache-2.0
"""Third learning step, resumable: episodes of perturbed readouts, update after update.

`episodes.jsonl` stores the return of each episode, in order, and nothing else, since the
readout follows from the returns. A restarted run replays them and continues, with the same
result to the last byte for any number of processes.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_control.checks import keys_of
from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_control.params import to_dict

from ..gaits.search import draw_bodies
from ..jobs import pool
from ..jobs.journal import Journal
from ..jobs.kept import digest, versions
from ..reflex import weights as weight_files
from ..runs.experiment import Experiment
from ..search.population import seed_of
from .episode import Episode, activity, kind, play, prepared
from .gradient import PolicyGradient, directions
from .params import ReinforceParams

RECORD, START, WEIGHTS, EXPERIMENT = (
    "episodes.jsonl", "start.npz", "weights.npz", "reinforced.yaml"
)  # fmt: skip
UNPERTURBED = 2**20  # replaces the update in the seed of unperturbed episodes


@dataclass(frozen=True)
class Progress:
    """State of the learning after an update."""

    update: int  # number of finished updates
    updates: int  # number of updates in the budget
    value: float  # return of the unperturbed readout before the update
    best: float  # best return so far
    falls: int  # number of falls in this batch
    eta: float  # time until the end [s]; nan during replay


@dataclass(frozen=True)
class Learnt:
    """Result of the learning."""

    readout: np.ndarray = field(repr=False)  # the best unperturbed one, (N, 2k)
    first: float  # return of the initial readout
    value: float  # return of the best one
    update: int  # number of updates before the best one; 0 for the initial one
    updates: int  # number of finished updates
    seconds: float  # simulated [s]
    course: dict[str, np.ndarray] = field(repr=False)  # see `course`


def cost_of(experiment: Experiment, params: ReinforceParams) -> tuple[int, float]:
    """Number of updates in the budget, and the simulated time that they take at most [s].

    Raises:
        ParameterError: The budget is too small for one update.
    """
    length = experiment.learner.stand + params.lead + params.episode
    update = (params.batch + 1) * length
    updates = math.floor((params.seconds - length) / update)
    if updates < 1:
        raise ParameterError(
            f"seconds is {params.seconds:g}, but one update needs {update + length:g} s: "
            f"{params.batch + 2} episodes of {length:g} s; give more, or a smaller batch"
        )
    return updates, updates * update + length


def learn(
    experiment: Experiment,
    params: ReinforceParams,
    folder: Path,
    workers: int = 2,
    report: Callable[[Progress], Any] | None = None,
) -> Learnt:
    """Improve the readout in the file `START` of a folder within a budget of simulated time.

    Args:
        experiment: Experiment with a reflex network, as loaded.
        params: Settings.
        folder: Folder with the start; the record is written to it, and resumed if it exists.
        workers: Number of processes; 0 simulates the episodes in this process.
        report: Called after each update.

    Raises:
        ParameterError: The budget is too small, or the folder has other work.
    """
    updates, _ = cost_of(experiment, params)
    start = folder / START
    readout = weight_files.read_readout(start, kind(experiment))
    header = {
        "kind": "reinforcement",
        "format": 1,
        "experiment": digest(to_dict(experiment)),
        "start": digest(readout),
        "versions": versions(),
        **{k: v for k, v in to_dict(params).items() if k != "seconds"},
    }
    record = Journal(folder / RECORD, header, keys_of(Episode, update=int, index=int))
    try:
        return _Learning(experiment, params, start, readout, record, workers).run(updates, report)
    finally:
        record.close()


class _Learning:
    """Sequence of updates, read from the record as far as it goes."""

    def __init__(
        self,
        experiment: Experiment,
        params: ReinforceParams,
        start: Path,
        readout: np.ndarray,
        record: Journal,
        workers: int,
    ):
        self._params, self._record, self._workers = params, record, workers
        self._experiment = prepared(experiment, params, start)
        self._plain_seed = seed_of(params.seed, UNPERTURBED, 0)
        basis = directions(activity(self._experiment, self._plain_seed), params.directions)
        self._rule = PolicyGradient(readout, basis, params)
        self._began, self._replayed = time.perf_counter(), 0

    def run(self, updates: int, report: Callable[[Progress], Any] | None) -> Learnt:
        best = (-math.inf, 0, self._rule.weights)
        with pool.start(play, (self._experiment, self._params), self._workers) as jobs:
            for update in range(updates + 1):
                rows = self._episodes(update, jobs, unperturbed=update == updates)
                if rows[0]["value"] > best[0]:
                    best = (rows[0]["value"], update, self._rule.weights)
                if update == updates:
                    break
                self._rule.learn(np.array([row["value"] for row in rows[1:]]))
                if report:
                    report(self._progress(update + 1, updates, rows, best[0]))
        value, update, readout = best
        rows = self._record.rows[: updates * (self._params.batch + 1) + 1]
        return Learnt(
            readout=readout,
            first=rows[0]["value"],
            value=value,
            update=update,
            updates=updates,
            seconds=sum(row["seconds"] for row in rows),
            course=course(rows, self._params.batch),
        )

    def _episodes(self, update: int, jobs: pool.Jobs, unperturbed: bool) -> list[dict[str, Any]]:
        """Rows of an update, the unperturbed readout first; missing episodes are simulated."""
        p, size = self._params, self._params.batch + 1
        count = 1 if unperturbed else size
        done = self._record.rows[update * size : update * size + count]
        self._replayed += len(done)
        seed = seed_of(p.seed, update, 0)  # the same pushes and noise in the whole update
        body = draw_bodies(self._experiment, p.randomise, 1, seed)[0]
        readouts = [self._rule.weights, *([] if unperturbed else self._rule.perturbed())]
        todo = [
            (readout, self._plain_seed if index == 0 else seed, {} if index == 0 else body)
            for index, readout in enumerate(readouts)
        ][len(done) :]
        for index, episode in enumerate(jobs.ordered(todo), start=len(done)):
            row = {"update": update, "index": index, **dataclasses.asdict(episode)}
            self._record.append(row)
        return self._record.rows[update * size : update * size + count]

    def _progress(
        self, update: int, updates: int, rows: list[dict[str, Any]], best: float
    ) -> Progress:
        new_episodes = update * (self._params.batch + 1) - self._replayed
        each = (time.perf_counter() - self._began) / new_episodes if new_episodes > 0 else math.nan
        left = (updates - update) * (self._params.batch + 1) * each
        fall_count = sum(bool(row["fall"]) for row in rows)
        return Progress(update, updates, rows[0]["value"], best, fall_count, left)


def course(rows: list[dict[str, Any]], batch: int) -> dict[str, np.ndarray]:
    """History of the learning, a value for each unperturbed episode, (updates + 1,).

    ``seconds`` simulated before; ``value``, ``speed`` and ``cost`` of the readout; ``batch`` and
    ``falls``, the mean value and the share of falls of its perturbed batch, which are NaN after
    the last update.
    """
    size = batch + 1
    unperturbed, elapsed = rows[::size], np.cumsum([0.0, *(row["seconds"] for row in rows)])
    perturbed = [rows[k * size + 1 : (k + 1) * size] for k in range(len(unperturbed))]
    return {
        "seconds": elapsed[: len(rows) : size],
        **{key: np.array([row[key] for row in unperturbed]) for key in ("value", "speed", "cost")},
        "batch": np.array([np.mean([r["value"] for r in t]) if t else np.nan for t in perturbed]),
        "falls": np.array(
            [np.mean([bool(r["fall"]) for r in t]) if t else np.nan for t in perturbed]
        ),
    }


def write(
    experiment: Experiment, params: ReinforceParams, folder: Path, readout: np.ndarray,
    test: float = 60.0,
) -> list[Path]:  # fmt: skip
    """Write the readout as weights, and an experiment that uses them; returns their paths.

    Args:
        experiment: Experiment as loaded.
        params: Length of the lead.
        folder: Folder with the start.
        readout: Learned readout, (N, 2k).
        test: Length of the phase test of the written experiment [s].
    """
    weights = folder / WEIGHTS
    weight_files.with_readout(folder / START, weights, kind(experiment), readout)
    learner = experiment.learner.replace(weights="", train=params.lead, closing=0.0, test=test)
    final = experiment.replace(
        name=f"{experiment.name}_reinforced",
        description=f"{experiment.name}, its readout improved by reinforcement.",
        learner=learner,
        duration=0.0,
    )
    values = to_dict(final)
    values["learner"]["weights"] = WEIGHTS  # in the same folder
    head = "# SPDX-License-Identifier: Apache-2.0\n# Written by `loco reinforce`.\n"
    text = head + yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
    return [weights, write_whole(folder / EXPERIMENT, text)]
