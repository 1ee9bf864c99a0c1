# SPDX-License-Identifier: Apache-2.0
"""Episodes of reinforcement: the target leads into the gait, then a readout drives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError

from ..metrics.registry import METRICS
from ..reflex import weights as weight_files
from ..reflex.senses import BodySensors, FootForces
from ..runs.experiment import Experiment
from ..runs.network_experiment import NetworkExperiment
from ..runs.rollout import build, rollout, run
from .guided import GuidedNetwork
from .params import ReinforceParams, RewardParams
from .reward import Reward


@dataclass(frozen=True)
class Episode:
    """Result of an episode, in plain values."""

    value: float  # return, see `Reward.of_log` [-]
    speed: float  # mean forward velocity while the readout drives [m/s]; nan if too short
    cost: float  # cost of transport [-]; nan if too short
    fall: str  # reason of the fall; empty if there was none
    seconds: float  # simulated [s]


def checked(experiment: Experiment | NetworkExperiment) -> Experiment:
    """The experiment, if its readout can be reinforced.

    Raises:
        ParameterError: It has no network, or one without a hidden layer for an agent.
    """
    if isinstance(experiment, NetworkExperiment):
        raise ParameterError(
            f"{experiment.name} is of masses and springs, whose body is its hidden layer and "
            "learns by FORCE alone; take a robot, such as tigrillo_bound_reflex"
        )
    if not experiment.learner.enabled:
        raise ParameterError(
            f"{experiment.name} has no reflex network (learner.enabled is false); take one that "
            "has, such as tigrillo_bound_reflex"
        )
    return experiment


def kind(experiment: Experiment) -> str:
    """Kind of the weight files of an experiment, see `archive.FORMATS`."""
    return (FootForces if experiment.gait else BodySensors).KIND


def prepared(experiment: Experiment, params: ReinforceParams, weights: str | Path) -> Experiment:
    """Experiment of one episode: stand, lead, then `episode` seconds of the readout in `weights`.

    Args:
        experiment: Experiment with a reflex network.
        params: Length of lead and episode, and the push.
        weights: Weight file of its network.
    """
    learner = experiment.learner.replace(
        weights=str(weights), train=params.lead, closing=0.0, test=params.episode
    )
    episode = experiment.replace(learner=learner, duration=0.0)
    return with_pushes(episode, params.push, learner.stand + params.lead)


def with_pushes(experiment: Experiment, share: float, start: float) -> Experiment:
    """Copy of an experiment with random pushes on the base.

    Args:
        experiment: Experiment to change.
        share: Largest force on each axis over the weight of the robot; 0 for none.
        start: Time of the first push [s].
    """
    if not share:
        return experiment
    force = share * Reward(RewardParams(), experiment.plant, experiment.sim_params).weight
    push = {"name": "push", "random": force, "start": start}
    return experiment.replace(effects=(*experiment.effects, push))


def first_weights(
    experiment: Experiment, path: Path, weights: str | Path = "", zero: bool = False
) -> float:
    """Write the initial readout; returns the simulated time for it [s].

    Args:
        experiment: Experiment with a reflex network.
        path: Weight file to write.
        weights: Initial weight file; empty for that of the experiment or, if it has none, for
            training in its own phases train and closing (FORCE).
        zero: Whether to start from a readout of zeros.

    Raises:
        MissingFileError: The weight file does not exist.
        ParameterError: The weights are of another network, or the robot fell in the training.
    """
    learner, seconds, source = experiment.learner, 0.0, weights or experiment.learner.weights
    if zero:
        loop = build(experiment.replace(learner=learner.replace(weights="")))
        loop.reflex.save(path)
        loop.close()
        readout = np.zeros_like(weight_files.read_readout(path, kind(experiment)))
        weight_files.with_readout(path, path, kind(experiment), readout)
    elif source:
        readout = weight_files.read_readout(source, kind(experiment))
        weight_files.with_readout(source, path, kind(experiment), readout)
    else:
        seconds = learner.duration - learner.test
        log = rollout(experiment, until=seconds + experiment.dt, save_weights=path)
        if log.fall or not path.is_file():
            raise ParameterError(
                f"{experiment.name} taught no readout in {seconds:g} s: "
                f"{log.fall or 'its phases train and closing do not end'}; give --weights or --zero"
            )
    build(experiment.replace(learner=learner.replace(weights=str(path)))).close()  # check
    return seconds


def activity(experiment: Experiment, seed: int) -> np.ndarray:
    """Hidden activity (T, N) of an episode after standing, with target and readout driving."""
    loop, rows = build(experiment, seed, network=GuidedNetwork), []
    stand = experiment.learner.stand
    try:
        run(loop, lambda tick, loop: rows.append(loop.reflex.activity.copy()))
    finally:
        loop.close()
    return np.array(rows[min(round(stand / experiment.dt), len(rows) - 1) :])


def play(
    experiment: Experiment,
    params: ReinforceParams,
    readout: np.ndarray,
    seed: int,
    body: Mapping[str, Any],
) -> Episode:
    """Simulate an episode with a readout.

    Args:
        experiment: Experiment from `prepared`.
        params: Reward and discount.
        readout: Weights of the readout, (N, 2k).
        seed: Seed of sensors and pushes.
        body: Changed values of robot.yaml, by dotted name.
    """
    if body:
        experiment = experiment.replace(overrides={**experiment.overrides, **body})
    loop = build(experiment, seed)
    try:
        loop.reflex.readout.weights[...] = readout
        loop.reflex.refresh()
        log = run(loop)
    finally:
        loop.close()
    test = log.cut(log.phase_of("test"))
    reward = Reward(params.reward, experiment.plant, experiment.sim_params)
    ticks = round(params.episode / experiment.dt)
    return Episode(
        value=reward.of_log(test, ticks, params.discount),
        speed=METRICS["forward_speed"](test),
        cost=METRICS["positive_cost_of_transport"](test),
        fall=log.fall,
        seconds=len(log) * log.dt,
    )
