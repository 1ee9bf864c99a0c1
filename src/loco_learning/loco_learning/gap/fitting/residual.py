# SPDX-License-Identifier: Apache-2.0
"""Learned correction of joint torques, for a gap that no known effect explains.

The missing torque of each driven joint is a weighted sum of smooth features of its position, its
velocity and the torque of its drive (effect `learned_residual`). Measured torques are not needed:
one simulation per weight gives the sensitivity of the prediction to it, and ridge regression finds
the weights with which simulations follow the recordings. The ridge penalty is the one with the
smallest cross-validated error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
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

# Maximum number of rounds of simulation and regression; each starts from the previous one. Taste:
# on a bench with synthetic torques the fourth round still removed a third of the remaining
# residual, twice as many rounds removed no more.
ROUNDS = 4
LEAST_GAIN = 0.02  # relative decrease of the rms below which no further round follows (taste)
LEAST_OF_ALL = 0.01  # share of the energy of all joints below which a joint is left out (taste)
STEP = 0.02  # finite difference of a weight, over half the range of the torque (taste)
SHARES = (1.0, 0.5, 0.25)  # tried step lengths, since the simulation is not linear (taste)
MAX_VALUES = 20_000  # largest number of fitted samples, which limits memory; neighbours are alike
EDGES = (0.001, 0.999)  # quantiles of speeds and torques that bound the measured range (taste)
MARGIN = 1.05  # factor on the measured range (taste)
DIGITS = 6  # significant digits of a weight in a file


@dataclass(frozen=True)
class Learned:
    """A learned correction and its score.

    Attributes:
        effects: One `learned_residual` per joint, as in the list of an experiment.
        joints: Names of the joints.
        explained: Cross-validated share of the energy of the fitted residual, from the first
            regression.
        before: Score of the model without the correction on held-out data.
        after: Score of the model with it on the same data.
    """

    effects: Specs
    joints: tuple[str, ...]
    explained: float
    before: evidence.Score
    after: evidence.Score


def fit(case: Case, model: Fitted, each: Each) -> Learned | None:
    """Fit a correction to the residual of a model; None if no part of it can be predicted.

    Args:
        case: Model and data.
        model: Selected model with its effects.
        each: Runs functions of the case in parallel, in any number of processes.
    """
    initial = model.specs
    overrides = model.settled
    regions = visible_specs(case, initial, overrides)
    if not regions:
        return None
    case = case.kept().corrected(initial, overrides)
    at, explained = np.zeros(len(regions) * FEATURES), 0.0
    residual = case.vector(initial, overrides)
    stride = _stride(residual, len(case.forward.channels))
    for turn in range(ROUNDS):
        x = _columns(initial, overrides, regions, at, stride, each)
        share, optimum = ridge(x, x @ at - residual[::stride])
        if turn == 0:
            if share < LEAST_EXPLAINED:
                return None
            rows = telling(x, optimum)
            regions, at = [regions[j] for j in rows], np.zeros(len(rows) * FEATURES)
            x = x[:, np.concatenate([np.arange(j * FEATURES, (j + 1) * FEATURES) for j in rows])]
            explained, optimum = ridge(x, -residual[::stride])
        before = _rms(residual)
        for part in SHARES:
            trial = _rounded(at + part * (optimum - at))
            left = case.vector([*initial, *corrections(regions, trial)], overrides)
            if _rms(left) < before:
                at, residual = trial, left
                break
        if not _rms(residual) < (1.0 - LEAST_GAIN) * before:
            break
    if not at.any():
        return None
    effects = corrections(regions, at)
    pair = [_held(case, specs, overrides) for specs in (initial, [*initial, *effects])]
    return Learned(effects, tuple(r["joint"] for r in regions), explained, *pair)


def visible_specs(case: Case, specs: Specs, overrides: Mapping[str, Any]) -> Specs:
    """Measured range of each driven joint, as parameters of the effect `learned_residual`.

    Args:
        case: Model and data.
        specs: Effects of the model.
        overrides: Values of robot.yaml, over those of the model.
    """
    robot = case.forward.given()
    joints = [robot.joints[j] for j in robot.driven]
    channels = [Channel("tau", joint, "N·m") for joint in joints]
    forward = case.forward.with_channels(channels, joint_torque=True)  # springs load it as well
    torques = np.concatenate(forward(specs, overrides, case.fitted))
    states = [joint_states(case.records[i], case.forward.robot(i)) for i in case.fitted]
    q, dq = (np.concatenate(parts)[:, robot.driven] for parts in zip(*states, strict=True))
    bounds = []
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
        bounds.append({"name": LearnedResidual.name, "joint": joint, **bounded})
    return bounds


def telling(x: np.ndarray, weights: np.ndarray) -> list[int]:
    """Indices of joints whose correction changes the prediction noticeably; at least one.

    Args:
        x: Change of the prediction per weight, (N, J FEATURES).
        weights: Weights of all joints, (J FEATURES,).
    """
    parts = np.split(np.arange(x.shape[1]), x.shape[1] // FEATURES)
    energy = np.array([float(np.square(x[:, p] @ weights[p]).sum()) for p in parts])
    return np.flatnonzero(energy >= LEAST_OF_ALL * energy.sum()).tolist()


def corrections(regions: Specs, weights: np.ndarray) -> Specs:
    """Effects with given weights, one per joint; joints with zero weights are omitted.

    Args:
        regions: Effects without weights, from `visible_specs`.
        weights: Weights of all joints, (J FEATURES,).
    """
    each = np.reshape(weights, (len(regions), FEATURES))
    pairs = zip(regions, each, strict=True)
    return [{**region, "weights": w.tolist()} for region, w in pairs if w.any()]


def moved(case: Case, specs: Specs, overrides: Mapping[str, Any], stride: int) -> np.ndarray:
    """Every `stride`-th fitted residual in the model's own steps, nothing refitted, (N,)."""
    return case.kept().vector(specs, overrides, coarse=True)[::stride]


def _columns(
    initial_specs: Specs,
    overrides: Mapping[str, Any],
    regions: Specs,
    at: np.ndarray,
    stride: int,
    each: Each,
) -> np.ndarray:
    """Change of the prediction per weight, about the weights `at`, (N, J FEATURES)."""
    steps = np.repeat([STEP * r["load_range"] for r in regions], FEATURES)
    points = [at, *(at + step * row for step, row in zip(steps, np.eye(len(at)), strict=True))]
    tasks = [([*initial_specs, *corrections(regions, p)], dict(overrides), stride) for p in points]
    reference, *shifted = each(moved, tasks)
    return np.stack([(m - reference) / s for m, s in zip(shifted, steps, strict=True)], axis=1)


def _stride(residual: np.ndarray, channels: int) -> int:
    """Step between the used residuals, coprime to the channels so that none is left out."""
    stride = max(1, math.ceil(len(residual) / MAX_VALUES))
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
    """Weights within their bounds, rounded to the digits of a file."""
    _, high = limits(LearnedResidual, "weights")
    return np.array([_digits(w) for w in np.clip(weights, -high, high)])
