# SPDX-License-Identifier: Apache-2.0
"""Mistakes of one recording of several, or of a part of one, which no line of a mapping mends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from scipy.ndimage import uniform_filter1d

from loco_control.exceptions import LocoError
from loco_sim.bolted.loop import needs_engine
from loco_sim.plant.model import Model

from ..prediction.forward import Forward, ForwardParams
from ..recordings import lags
from ..recordings.record import Record, bridged
from . import commands, signals
from .bench import Bench, Trial, commanded
from .finding import Change, Finding, correct
from .limits import LIMITS

TESTS = (signals.turns, commands.exchanged, commands.sign, commands.scale)
CUT = ": cut the recording there (records: in a mapping)"
SIGN, SCALE = "has the other sign" + CUT, "is {:.3g} times what it was" + CUT
ZERO = "has another zero, by {:.3g}" + CUT
STANDSTILL = "stands still while its command moves: leave this part out"


def changed(model: Model, record: Record) -> Iterator[Finding]:
    """Joints whose positions have another sign, scale or zero, or none, from some row on.

    The positions are explained by the command and its rate, before and after each row. The row is
    that which leaves the least. What the model does as well, as a joint beyond its resonance moves
    against its command, is no mistake; without a simulation nothing is told.
    """
    robot, command = model.make_robot(record.overrides), record.command.get("position")
    stretch = _without_torque(record)
    if stretch is not None:
        since, until = record.t[stretch[0]], record.t[stretch[1] - 1]
        text = f"{record.name}: from {since:.2f} to {until:.2f} s measured torques are 0 while " \
               "joints depart from their commands: the drives were off, as in an emergency stop; " \
               "leave that part out (records: from, to in a mapping), or give a column the role " \
               "enable"  # fmt: skip
        yield Finding("part", (), text)
        return
    wrapped = {joint for finding in signals.wraps(record, robot) for joint in finding.joints}
    predicted = cache(partial(_predicted, model, record))
    for i, joint in enumerate(record.driven if command is not None else ()):
        if joint not in record.joints or joint in wrapped:
            continue
        c, q = command[:, i], bridged(record.signals["q"][:, record.joints.index(joint)])
        row, change, by = _change(c, q, record.dt)
        if change in (SIGN, SCALE, ZERO):
            motion = predicted().get(joint)
            row, other, by = (0, "", 0.0) if motion is None else _change(motion, q, record.dt)
            change = change if other == change else ""
        if change:
            since = f"{record.name}: from {record.t[row]:.2f} s (row {row}) on, q of {joint}"
            yield Finding("part", (joint,), f"{since} {change.format(by)}")


def _without_torque(record: Record) -> tuple[int, int] | None:
    """First row, and row after the last, of a stretch in which no drive gives its torque.

    The torques of all joints are next to nothing, and joints are farther from their commands than
    else. A drive that damps the velocity lags in proportion to it: a joint that coasts along a ramp
    needs no torque.
    """
    command, joints = record.command.get("position"), list(record.driven)
    if command is None or "enable" in record.inputs or not set(joints) <= set(record.joints):
        return None
    if not joints or not record.has("tau"):
        return None
    columns = [record.joints.index(joint) for joint in joints]
    tau, q = (bridged(record.signals[role][:, columns]) for role in ("tau", "q"))
    if not np.isfinite(tau).all() or not np.isfinite(q).all():
        return None
    width = max(round(LIMITS.pause / record.dt), 1)
    size = uniform_filter1d(np.abs(tau), width, axis=0)
    torque_free = (size < LIMITS.no_torque * np.percentile(size, 90.0, axis=0)).all(axis=1)
    torque_free = np.concatenate([[0], torque_free, [0]])
    starts, stops = (np.flatnonzero(np.diff(torque_free) == step) for step in (1, -1))
    if not len(starts):
        return None
    k = int(np.argmax(stops - starts))
    rows = slice(max(int(starts[k]) - width // 2, 0), min(int(stops[k]) + width // 2, len(tau)))
    if rows.stop - rows.start < max(LIMITS.samples, 2 * width):
        return None
    motion = zip((command - q).T, tau.T, np.gradient(q, record.dt, axis=0).T, strict=True)
    ratios = [_adrift(error, np.stack(each, axis=1), rows) for error, *each in motion]
    return (rows.start, rows.stop) if np.mean(ratios) > LIMITS.adrift else None


def _adrift(error: np.ndarray, causes: np.ndarray, rows: slice) -> float:
    """Mean square of a distance from the command in some rows, over that in the others.

    Args:
        error: Distance of a joint from its command, (T,).
        causes: Torque and velocity of the joint; their part of the distance is taken off, (T, 2).
        rows: Rows of the stretch.
    """
    outside = np.ones(len(error), dtype=bool)
    outside[rows] = False
    columns = np.column_stack([causes, np.ones(len(error))])
    left = error - columns @ np.linalg.lstsq(columns[outside], error[outside], rcond=None)[0]
    return float(np.mean(left[rows] ** 2) / max(np.mean(left[outside] ** 2), 1e-300))


def _predicted(model: Model, record: Record) -> dict[str, np.ndarray]:
    """Positions of joints by the model along a whole recording, (T,); empty without a simulation.

    A robot that needs an engine is not simulated.
    """
    if needs_engine(model.make_robot(record.overrides)):
        return {}
    try:
        forward = Forward(model, [record], ForwardParams(signals=("q",)))
        motion = forward()[0]
    except (LocoError, ValueError, np.linalg.LinAlgError):
        return {}
    columns = zip(forward.channels, motion.T, strict=True)
    return {channel.name: x for channel, x in columns if np.isfinite(x).all()}


def _change(c: np.ndarray, q: np.ndarray, dt: float) -> tuple[int, str, float]:
    """Row from which on q follows c in another way, the change in words, and its size.

    The words are empty if there is no such row.
    """
    rest = _stuck(c, q)
    if rest is not None:
        return rest, STANDSTILL, 0.0
    row, left, (before, after) = _split(c, q, dt)
    if not row or left > 1.0 / LIMITS.better**2:
        return 0, "", 0.0
    if min(np.std(c[:row]), np.std(c[row:])) < LIMITS.share * np.std(c):
        return 0, "", 0.0
    if min(abs(before[0]), abs(after[0])) < LIMITS.share:
        return 0, "", 0.0  # it hardly follows its command in one of the parts
    if max(_missed(c, q, dt, part) for part in (slice(row), slice(row, None))) > LIMITS.left:
        return 0, "", 0.0  # in one of the parts it moves otherwise than by its command
    by = after[0] / before[0]
    jump, steps = float(np.array([c[row], 0.0, 1.0]) @ (after - before)), np.abs(np.diff(q))
    leap = float(np.max(steps[max(row - 2, 0) : row + 2]))
    if by < 0.0:
        return row, SIGN, by
    if not 1.0 / LIMITS.apart_by < by < LIMITS.apart_by:
        return row, SCALE, by
    if leap > LIMITS.leap * np.percentile(steps, 99.0) and abs(jump) > 0.5 * leap:
        return row, ZERO, jump
    return 0, "", 0.0


def _stuck(c: np.ndarray, q: np.ndarray) -> int | None:
    """First row of a long stretch in which q has one value, though c moves and else moves q.

    None if the values are those of a coarse encoder, which also repeat where a joint sticks.
    """
    if len(np.unique(q)) < LIMITS.share * len(q):
        return None
    edges = np.flatnonzero(np.diff(q)) + 1
    starts, stops = np.concatenate([[0], edges]), np.concatenate([edges, [len(q)]])
    k = int(np.argmax(stops - starts))
    part = slice(int(starts[k]), int(stops[k]))
    outside = np.delete(c, part), np.delete(q, part)
    if stops[k] - starts[k] < LIMITS.share * len(q) or len(outside[0]) < LIMITS.samples:
        return None
    if lags.is_constant(c) or np.std(c[part]) < 0.5 * np.std(c):
        return None
    return int(starts[k]) if np.corrcoef(*outside)[0, 1] ** 2 > LIMITS.against**2 else None


def _regressors(c: np.ndarray, dt: float) -> np.ndarray:
    """A command, its rate and a constant, (T, 3)."""
    return np.stack([c, np.nan_to_num(lags.rates(c, dt)), np.ones(len(c))], axis=1)


def _missed(c: np.ndarray, q: np.ndarray, dt: float, part: slice) -> float:
    """Error of a fit of q by c, its rate and a constant in a part, over the deviation of q."""
    table, y = _regressors(c, dt)[part], q[part]
    by = np.linalg.lstsq(table, y, rcond=None)[0]
    return float(np.std(y - table @ by) / max(float(np.std(y)), 1e-12))


def _split(c: np.ndarray, q: np.ndarray, dt: float) -> tuple[int, float, np.ndarray]:
    """Row at which a fit of q by c, its rate and a constant changes most.

    Returns:
        The row, 0 if there are too few; squared error of both parts over that of one fit; and the
        coefficients before and after, (2, 3).
    """
    table = _regressors(c, dt)
    size = np.maximum(np.std(table, axis=0), 1e-12)
    size[2] = 1.0
    x = table / size
    margin = max(LIMITS.samples, len(q) // 10)
    rows = np.arange(margin, len(q) - margin)
    if not len(rows) or lags.is_constant(c) or lags.is_constant(q):
        return 0, 1.0, np.zeros((2, 3))
    y = q - np.mean(q)
    sums = [np.cumsum(each, axis=0) for each in (x[:, :, None] * x[:, None, :], x * y[:, None])]
    sides = [[total[rows - 1] for total in sums], [total[-1] - total[rows - 1] for total in sums]]
    small = 1e-9 * len(q) * np.eye(3)
    fits = [np.linalg.solve(a + small, b[..., None])[..., 0] for a, b in sides]
    gained = sum(np.sum(fit * b, axis=1) for fit, (_, b) in zip(fits, sides, strict=True))
    pooled = np.linalg.solve(sums[0][-1] + small, sums[1][-1])
    total = float(np.sum(y**2))
    one = max(total - float(pooled @ sums[1][-1]), 1e-12 * total)
    k = int(np.argmax(gained))
    coefficients = np.stack([fit[k] for fit in fits]) / size
    return int(rows[k]), max(total - float(gained[k]), 0.0) / one, coefficients


def isolate(
    model: Model, records: Sequence[Record], changes: Sequence[Change]
) -> tuple[list[Finding], list[Record]]:
    """Mistakes of commands of some recordings that others do not have, and those others.

    Only recordings whose motion differs from their commands in another way than in others are
    simulated.
    """
    trials = [commanded([correct(record, changes)]) for record in records]
    suspicions = [_suspicions(trial) for trial in trials]
    common = set.intersection(*suspicions) if suspicions else set()
    bench_of = cache(lambda k: Bench(model, [records[k]], changes))
    findings: dict[object, Finding] = {}
    for k, suspicion in enumerate(suspicions):
        bench = bench_of(k) if suspicion - common else None
        for finding in (f for test in TESTS if bench and bench.possible for f in test(bench)):
            findings.setdefault((finding.fault, finding.joints), finding)
    out, sound = list[Finding](), set(range(len(records)))
    for finding in findings.values():
        rows = [k for k in range(len(records)) if bench_of(k).miss(*finding.mends)
                < bench_of(k).miss()]  # fmt: skip
        if len(rows) == len(records):
            continue
        names = ", ".join(records[k].name for k in rows)
        line = " or ".join(" and ".join(map(str, fix)) for fix in (finding.mends, *finding.others))
        text = f"{names} alone: {finding.says}; a mapping for it alone would say {line}"
        out.append(replace(finding, says=text, mends=(), others=()))
        sound -= set(rows)
    return out, [records[k] for k in sorted(sound)]


def _suspicions(trial: Trial) -> set[tuple[str, str]]:
    """Faults and joints of which the motion along the commands raises one."""
    out, correlation = set[tuple[str, str]](), commands.correlations(trial)
    for i, joint in enumerate(trial.joints):
        ratio, follows = commands.moved(trial, joint)
        offset = np.nanmedian(trial.measured[0][:, i] - trial.said[0][:, i])
        suspicions = {
            "sign": correlation[i, i] < -LIMITS.against,
            "scale": follows > LIMITS.follows and not 1.0 / LIMITS.scale < ratio < LIMITS.scale,
            "turns": abs(offset) > 0.5 * signals.TURN,
            "exchanged": np.max(correlation[i])
            > max(LIMITS.follows, correlation[i, i] + LIMITS.apart),
        }
        out |= {(fault, joint) for fault, holds in suspicions.items() if holds}
    return out
