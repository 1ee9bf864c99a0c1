# SPDX-License-Identifier: Apache-2.0
"""Strengths at which a hidden effect is small, medium or large.

The size is defined by visibility: the largest rms deviation of any sensor over all records from
the machine without the effect, in units of the noise floor of sensors and integration. The part
that uncertain masses, inertias and motors can explain is subtracted: a payload of one percent
cannot be distinguished from links that are one percent heavier.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.optimize import lsq_linear

from .drawn import fleet
from .physics import conditions, excitation, kinds, plant
from .physics.hidden import Hidden
from .physics.machines import Machine

TARGETS = {"small": 1.7, "medium": 5.0, "large": 15.0}  # whitened residual rms
TOLERANCE, TRIES = 0.25, 7
CHANCE = 2.5  # largest change due to the integration step [floors]
SEEN = 0.75  # smallest accepted share of the target
MOST, ROUNDS = 2.5, 4  # bound [standard deviations]; iterations of the fit


@lru_cache(maxsize=8)
def reference(robot: str, seed: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Readings without hidden effects, (T, C) per fit record, and their noise floor, (C,)."""
    machine = _quick(robot)
    nominal, gap, count = [], 0.0, 0
    for kind in excitation.fitted(machine):
        moved = excitation.command(machine, kind, seed)
        a = columns(plant.record(machine, (), moved, 1, kind))
        b = columns(plant.record(plant.coarser(machine), (), moved, 2, kind))
        nominal.append(a)
        gap, count = gap + np.sum((a - b) ** 2, axis=0), count + len(a)
    steps = [s.step if not len(s.table[0]) else 1e-4 for s in machine.sensors]
    if machine.torque_noise:
        steps += [machine.torque_noise] * len(machine.joints)
    if machine.speed_noise is not None:
        steps += machine.speed_noise.tolist()
    return tuple(nominal), np.sqrt(gap / count / 2.0 + np.square(steps) / 12.0)


