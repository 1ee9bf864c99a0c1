# SPDX-License-Identifier: Apache-2.0
"""Baseline methods for explaining a gap, on the same records and in the same unit.

- everything: all usual parameters jointly by least squares, as PACE does per joint (armature,
  viscous and dry friction, offset, one delay), plus torque constant and stiffness.
- sparse: the difference of required and modelled torque, regressed on a library of terms
  of position and velocity with thresholding, as in SINDy.
- cma: the parameters of the model by CMA-ES (thesis chapter 5: masses, stiffness, damping).
- sysid: the system identification tool of MuJoCo, with all its parameters jointly.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import cma
import numpy as np

from loco_control.exceptions import LocoError
from loco_learning.gap.fitting.fit import Problem, weigh
from loco_learning.gap.hypotheses import hypotheses
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_sim.effects.offers import Motion
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description

from . import sparse, sysid

PER_JOINT = (
    "armature", "coulomb_friction", "viscous_friction", "joint_offset", "torque_constant_error",
    "added_stiffness", "stiffness_error",
)  # fmt: skip
WHOLE = ("command_delay",)
ROUNDS, STEP, LOSS = 6, 0.3, 3.0  # number of Jacobians, difference step, robust scale
EVALUATIONS, SPREAD = 100, 0.25  # CMA-ES: evaluations, initial step of the logarithms


def run(
    names: Sequence[str],
    model: Model,
    records: Sequence[Record],
    held_out: Sequence[Record],
    seed: int = 0,
) -> dict[str, dict[str, Any]]:
    """Run baselines.

    Args:
        names: Names of the baselines, from `METHODS`.
        model: Initial model.
        records: Records to fit.
        held_out: Held-out records.
        seed: Seed of CMA-ES.

    Returns:
        Values by name: whitened rms on the held-out records before and after, effects, number of
        simulations.
    """
    case = cases.prepare(Forward(model, [*records, *held_out]), records, held_out)
    before = weigh(case, (), {}).held.rms
    results = {}
    for name in names:
        count = case.count
        effects, after = METHODS[name](case, model, seed)
        results[name] = {
            "before": before, "after": after, "found": effects, "simulations": case.count - count,
        }  # fmt: skip
    return results


def everything(case: Case, model: Model, seed: int) -> tuple[list, float]:
    """Baseline `everything`: all usual parameters jointly."""
    robot = model.make_robot()
    candidates = hypotheses.offer(robot, case.signals, _no_hints(robot))
    parts = [
        (h, [0.0 if c.strength else c.start[0] for c in h.coordinates])
        for h in candidates
        if (h.effect in PER_JOINT and h.place in robot.joints) or h.effect in WHOLE
    ]
    problem = Problem(case, parts, {}, {}, 1.0, LOSS)
    z = least_squares(problem, np.zeros(len(problem.start)), problem.bounds)
    identified, overrides = problem.split(z)
    after = weigh(case, identified, overrides).held.rms
    return [h.term(x).spec for h, x in identified], after


def least_squares(fun: Any, z: np.ndarray, bounds: tuple) -> np.ndarray:
    """Levenberg-Marquardt with bounds and a new Jacobian in each iteration."""
    r = fun(z)
    cost, damping = float(r @ r), 1e-2
    for _ in range(ROUNDS):
        side = np.where(z + STEP <= bounds[1], STEP, -STEP)
        slope = [(fun(z + h * e) - r) / h for h, e in zip(side, np.eye(len(z)), strict=True)]
        jacobian = np.stack(slope, axis=1)
        square = jacobian.T @ jacobian
        improved = False
        for _ in range(4):
            ridge = damping * np.diag(np.diag(square) + 1e-9 * np.trace(square) + 1e-12)
            new = np.clip(z - np.linalg.solve(square + ridge, jacobian.T @ r), *bounds)
            trial = fun(new)
            if trial @ trial < cost:
                improved = cost - float(trial @ trial) > 1e-3 * cost
                z, r, cost, damping = new, trial, float(trial @ trial), 0.2 * damping
                break
            damping *= 10.0
        if not improved:
            break
    return z


def terms(case: Case, model: Model, seed: int) -> tuple[list, float]:
    """Baseline `sparse`: sparse terms of the torque residual, added to the model as effects.

    Smoothing and threshold are those with the best fit; the result may have no terms.
    """
    records = [case.records[i] for i in case.fitted]
    options = [[]] + [
        sparse.discover(model.robot, records, window, threshold)
        for window in sparse.WINDOWS
        for threshold in sparse.THRESHOLDS
    ]
    errors = [float(np.mean(np.square(case.vector(specs)))) for specs in options]
    specs = options[int(np.argmin(errors))]
    return specs, _judged(case, specs, {})


def calibration(case: Case, model: Model, seed: int) -> tuple[dict, float]:
    """Baseline `cma`: masses, stiffness and damping by CMA-ES."""
    nominal = parameters(model)
    names = list(nominal)

    def values(x: np.ndarray) -> dict[str, float]:
        return {n: float(nominal[n] * np.exp(v)) for n, v in zip(names, x, strict=True)}

    def loss(x: np.ndarray) -> float:
        try:
            return float(np.mean(np.square(case.vector([], values(x)))))
        except LocoError:
            return 1e9

    options = {"seed": seed % 2**31 + 1, "maxfevals": EVALUATIONS, "verbose": -9,
               "bounds": [-1.5, 1.5]}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if len(names) == 1:  # CMA-ES needs two parameters
            x = [min(np.linspace(-0.7, 0.7, 41), key=lambda v: loss(np.array([v])))]
        else:
            strategy = cma.CMAEvolutionStrategy(np.zeros(len(names)), SPREAD, options)
            x = strategy.optimize(loss).result.xbest
    fitted = values(np.asarray(x))
    return fitted, _judged(case, [], fitted)


METHODS = {
    "everything": everything, "sparse": terms, "cma": calibration, "sysid": sysid.identify,
}  # fmt: skip


def parameters(model: Model) -> dict[str, float]:
    """Nominal values of the calibrated parameters, by dotted name; legs share parameters."""
    robot = model.make_robot()
    text, ranges = Description(robot.urdf), {}
    shared = len(robot.joints) > 4
    for joint in robot.joints:
        link = text.child(joint)
        mass = sum(text.mass_of(name) for name in text.below(link))
        ranges[f"masses.{_pattern(link, shared)}"] = float(mass)
        damping = text.damping(joint)
        if damping > 0.0:
            ranges[f"dynamics.{_pattern(joint, shared)}.damping"] = float(damping)
        spring = robot.springs.get(joint)
        if spring is not None:
            ranges[f"springs.{_pattern(joint, shared)}.stiffness"] = float(spring.stiffness)
            ranges[f"springs.{_pattern(joint, shared)}.damping"] = float(spring.damping)
    return {name: value for name, value in ranges.items() if value > 0.0}


def _pattern(name: str, shared: bool) -> str:
    """Name pattern of the same part in every leg."""
    return f"*_{name.split('_', 1)[1]}" if shared and "_" in name else name


def _judged(case: Case, specs: Sequence[Mapping[str, Any]], overrides: dict) -> float:
    """Whitened rms on the held-out records."""
    return case.judged(case.whitened(specs, overrides)).rms


def _no_hints(robot: Any) -> Any:
    n = len(robot.joints)
    return Motion(np.full(n, np.nan), np.full(n, np.nan))
