# SPDX-License-Identifier: Apache-2.0
"""Mistakes of the commands: sign, exchanged joints, scale."""

from __future__ import annotations

import itertools

import numpy as np

from loco_sim.robot.clearance import SLIDES
from loco_sim.robot.description import Description

from ..recordings import units
from . import suspect
from .bench import Bench, Trial
from .finding import JOINT, MAPPING, OFFSET, SCALE, SIGN, UNIT, Change, Finding, roles_of, unit_of
from .limits import LIMITS

MEASURED = ("q", "tau", "command")  # columns with a mistake in common, see `lines`


def sign(bench: Bench) -> list[Finding]:
    """Findings of joints that move opposite to their simulation."""
    corr, findings = np.min([np.diag(each) for each in _corr(bench)], axis=0), []
    for i, joint in enumerate(bench().joints):
        if corr[i] > -LIMITS.against:
            continue
        fixes = [lines(bench, joint, SIGN, -1, of) for of in MEASURED]
        note = (f"{joint} moves against its command: correlation {corr[i]:.2f} with it, or with "
                "what the model does")  # fmt: skip
        findings += bench.settled("sign", (joint,), note, dict.fromkeys(fixes))
    return findings


def exchanged(bench: Bench) -> list[Finding]:
    """Findings of joint pairs in which each joint follows the command of the other."""
    joints, findings = bench().joints, list[Finding]()
    pairs = itertools.combinations(range(len(joints)), 2)
    for (i, j), corr in itertools.product(pairs, _corr(bench)):
        own_corr, other = np.array([corr[i, i], corr[j, j]]), np.array([corr[i, j], corr[j, i]])
        if np.any(other < LIMITS.follows) or np.any(own_corr > other - LIMITS.apart):
            continue
        a, b = joints[i], joints[j]
        note = (f"{a} follows the command of {b} (correlation {corr[j, i]:.2f}, with its own "
                f"{corr[i, i]:.2f}) and {b} that of {a} ({corr[i, j]:.2f}, {corr[j, j]:.2f}): "
                "exchanged")  # fmt: skip
        fixes = dict.fromkeys(swap(bench, a, b, of) for of in MEASURED)
        findings += bench.settled("exchanged", (a, b), note, fixes)
    return list({one.joints: one for one in findings}.values())


def scale(bench: Bench) -> list[Finding]:
    """Findings of joints whose motion is a multiple of the simulated one."""
    findings: list[Finding] = []
    if bench.led:
        return findings  # a wrong torque scale is treated with torques and masses
    for joint in bench().joints:
        ratio, corr = max((moved(trial, joint) for trial in (bench(), bench.told())),
                           key=lambda pair: pair[1])  # fmt: skip
        if corr < LIMITS.follows or 1.0 / LIMITS.scale < ratio < LIMITS.scale:
            continue
        names = {of: named(bench, joint, by) for of, by in (("q", ratio), ("command", 1.0 / ratio))}
        unit = "".join(names.values())
        what = f"one of them in {unit}" if unit else "a scale, or a reduction of the gear"
        note = (f"q of {joint} moves {ratio:.3g} times as far as its command asks for "
                f"(correlation {corr:.3f}): {what}")  # fmt: skip
        fixes = [lines(bench, joint, *((UNIT, names[of]) if names[of] else (SCALE, by)), of)
                for of, by in (("q", 1.0 / ratio), ("command", ratio))]  # fmt: skip
        new = bench.settled("scale", (joint,), note, fixes)
        if not new and fixes[1]:  # as of an action, which begins at a posture
            zero = Change(MAPPING, OFFSET, _centre(bench, joint, ratio), fixes[1][0].role, joint)
            options = bench.settled("scale", (joint,), f"{note}, with another zero",
                                    [(*fixes[1], zero)])  # fmt: skip
            new = [finding for finding in options if finding.mends]
        findings += new
    return findings


def _centre(bench: Bench, joint: str, ratio: float) -> float:
    """Position at which a joint is, on average, less that which its scaled commands ask for."""
    trial = bench.told()
    i = trial.joints.index(joint)
    pairs = zip(trial.measured, trial.said, strict=True)
    means = [np.nanmean(q[:, i]) - ratio * np.nanmean(command[:, i]) for q, command in pairs]
    return round(float(np.mean(means)), 4)


def lines(bench: Bench, joint: str, key: str, value: float, of: str) -> tuple[Change, ...]:
    """The same change for some columns of a joint: those of `of`, or all ("").

    Of its motion (q), of all that was measured (tau), or of what was commanded (command).
    """
    roles = dict.fromkeys(role for r in bench.records for role in roles_of(r, joint))
    used = [r for r in roles if not of or r.startswith("command_") is (of == "command")]
    no = () if key == SIGN and of != "q" else ("tau",) if key == SIGN else ("tau", "command_torque")
    value_of = unit_of if key == UNIT else lambda value, role: value
    return tuple(
        Change(MAPPING, key, value_of(value, role), role, joint) for role in used if role not in no
    )


def named(bench: Bench, joint: str, by: float) -> str:
    """Unit of angles or lengths that are so many times those in rad or m; empty if none is near."""
    slides = Description(bench.robot.urdf).joint_types()[joint] == SLIDES
    legal = ("mm",) if slides else ("deg", "mrad", "rev")
    return next((u for u in legal if abs(np.log(by * units.factor(u))) < LIMITS.near), "")


def swap(bench: Bench, a: str, b: str, of: str) -> tuple[Change, ...]:
    """Changes that exchange the columns of two joints."""
    return tuple(
        Change(MAPPING, JOINT, to, c.role, c.joint)
        for joint, to in ((a, b), (b, a))
        for c in lines(bench, joint, SIGN, 1, of)
    )


def _corr(bench: Bench) -> list[np.ndarray]:
    """Correlations of the measured motion with the model's, and with the commands themselves.

    A model that a wrong command drives into the stops of its joints tells nothing.
    """
    trials = bench(), bench.told()
    return [correlations(trial) for trial in trials if trial.joints == trials[0].joints]


def correlations(trial: Trial) -> np.ndarray:
    """Correlation of each simulated joint (row) with each measured one (column), (n, n).

    Mean over the records in which both joints move; 0 if there is none.
    """
    total, n = np.zeros((len(trial.joints),) * 2), len(trial.joints)
    count = np.zeros_like(total)
    for sim, measured, moving in trial.each():
        valid = np.isfinite(sim).all(axis=1) & np.isfinite(measured).all(axis=1)
        if valid.sum() < LIMITS.samples:
            continue
        both = np.hstack([sim[valid], measured[valid]])
        both = both - both.mean(axis=0)
        size = np.sqrt(np.sum(both**2, axis=0))
        usual = both / np.where(size > 1e-9, size, np.inf)
        both_move = np.outer(moving, moving)
        total += np.where(both_move, (usual.T @ usual)[:n, n:], 0.0)
        count += both_move
    return total / np.maximum(count, 1)


def moved(trial: Trial, joint: str) -> tuple[float, float]:
    """Ratio of measured to simulated deviation of a joint, and their correlation; 0 if held."""
    if joint not in trial.joints:
        return 1.0, 0.0
    i = trial.joints.index(joint)
    rows = [(sim[:, i], measured[:, i]) for sim, measured, moves in trial.each() if moves[i]]
    return suspect.slope(*map(np.concatenate, zip(*rows, strict=True))) if rows else (1.0, 0.0)
