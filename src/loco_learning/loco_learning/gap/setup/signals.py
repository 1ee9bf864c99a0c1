# SPDX-License-Identifier: Apache-2.0
"""Mistakes of signals: wraps, whole turns, measured commands, fixed or free base."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ImpedanceDrive

from ..recordings import lags
from ..recordings.record import Record, bridged
from . import suspect
from .bench import Bench
from .finding import MAPPING, MODEL, OFFSET, WRAP, Change, Finding
from .limits import LIMITS

TURN = 2.0 * np.pi
MEASURED = (
    ": the command was measured, or its clock is late; name the column of what the drive was told"
)
BLOCKS = 8  # parts of a recording that are left out in turn for the error of a fit (jackknife)


def wraps(record: Record, robot: Robot) -> Iterator[Finding]:
    """Joints whose positions, or commands as well, repeatedly jump by one period."""
    text, command = Description(robot.urdf), record.command.get("position")
    for i, joint in enumerate(record.joints):
        fastest = text.velocity(joint) or LIMITS.fastest
        period, rows = _period(bridged(record.signals["q"][:, i]), fastest * record.dt)
        if not len(rows):
            continue
        roles = ["q"]
        if command is not None and joint in record.driven:
            commanded = command[:, record.driven.index(joint)]
            other, _ = _period(commanded, fastest * record.dt)
            roles += ["command_position"] * (abs(other - period) < 0.05 * period)
        what = "q and command" if len(roles) > 1 else "q"
        note = (f"q of {joint} jumps by {period:.4g} {len(rows)} times, the first at "
                f"{record.t[rows[0]]:.2f} s: {what} wrap" + "s" * (len(roles) == 1))  # fmt: skip
        mends = tuple(Change(MAPPING, WRAP, period, role, joint) for role in roles)
        yield Finding("wrap", (joint,), note, mends)


def _period(x: np.ndarray, farthest: float) -> tuple[float, np.ndarray]:
    """Size of repeated equal jumps that are faster than a motion, and their rows; 0 if none are."""
    step = np.diff(x)
    usual = float(np.percentile(np.abs(step), 90.0))
    rows = np.flatnonzero(np.abs(step) > max(20.0 * usual, 3.0 * farthest, 1e-9))
    rows = rows[np.diff(rows, prepend=-2) > 1]  # a jump between samples counts once
    if len(rows) < LIMITS.jumps:
        return 0.0, rows[:0]
    sizes = np.abs([step[r : r + 2].sum() - 2.0 * np.median(step[max(r - 5, 0) : r + 7])
                    for r in rows])  # fmt: skip
    period = float(np.median(sizes))
    if np.max(np.abs(sizes - period)) > 0.05 * period:
        return 0.0, rows[:0]
    parts = TURN / period
    return (TURN / round(parts) if abs(parts - round(parts)) < 0.03 * parts else period), rows


def base(record: Record, robot: Robot) -> Iterator[Finding]:
    """A base that moves although robot.yaml fixes it, or rests although it is free there."""
    gyro = record.signals.get("gyro")
    if gyro is None or not np.isfinite(gyro).any():
        return
    turning = float(np.nanpercentile(np.linalg.norm(gyro, axis=1), 90.0))
    rates = [lags.rates(bridged(x), record.dt) for x in record.signals["q"].T]
    moving = max(float(np.nanpercentile(np.abs(x), 90.0)) for x in rates)
    if robot.fixed_base and turning > LIMITS.turning:
        note = f"the base is bolted in robot.yaml, but its gyro turns at {turning:.2g} rad/s"
        yield Finding("base", (), note, (Change(MODEL, "fixed_base", False),))
    elif not robot.fixed_base and turning < LIMITS.resting and moving > LIMITS.moving:
        note = (f"the base is free in robot.yaml, but its gyro turns at {turning:.2g} rad/s only "
                f"while joints move at {moving:.2g} rad/s: bolted")  # fmt: skip
        yield Finding("base", (), note, (Change(MODEL, "fixed_base", True),))


def turns(bench: Bench) -> list[Finding]:
    """Findings of joints whose positions differ from their commands by whole turns."""
    trial, findings = bench.told(), []
    types = Description(bench.robot.urdf).joint_types()
    for i, joint in enumerate(trial.joints):
        offset = np.concatenate(trial.measured)[:, i] - np.concatenate(trial.said)[:, i]
        count = round(float(np.nanmedian(offset)) / TURN) if np.isfinite(offset).any() else 0
        if not count or types.get(joint) == "prismatic":
            continue
        note = (f"q of {joint} is {np.nanmedian(offset):.3g} rad away from its command, about "
                f"{count} turns")  # fmt: skip
        fixes = [(Change(MAPPING, OFFSET, -TURN * count, "q", joint),),
                (Change(MAPPING, OFFSET, TURN * count, "command_position", joint),)]  # fmt: skip
        findings += bench.settled("turns", (joint,), note, fixes)
    return findings


def relative(bench: Bench) -> list[Finding]:
    """Finding of joints whose rate follows their commanded position, as that of no model does.

    Such a command is a change of the position, as the actions of many learnt policies are.
    """
    joints, corr = list[str](), dict[str, float]()
    for joint in bench().joints if not (bench.led or bench.free) else ():
        measured, simulated = (min(each) for each in zip(*_of_rates(bench, joint), strict=True))
        if measured > LIMITS.follows and measured - simulated > LIMITS.apart:
            if bench().miss([joint]) > LIMITS.left:
                joints.append(joint)
                corr[joint] = measured
    if not joints:
        return []
    text = (f"the rate of {', '.join(joints)} follows the commanded position (correlation "
            f"{min(corr.values()):.2f}): the command is a change of the position, as a delta "
            "action, or a velocity; write the position that the drive was told into the recording, "
            "or give it the role command_velocity")  # fmt: skip
    return [Finding("relative", tuple(joints), text)]


def _of_rates(bench: Bench, joint: str) -> Iterator[tuple[float, float]]:
    """Correlations of the rate of a joint, measured and simulated, with its position command.

    At the best delay up to `LIMITS.soon`, for each record; -1 for one that is not commanded.
    """
    run = bench()
    for record, model_q in zip(bench.told_records(), run.said, strict=True):
        command = record.command.get("position")
        if command is None or joint not in record.driven:
            yield -1.0, -1.0
            continue
        command_q = command[:, record.driven.index(joint)]
        q = record.signals["q"][:, record.joints.index(joint)], model_q[:, run.joints.index(joint)]
        measured, simulated = (lags.rates(bridged(x), record.dt) for x in q)
        shifts = range(1 + round(LIMITS.soon / record.dt))
        yield tuple(max(suspect.slope(command_q[: len(command_q) - k], rate[k:])[1] for k in shifts)
                    for rate in (measured, simulated))  # fmt: skip


def ahead(bench: Bench) -> list[Finding]:
    """Findings of joints whose motion precedes their command: the command was measured as well.

    A command that is late by one time at several joints is one finding, of all joints that it
    explains.
    """
    findings, leads, delays = list[Finding](), dict[str, float](), dict[str, float]()
    for joint in bench().joints if not (bench.led or bench.free) else ():
        lead, due, error, expected = _following(bench, joint)
        delays[joint] = due - lead
        if lead < -LIMITS.early * bench.records[0].dt <= due:
            leads[joint] = lead
        elif error < LIMITS.same * expected and lead <= 0.0:
            text = (f"q of {joint} follows its command to {error:.2%}, where the drive would leave "
                    f"{expected:.1%}{MEASURED}")  # fmt: skip
            findings.append(Finding("ahead", (joint,), text))
            del delays[joint]
    time = float(np.median([delays[joint] for joint in leads])) if leads else 0.0
    slack = max(LIMITS.common * time, bench.records[0].dt)
    common = [joint for joint, by in delays.items() if abs(by - time) < slack]
    if leads and len(common) > 1 and set(leads) <= set(common):
        text = (f"the commands of {', '.join(common)} are late by {1e3 * time:.3g} ms, and the "
                f"motion of {', '.join(leads)} is ahead of them{MEASURED}")  # fmt: skip
        return [*findings, Finding("ahead", tuple(common), text)]
    for joint, lead in leads.items():
        text = f"the motion of {joint} is {-1e3 * lead:.3g} ms ahead of its command{MEASURED}"
        findings.append(Finding("ahead", (joint,), text))
    return findings


def _following(bench: Bench, joint: str) -> tuple[float, float, float, float]:
    """Delay of a joint after its command, measured and simulated [s]; distances to the command."""
    commands, run = bench.told(), bench()
    if joint not in commands.joints:
        return 0.0, 0.0, 1.0, 0.0
    i, k = commands.joints.index(joint), run.joints.index(joint)
    record = bench.told_records()[0]
    command = record.command["position"][:, record.driven.index(joint)]
    q = bridged(record.signals["q"][:, record.joints.index(joint)])
    rates = [lags.rates(x, record.dt) for x in (command, q, bridged(run.said[0][:, k]))]
    delays = [lags.lag(rates[0], rate, record.dt, lags.SHARPER) for rate in rates[1:]]
    lead, due = (time if corr > lags.LAG_IS_TOLD else 0.0 for time, corr in delays)
    size = max(float(np.std(command)), 1e-12)
    error = float(np.sqrt(np.nanmean((commands.measured[0][:, i] - command) ** 2))) / size
    usual = float(np.sqrt(np.nanmean((run.said[0][:, k] - command) ** 2))) / size
    return lead, due, error, usual


def regressed(bench: Bench, joint: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Gains kp and kd of a drive by regression of the measured torque, and their errors, (2,).

    Returns:
        None if the torque was not measured, is not that of an impedance drive, or tells too little.
    """
    drive, tables = bench.robot.drives.get(joint), []
    for record in bench.told_records():
        if not isinstance(drive, ImpedanceDrive) or drive.integrates or not record.has("tau"):
            return None
        i, k = record.driven.index(joint), record.joints.index(joint)
        q, tau = (bridged(record.signals[signal][:, k]) for signal in ("q", "tau"))
        dq = bridged(record.signals["dq"][:, k]) if record.has("dq") else lags.rates(q, record.dt)
        wish = record.command.get("velocity", np.zeros((len(q), i + 1)))[:, i]
        error = record.command["position"][:, i] - q
        tables.append(np.stack([error, drive.speed_feed * wish - dq, np.ones(len(q)), tau], axis=1))
    table = np.concatenate([rows[np.isfinite(rows).all(axis=1)] for rows in tables])
    parts = [np.delete(table, part, axis=0) for part in np.array_split(range(len(table)), BLOCKS)]
    (by, corr), *each = (_fitted(part) for part in (table, *parts))
    error = np.sqrt(BLOCKS - 1.0) * np.std([one for one, _ in each], axis=0)
    by = by * np.sign(by[0])  # the torque may be logged with the other sign
    is_significant = corr > LIMITS.exact and by[0] > LIMITS.sure * error[0] and by[1] >= 0.0
    return (by, error) if is_significant else None


def _fitted(table: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients of the first two columns for the last, (2,), and its correlation with all."""
    by = np.linalg.lstsq(table[:, :-1], table[:, -1], rcond=None)[0]
    return by[:2], suspect.slope(table[:, :-1] @ by, table[:, -1])[1]
