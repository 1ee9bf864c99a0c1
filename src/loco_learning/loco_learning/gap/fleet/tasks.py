# SPDX-License-Identifier: Apache-2.0
"""Jobs of a fleet: each reads what it needs and returns few numbers, in any process or host."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from loco_sim.plant.model import Model

from .. import workflow
from ..fitting.params import GapParams
from ..prediction import case as cases
from ..prediction.case import Case
from ..recordings.record import FIT, Record, bridged
from ..setup.bench import busiest
from ..statistics import evidence
from ..statistics.leftover import LIMITS, has_gap
from .params import FleetParams
from .terms import Term, at_ratio, terms_of

AXIS = 0.02  # time between rows from which accelerations are estimated [s] (taste)
# Speed, over the rms one, at which dry friction has nearly its full size (taste).
STICTION_SPEED = 0.1
VISIBLE = math.sqrt(LIMITS.explained**2 - 1.0)  # change of a channel, as in `gap check` [floors]
BLOCKS = 16  # parts of a recording between which its errors are independent


@dataclass(frozen=True)
class Setting:
    """Arguments that all jobs share.

    Attributes:
        read: Records of a file; must be possible to pickle.
        model: Robot, overrides and effects.
        gap: Settings of a search.
        params: Settings of the fleet.
    """

    read: Callable[[str], list[Record]]
    model: Model
    gap: GapParams
    params: FleetParams


@dataclass(frozen=True)
class Excitation:
    """Properties of a recording that need no simulation.

    Attributes:
        seconds: Length of the recording [s].
        information: Gram matrix of position, speed, acceleration and direction of each joint,
            (n, 4, 4): Fisher information about stiffness, damping, inertia and dry friction.
    """

    seconds: float
    information: np.ndarray


@dataclass(frozen=True)
class Measured:
    """Sizes of K effects in a recording, as ratios to those of the searches.

    Attributes:
        sizes: Estimates, (K,); negative ones are by extrapolation.
        variances: Their variances, (K,), by the sandwich estimator over blocks.
        visible: Smallest sizes with an effect above what a search treats as noise, (K,).
        at: Sizes of the last simulation, (K,).
        power: Sum of squares of its residual [floors²], (C,).
        before: Same without the effects, (C,).
        count: Number of values, (C,).
        slope: Half the change of `power` per size, (C, K).
        gram: Half its second derivative, (C, K, K).
    """

    sizes: np.ndarray
    variances: np.ndarray
    visible: np.ndarray
    at: np.ndarray
    power: np.ndarray
    before: np.ndarray
    count: np.ndarray
    slope: np.ndarray
    gram: np.ndarray


@dataclass(frozen=True)
class SearchResult:
    """Result of a search of one robot.

    Attributes:
        verdict: Verdict as in ``gap.json``.
        evidence: Evidence in one sentence, or the first mistake of the set-up.
        overrides: Values of robot.yaml, those of the model and refitted ones.
        terms: Effects that were found.
    """

    verdict: str
    evidence: str
    overrides: dict[str, Any]
    terms: tuple[Term, ...]


RESULTS = (Excitation, Measured, SearchResult, Term)


def call(setting: Setting, task: Callable[..., Any], *arguments: Any) -> Any:
    """Run a job: a task with its own arguments, the first of which stand for its files."""
    return task(setting, *arguments)


def excitation(setting: Setting, file: tuple) -> Excitation:
    """Length and information of a recording."""
    record = _longest(setting, file)
    part = busiest(record, setting.params.seconds)
    every = max(1, round(AXIS / part.dt))
    q = bridged(part.signals["q"])[: len(part.t) // every * every]
    q = q.reshape(-1, every, q.shape[1]).mean(axis=1)
    dq = np.gradient(q, every * part.dt, axis=0)
    rms = np.sqrt(np.mean(np.square(dq), axis=0)) + 1e-12
    regressors = [q - q.mean(axis=0), dq, np.gradient(dq, every * part.dt, axis=0),
                  np.tanh(dq / (STICTION_SPEED * rms))]  # fmt: skip
    x = np.stack(regressors, axis=-1)
    return Excitation(record.duration, np.einsum("tjk,tjl->jkl", x, x) * every * part.dt)


def evaluate(setting: Setting, file: tuple) -> tuple[float, bool]:
    """Whitened rms of the given model [floors], and whether it leaves a gap."""
    case = _case(setting, file, {})
    residual = case.whitened([])
    return evidence.rms(residual), has_gap(residual)


def search(setting: Setting, files: Sequence[tuple]) -> SearchResult:
    """Search for the effects of a robot in some recordings; the last of several is held out."""
    seconds = setting.params.search_seconds
    records = [_excerpt(setting, file, seconds) for file in files]
    held = [records.pop()] if len(records) > 1 else []
    result = workflow.find(setting.model, records, held, setting.gap)
    faults = [row["says"] for row in result.get("setup", ()) if row["stops"]]
    overrides = result["model"]["overrides"]
    terms = tuple(terms_of(result, len(setting.model.effects)))
    return SearchResult(result["verdict"], (faults or [result["evidence"]])[0], overrides, terms)


def measure(
    setting: Setting, file: tuple, overrides: Mapping[str, Any], terms: Sequence[Term],
    start: Sequence[float],
) -> Measured:  # fmt: skip
    """Sizes of effects in a recording, by Gauss-Newton steps of the simulation.

    Args:
        setting: Shared arguments.
        file: The recording.
        overrides: Values of robot.yaml.
        terms: The effects.
        start: Initial sizes, as ratios.
    """
    case, params = _case(setting, file, overrides), setting.params
    legal = np.array([term.legal() for term in terms]).reshape(-1, 2)
    at, before = np.array(start, dtype=float), _residual(case, terms, np.zeros(len(terms)))
    measured = np.isfinite(before)
    weight = np.ones(before.shape[1])
    r, columns = before, np.zeros((*before.shape, len(terms)))
    sizes, inverse = at, np.eye(len(terms))
    for step in range(params.steps if terms else 0):
        if step + 1 == params.steps and any(start):  # a large effect has a step error of its own
            case = case.corrected(at_ratio(terms, at), {})
        r = _residual(case, terms, at)
        for k, unit in enumerate(np.eye(len(terms))):
            fits = at[k] + params.difference <= legal[k, 1]
            h = params.difference if fits else -params.difference
            columns[..., k] = (_residual(case, terms, at + h * unit) - r) / h
        if step:
            power = np.nansum(np.square(r), axis=0) / np.maximum(measured.sum(0), 1)
            weight = 1.0 / np.maximum(power, 1.0)
        sizes, inverse = _step(at, r, columns, weight, params.wide)
        if step + 1 < params.steps:
            at = np.clip(sizes, *legal.T)
    r, columns = np.nan_to_num(r), np.nan_to_num(columns)
    scores = np.einsum("tck,tc,c->tk", columns, r, weight) + 0.0
    moved = np.einsum("tck,tcl,c->tkl", columns, columns, weight) @ (sizes - at)
    parts = [p.sum(axis=0) for p in np.array_split(scores + moved, BLOCKS)]
    meat = sum(np.outer(p, p) for p in parts) * BLOCKS / (BLOCKS - 1)
    each = np.sqrt(np.sum(np.square(columns), axis=0) / np.maximum(measured.sum(0), 1)[:, None])
    loudest = np.maximum(each.max(axis=0, initial=0.0), 1e-9)
    return Measured(
        sizes, np.maximum(np.diag(inverse @ meat @ inverse), np.diag(inverse)),
        np.minimum(VISIBLE / loudest, params.wide), at,
        np.sum(np.square(r), axis=0), np.nansum(np.square(before), axis=0), measured.sum(axis=0),
        np.einsum("tck,tc->ck", columns, r), np.einsum("tck,tcl->ckl", columns, columns),
    )  # fmt: skip


def _step(
    at: np.ndarray, r: np.ndarray, columns: np.ndarray, weight: np.ndarray, wide: float
) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of the least error about `at`, (K,), and the inverse of their information, (K, K)."""
    x, y = np.nan_to_num(columns), np.nan_to_num(r)
    inverse = np.linalg.inv(np.einsum("tck,tcl,c->kl", x, x, weight) + np.eye(len(at)) / wide**2)
    return at - inverse @ (np.einsum("tck,tc,c->k", x, y, weight) + at / wide**2), inverse


def _residual(case: Case, terms: Sequence[Term], at: np.ndarray) -> np.ndarray:
    """Residual with effects at sizes [floors], (T, C); NaN where not measured."""
    return case.whitened(at_ratio(terms, at), coarse=True)[0]


def _longest(setting: Setting, file: tuple) -> Record:
    """A recording; the longest part of one in several parts."""
    return max(setting.read(file[0]), key=lambda r: r.duration)


def _excerpt(setting: Setting, file: tuple, seconds: float) -> Record:
    """The simulated part of a recording, as one to fit."""
    return replace(busiest(_longest(setting, file), seconds), role=FIT)


def _case(setting: Setting, file: tuple, overrides: Mapping[str, Any]) -> Case:
    """Model and data of a recording."""
    base = setting.model
    model = Model(base.robot, {**base.overrides, **overrides}, base.effects)
    record = _excerpt(setting, file, setting.params.seconds)
    return cases.fit_all_rows(workflow.forward_of(model, [record], setting.gap), [record])