def _quick(robot: str) -> Machine:
    """The machine with fewer integration steps, since sizes need not be exact.

    Its sensors are read at even times: two readings at other times cannot be compared.
    """
    machine = replace(fleet.get(robot), jitter=0.0)
    return machine.with_steps(machine.quick or machine.steps // 2)


def columns(reading: plant.Reading) -> np.ndarray:
    """All sensors of a reading side by side, (T, C)."""
    parts = (reading.q, reading.tau, reading.dq)
    return np.hstack([part for part in parts if part is not None])


def visibility(robot: str, effects: Sequence[Hidden], seed: int) -> float:
    """Largest whitened rms over the sensors; 1 if the effect is invisible, inf if it diverges.

    Args:
        robot: Name of the machine.
        effects: Hidden effects.
        seed: Seed of the excitation.
    """
    machine = _quick(robot)
    moved = _moved(machine, effects, robot, seed)
    if moved is None:
        return float("inf")
    jacobian, factor = doubts(robot, seed)
    by, like, minimum = np.zeros(jacobian.shape[1]), np.zeros_like(moved), np.inf
    for _ in range(ROUNDS if machine.servo else 1):
        side = jacobian.T @ (moved - like).ravel() - by
        bounds = (-MOST - by, MOST - by)
        step = lsq_linear(factor.T, np.linalg.solve(factor, side), bounds).x
        by = by + step
        if machine.servo:  # an encoder's rounding is nonlinear
            like = _moved(_off(machine, by), (), robot, seed)
        else:
            like = like + (jacobian @ step).reshape(moved.shape)
        minimum = min(minimum, float(np.max(np.mean(np.square(moved - like), axis=0))))
    return float(np.sqrt(1.0 + minimum))


def _moved(machine: Machine, effects: Sequence[Hidden], robot: str, seed: int) -> np.ndarray | None:
    """Change of all records due to effects or another machine [floors], (T, C).

    None if the simulation diverges.
    """
    nominal, floor = reference(robot, seed)
    rows = []
    known = _quick(robot)
    for kind, base in zip(excitation.fitted(known), nominal, strict=True):
        moved = excitation.command(known, kind, seed)
        perturbed = columns(plant.record(machine, effects, moved, 1, kind))
        if not np.all(np.isfinite(perturbed)) or np.max(np.abs(perturbed)) > 1e4:
            return None
        rows.append((perturbed - base) / floor)
    return np.concatenate(rows)


@lru_cache(maxsize=2)
def doubts(robot: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities to the uncertain parameters: masses, inertias, motors.

    Returns:
        The change of the readings per standard deviation of each parameter [floors], (T C, K), and
        the Cholesky factor of their Gram matrix plus the prior (identity), (K, K).
    """
    machine = _quick(robot)
    count = len(machine.joints) * (4 if machine.servo else 3)
    moved = [_moved(_off(machine, by), (), robot, seed).ravel() for by in np.eye(count)]
    jacobian = np.stack(moved, axis=1)
    return jacobian, np.linalg.cholesky(jacobian.T @ jacobian + np.eye(count))


def _off(machine: Machine, by: np.ndarray) -> Machine:
    """The machine with parameters changed by multiples `by` of their standard deviations."""
    shares = by.reshape(-1, len(machine.joints))
    return conditions.altered(
        machine, *(1.0 + shares * np.array(machine.doubt[: len(shares)])[:, None])
    )


def sized(
    name: str, robot: str, size: str, rng: np.random.Generator, seed: int
) -> tuple[Hidden, float] | None:
    """A random effect with the visibility of a size class, and its visibility.

    None if it has no place on the robot, or does not reach this visibility within its bounds.
    """
    drawn = kinds.draw(name, fleet.get(robot), rng)
    if drawn is None:
        return None
    effect, low, high = drawn
    target, best = TARGETS[size], (effect, 0.0)
    bounds = [np.log(low), np.log(high)]
    at = 0.5 * (bounds[0] + bounds[1])
    for _ in range(TRIES):
        effect = effect.scaled(float(np.exp(at)))
        size_rms = visibility(robot, (effect,), seed)
        if np.isfinite(size_rms) and abs(size_rms - target) < abs(best[1] - target):
            best = (effect, size_rms)
        if abs(np.log(size_rms / target)) < TOLERANCE:
            break
        bounds[0 if size_rms < target else 1] = at
        slope = np.clip(0.5 * np.log((target**2 - 1.0) / max(size_rms**2 - 1.0, 1e-3)), -2.5, 2.5)
        inside = (
            bounds[0] + 0.05 * (bounds[1] - bounds[0]),
            bounds[1] - 0.05 * (bounds[1] - bounds[0]),
        )
        at = float(np.clip(at + slope, *inside)) if np.isfinite(size_rms) else np.mean(bounds)
    visible = best[1] >= SEEN * target and best[1] > 1.2
    return best if visible and chance(robot, best[0], seed) < CHANCE else None


def chance(robot: str, effect: Hidden, seed: int) -> float:
    """Change of the readings due to the integration step [floors].

    Stick-slip and hunting can amplify rounding differences until they are visible; then the record
    cannot be used to evaluate a model.
    """
    machine = _quick(robot)
    _, floor = reference(robot, seed)
    largest = 0.0
    for kind in excitation.fitted(machine):
        moved = excitation.command(machine, kind, seed)
        a = columns(plant.record(machine, [effect], moved, 1, kind))
        b = columns(plant.record(plant.coarser(machine), [effect], moved, 2, kind))
        largest = max(largest, float(np.max(np.sqrt(np.mean(((a - b) / floor) ** 2, axis=0)))))
    return largest / np.sqrt(2.0)


def rounded(effect: Hidden) -> Hidden:
    """The effect with parameters rounded to four digits, for a readable truth file."""
    return Hidden(
        effect.effect, effect.place, effect.strength,
        {key: _short(value) for key, value in effect.params.items()},
    )  # fmt: skip


def _short(value):
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return [_short(v) for v in value] if isinstance(value, (list, tuple)) else value


def check(machine: Machine, effect: Hidden) -> bool:
    """Whether a machine can have the effect at its place."""
    valid = (*machine.joints, *machine.body.links, "")
    return effect.place in valid
