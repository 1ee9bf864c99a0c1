# SPDX-License-Identifier: Apache-2.0
"""Test of a controller: undisturbed, with pushes, and on varied bodies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from loco_control.params import Params, parameter

from ..gaits.search import draw_bodies
from ..metrics.quantities import heading_speed
from ..metrics.registry import METRICS
from ..runs.experiment import Experiment
from ..runs.rollout import rollout
from .episode import with_pushes

CONDITIONS = ("calm", "pushed", "bodies")
MIN_SPEED = 0.01  # [m/s] speed below which a robot stands, without a cost of transport (taste)


@dataclass(frozen=True)
class TrialParams(Params):
    """Length and number of the trials, and their disturbances."""

    start: float = parameter(3.0, "measured, and pushed, from this time on (taste)", "s", 0.0, 1e4)
    length: float = parameter(10.0, "measured so long (taste)", "s", 1.0, 1e4)
    count: int = parameter(6, "trials of each condition (taste)", "-", 1, 1000)
    push: float = parameter(
        0.1, "random force on each axis, as a share of the weight (battery: at twice as much the "
        "taught reflex of Tigrillo falls five times of six)", "-", 0.0, 100.0,
    )  # fmt: skip
    spread: float = parameter(
        0.1, "spread of stiffness, friction and masses, relative (as `loco optimise`)", "-", 0.0, 1
    )
    seed: int = parameter(1000, "seed of the first trial, and of the bodies", "-", 0, 2**31 - 1)


@dataclass(frozen=True)
class Row:
    """Results of the trials of one condition."""

    speed: float  # mean forward velocity over all trials, 0 after a fall [m/s]
    cost: float  # mean cost of transport of the trials without a fall [-]; nan without any
    falls: int
    count: int


def judge(experiment: Experiment, params: TrialParams) -> dict[str, Row]:
    """Test an experiment; rows by the names of `CONDITIONS`.

    Args:
        experiment: Experiment whose controller drives by the time `start`, with trained
            weights or in open loop; its duration is replaced by that of the trials.
        params: Settings of the trials.
    """
    p, seeds = params, range(params.seed, params.seed + params.count)
    lasting = experiment.replace(duration=p.start + p.length)
    with_push = with_pushes(lasting, p.push, p.start)
    bodies = [
        lasting.replace(overrides={**lasting.overrides, **body})
        for body in draw_bodies(lasting, p.spread, p.count, p.seed)
    ]
    trials = {
        "calm": [(lasting, seed) for seed in seeds],
        "pushed": [(with_push, seed) for seed in seeds],
        "bodies": list(zip(bodies, seeds, strict=True)),
    }
    return {name: _row(runs, p) for name, runs in trials.items()}


def _row(runs: Iterable[tuple[Experiment, int]], p: TrialParams) -> Row:
    speeds, costs, fall_count = [], [], 0
    for experiment, seed in runs:
        log = rollout(experiment, seed)
        measured = log.cut(slice(round(p.start / log.dt), None))
        distance = np.nan_to_num(heading_speed(measured)).sum() * log.dt
        speeds.append(float(distance) / p.length)
        if log.fall:
            fall_count += 1
        elif speeds[-1] > MIN_SPEED:
            costs.append(METRICS["positive_cost_of_transport"](measured))
    cost = float(np.mean(costs)) if costs else float("nan")
    return Row(float(np.mean(speeds)), cost, fall_count, len(speeds))
