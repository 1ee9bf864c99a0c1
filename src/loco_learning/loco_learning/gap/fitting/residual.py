# SPDX-License-Identifier: Apache-2.0
"""Learned correction of joint torques, for a gap that no known effect explains.

What each driven joint lacks is a weighted sum of smooth features of its position, its velocity
and the torque of its drive (effect `learned_residual`). Measured torques are not needed: a run of
the model for each weight tells how that weight moves what is predicted, and ridge regression
finds the weights with which runs follow the recordings. The penalty is the one that predicts best
what it was not fitted to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import limits
from loco_sim.effects.catalogue.learned import LearnedResidual
from loco_sim.effects.rows import FEATURES

from ..localisation.correction import LEAST_EXPLAINED, ridge
from ..prediction.case import Case
from ..prediction.channels import Channel
from ..prediction.windows import joint_states
from ..statistics import evidence
from .fit import Fitted

Specs = list[dict[str, Any]]
Each = Callable[[Callable, Sequence[tuple]], Iterator[Any]]

# Most rounds of runs and regression; each begins where the last one ended. Taste: on a bench with
# made-up torques the fourth still gained a third of what was left, twice as many gained no more.
ROUNDS = 4
LEAST_GAIN = 0.02  # share by which a round must lower the rms for another one (taste)
LEAST_OF_ALL = 0.01  # share of what all joints move below which one is left alone (taste)
STEP = 0.02  # weight that is tried, of half the range of the joint's torque (taste)
SHARES = (1.0, 0.5, 0.25)  # of a step that are tried, since runs are not straight lines (taste)
MOST = 20_000  # values of a column: neighbours in time say the same (memory)
EDGES = (0.001, 0.999)  # quantiles of speeds and torques that bound what was seen (taste)
MARGIN = 1.05  # times the range that was seen (taste)
DIGITS = 6  # of a weight in a file


@dataclass(frozen=True)
class Learned:
    """A learned correction and how well it does.

    Attributes:
        effects: One `learned_residual` per joint, as in an experiment's list.
        joints: Names of the joints.
        explained: Share of the fitted residual's energy that it predicted in blocks that were
            left out, before any run with it.
        before: Score of the model without it on the data that judge.
        after: Score of the model with it on the same data.
    """

    effects: Specs
    joints: tuple[str, ...]
    explained: float
    before: evidence.Score
    after: evidence.Score


def fit(case: Case, model: Fitted, each: Each) -> Learned | None:
    """Fit a correction to what a model leaves; None where nothing of it can be predicted.

    Args:
        case: Model and data.
        model: Model that goes on, with the effects that are named.
        each: Calls functions of the case, in any number of processes.
    """
    given = model.specs
    overrides = model.settled
    regions = seen(case, given, overrides)
    if not regions:
        return None
    case = case.kept().corrected(given, overrides)
    at, explained = np.zeros(len(regions) * FEATURES), 0.0
    residual = case.vector(given, overrides)
    stride = _stride(residual, len(case.forward.channels))
    for turn in range(ROUNDS):
        x = _columns(given, overrides, regions, at, stride, each)
        share, wanted = ridge(x, x @ at - residual[::stride])
        if turn == 0:
            if share < LEAST_EXPLAINED:
                return None
            kept = telling(x, wanted)
            regions, at = [regions[j] for j in kept], np.zeros(len(kept) * FEATURES)
            x = x[:, np.concatenate([np.arange(j * FEATURES, (j + 1) * FEATURES) for j in kept])]
            explained, wanted = ridge(x, -residual[::stride])
        before = _rms(residual)
        for part in SHARES:
            tried = _rounded(at + part * (wanted - at))
            left = case.vector([*given, *corrections(regions, tried)], overrides)
            if _rms(left) < before:
                at, residual = tried, left
                break
        if not _rms(residual) < (1.0 - LEAST_GAIN) * before:
            break
    if not at.any():
        return None
    effects = corrections(regions, at)
    pair = [_held(case, specs, overrides) for specs in (given, [*given, *effects])]
    return Learned(effects, tuple(r["joint"] for r in regions), explained, *pair)


def seen(case: Case, specs: Specs, overrides: Mapping[str, Any]) -> Specs:
    """Region that each driven joint was measured in, as parameters of the effect.

    Args:
        case: Model and data.
        specs: Effects of the model.
        overrides: Values of robot.yaml, over those of the model.
    """
    robot, forward = case.forward.given(), copy(case.forward)
    joints = [robot.joints[j] for j in robot.driven]
    forward.channels = tuple(Channel("tau", joint, "N·m") for joint in joints)
    torques = np.concatenate(forward(specs, overrides, case.fitted))
    states = [joint_states(case.records[i], case.forward.robot(i)) for i in case.fitted]
    q, dq = (np.concatenate(parts)[:, robot.driven] for parts in zip(*states, strict=True))
    found = []
    for k, joint in enumerate(joints):
        columns = [c[np.isfinite(c)] for c in (q[:, k], dq[:, k], torques[:, k])]
        if not all(len(c) for c in columns) or not np.ptp(columns[0]) > 0.0:
            continue
        low, high = np.quantile(columns[2], EDGES)
        values = {
            "middle": 0.5 * (columns[0].max() + columns[0].min()),
            "travel": 0.5 * MARGIN * np.ptp(columns[0]),
            "speed": MARGIN * np.quantile(np.abs(columns[1]), EDGES[1]),
            "load": 0.5 * (low + high),
            "load_range": 0.5 * MARGIN * (high - low),
        }
        bounded = {
            k: _digits(float(np.clip(v, *limits(LearnedResidual, k)))) for k, v in values.items()
        }
        found.append({"name": LearnedResidual.name, "joint": joint, **bounded})
    return found


def telling(x: np.ndarray, weights: np.ndarray) -> list[int]:
    """Joints whose correction moves what is predicted more than a little; at least one.

    Args:
        x: Change of what is predicted per weight, (N, J FEATURES).
        weights: Weights of all joints, (J FEATURES,).
    """
    parts = np.split(np.arange(x.shape[1]), x.shape[1] // FEATURES)
    energy = np.array([float(np.square(x[:, p] @ weights[p]).sum()) for p in parts])
    return np.flatnonzero(energy >= LEAST_OF_ALL * energy.sum()).tolist()


def corrections(regions: Specs, weights: np.ndarray) -> Specs:
    """Effects of weights, one joint after the other; joints without any are left out.

    Args:
        regions: Effects without weights, as of `seen`.
        weights: Weights of all joints, (J FEATURES,).
    """
    each = np.reshape(weights, (len(regions), FEATURES))
    pairs = zip(regions, each, strict=True)
    return [{**region, "weights": w.tolist()} for region, w in pairs if w.any()]


def moved(case: Case, specs: Specs, overrides: Mapping[str, Any], stride: int) -> np.ndarray:
    """Every so many of the fitted residuals of a model in its own steps, nothing refitted, (N,)."""
    return case.kept().vector(specs, overrides, coarse=True)[::stride]


def _columns(
    given: Specs,
    overrides: Mapping[str, Any],
    regions: Specs,
    at: np.ndarray,
    stride: int,
    each: Each,
) -> np.ndarray:
    """Change of what is predicted per weight, about weights, (N, J FEATURES)."""
    steps = np.repeat([STEP * r["load_range"] for r in regions], FEATURES)
    points = [at, *(at + step * row for step, row in zip(steps, np.eye(len(at)), strict=True))]
    tasks = [([*given, *corrections(regions, p)], dict(overrides), stride) for p in points]
    here, *there = each(moved, tasks)
    return np.stack([(m - here) / s for m, s in zip(there, steps, strict=True)], axis=1)


def _stride(residual: np.ndarray, channels: int) -> int:
    """Step between the values of a column, one that does not leave channels out."""
    stride = max(1, math.ceil(len(residual) / MOST))
    while math.gcd(stride, channels) > 1:
        stride += 1
    return stride


def _held(case: Case, specs: Specs, overrides: Mapping[str, Any]) -> evidence.Score:
    return case.judged(case.kept().whitened(specs, overrides))


def _rms(residual: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(residual))))


def _digits(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _rounded(weights: np.ndarray) -> np.ndarray:
    """Weights as a file holds them, within their bounds."""
    _, high = limits(LearnedResidual, "weights")
    return np.array([_digits(w) for w in np.clip(weights, -high, high)])
