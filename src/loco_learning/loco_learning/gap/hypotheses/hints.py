# SPDX-License-Identifier: Apache-2.0
"""Hints for hypotheses: travel, speed and torque of joints; where and when residuals are large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_sim.bolted.loop import Bolted, needs_engine
from loco_sim.effects.coordinates import Coordinate
from loco_sim.effects.offers import Motion
from loco_sim.effects.places import members
from loco_sim.robot.robot import Robot

from ..prediction import running, windows
from ..prediction.case import Case
from ..prediction.forward import Forward
from ..recordings.record import bridged, spacing
from .hypotheses import Hypothesis

SPEED_TIME = 0.05  # [s] of a speed's average, so that one step of a coarse encoder is no speed
ENERGY_TIME = 0.1  # [s] over which the energy of a residual is averaged
QUIET, LOUD_SHARE = 3.0, 0.1  # large energy: above both, times the median and share of the maximum
LEAST_RUN = 0.1  # share of the large energy in one piece that counts (taste)
LONGEST_SHARE = 0.7  # largest share of a record that an interval may cover
MAX_SHIFT = 0.3  # largest difference of the starts of an interval in different records [s]
MOST_INTERVALS = 3  # largest number of intervals
LEAST_PERIODS, COUNTS = 1.5, (1.0, 300.0)  # periods of a ripple in the travel, and per 2 pi (taste)
PEAK = 4.0  # amplitude of a ripple over the median amplitude of all counts (taste)
MOST_ROWS, MOST_COUNTS = 4000, 600  # rows and counts that are evaluated (time)
MOST_RIPPLES = 3  # counts that are tested at a joint
# Torque of a limit over the torque of the initial model, far from reached and barely reached
# (taste). Another effect may ask for more torque, and a reading is a mean over a period.
CLEAR, BARELY = 2.0, 0.9
HIGHEST = 10.0  # largest torque of a line at standstill over that first tried (taste)
# Smallest strength that limits drives at shares of their limits, while they drive at a speed.
SMALLEST = {
    "torque_limit": lambda share, speed: 1.0 - share.max(),
    "torque_speed_line": lambda share, speed: np.where(
        speed > 0.0, (1.0 - share) / np.maximum(speed, 1e-9), np.inf
    ).min(),
}


def find(case: Case, robot: Robot) -> Motion:
    """Hints from the records and from the residual of the initial model."""
    n = len(robot.joints)
    low, high, fast = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    for record in case.records:
        q = record.joints_of(robot, "q")
        for j in range(n):
            values = q[np.isfinite(q[:, j]), j]
            if len(values):
                low[j], high[j] = np.fmin(low[j], values.min()), np.fmax(high[j], values.max())
        fast = np.fmax(fast, fastest(q, record.dt))
    fitted = case.fitted
    residuals = case.masked(case.whitened([], only=fitted), fitted, held=False)
    dts = [case.records[i].dt for i in fitted]
    by_channel = [[r[:, [c]] for r in residuals] for c in range(residuals[0].shape[1])]
    intervals = [interval(residuals, dts), *(interval(one, dts, sync=True) for one in by_channel)]
    channels = case.forward.channels
    waves = []
    for j, joint in enumerate(robot.joints):
        columns = [c for c, channel in enumerate(channels) if channel.name == joint]
        turns = [case.records[i].joints_of(robot, "q")[:, j] for i in fitted]
        torques = [c for c in columns if channels[c].signal == "tau"]
        moved = [c for c in columns if c not in torques]
        pairs = zip(residuals, dts, strict=True)
        bends = [np.hstack([r[:, torques], bend(r[:, moved], dt)]) for r, dt in pairs]
        waves.append(ripples(turns, bends))
    return Motion(low, high, distinct([each for each in intervals if each]), fast, tuple(waves))


def sized(hypotheses: Sequence[Hypothesis], forward: Forward) -> list[Hypothesis]:
    """Hypotheses with strengths of limits that count from where these are far from reached.

    Where the description has no limits, they are shares of what the model asks of the drives.

    A description may allow ten times the torque of a recording: a reduction of it is nothing up to
    90 %, and too much a few hundredths further.
    """
    result, robot, (torque, speed) = [], forward.robot(), forward.drives()
    is_limited = np.isfinite(robot.effort[robot.driven]).all()
    moved = robot.effort if is_limited else acting(forward)
    for h in hypotheses:
        if smallest := SMALLEST.get(h.effect):
            at = [robot.joints.index(joint) for joint in members(robot, h.place)]
            size, effort = np.abs(torque[:, at]), robot.effort[at]
            driving = np.maximum(speed * np.sign(torque), 0.0)[:, at]
            if not np.isfinite(effort).all():
                acted = float(moved[at].max())
                effort = CLEAR * max(float(size.max()), acted)
                if not 0.0 < acted <= effort < np.inf:
                    continue  # no torque is known
                h, size = _rated(h, effort, acted), np.minimum(size, acted)
            share = size / effort
            low, start = (max(0.0, float(smallest(by * share, driving))) for by in (CLEAR, BARELY))
            c, *shapes = h.coordinates
            if low < start < c.high:
                c = replace(c, origin=low, low=low, size=start - low)
                h = replace(h, coordinates=(c, *shapes))
        result.append(h)
    return result


def acting(forward: Forward) -> np.ndarray:
    """Largest torque that the measured motion of each joint needs [N·m or N], (n,); NaN if unknown.

    A drive that saturates gives no more, whatever its controller asks for.
    """
    largest = np.full(len(forward.robot().joints), np.nan)
    for i, record in enumerate(forward.records):
        robot, dt = forward.robot(i), running.period(record)
        q, dq = (bridged(each) for each in windows.joint_states(record, robot))
        step = _rows(q, dt)
        if needs_engine(robot) or len(q) <= 2 * step:
            continue
        rate = (dq[2 * step :] - dq[: -2 * step]) / (2 * step * dt)
        plant = Bolted(robot, (), 0, dt)
        torque, weight = plant.needed(q[step:-step], dq[step:-step], rate)
        torque = np.abs(torque + weight @ plant.gravity)
        largest = np.fmax(largest, np.nanmax(torque, axis=0, initial=0.0))
    return largest


def _rated(hypothesis: Hypothesis, effort: float, acted: float) -> Hypothesis:
    """A limit of drives whose description has none, as a share of an effort [N·m or N].

    A line over speed has another one at standstill, which is fitted; it is at least what acted.
    """
    if hypothesis.effect == "torque_limit":
        return replace(hypothesis, fixed=(*hypothesis.fixed, ("rated", effort)))
    shape = Coordinate("rated", CLEAR * acted, (0.0,), BARELY * acted, HIGHEST * effort, "N·m",
                       logarithmic=True)  # fmt: skip
    return replace(hypothesis, coordinates=(*hypothesis.coordinates, shape))


def bend(values: np.ndarray, dt: float) -> np.ndarray:
    """Second difference over `SPEED_TIME`, (T, C): of positions, proportional to missing torque."""
    step, curvature = _rows(values, dt), np.full(values.shape, np.nan)
    if len(values) > 2 * step:
        middle = values[step:-step]
        curvature[step:-step] = values[2 * step :] - 2.0 * middle + values[: -2 * step]
    return curvature


def ripples(angles: Sequence[np.ndarray], residuals: Sequence[np.ndarray]) -> tuple[float, ...]:
    """Periods per 2 pi of residuals that oscillate over the joint angle, the clearest first.

    Args:
        angles: Angle of the joint [rad], (T,) per record.
        residuals: Residuals of the channels of the joint, (T, C) per record: torques, and second
            differences of the motion. A controller that sees the ripple answers it in its torque.

    Returns:
        Counts, at most `MOST_RIPPLES`; empty if the angle is not known or no count stands out in
        any channel.
    """
    q = np.concatenate(angles)
    r = np.concatenate(residuals)
    valid = np.isfinite(q) & np.isfinite(r).all(axis=1)
    q, r = q[valid], r[valid]
    if r.size < 2 or not np.ptp(q) > 0.0:
        return ()
    stride = max(1, len(q) // MOST_ROWS)
    q, r = q[::stride], r[::stride] - r[::stride].mean(axis=0)
    spacing = np.pi / (2.0 * np.ptp(q))
    first = max(4.0 * LEAST_PERIODS * spacing, COUNTS[0])
    counts = np.arange(first, min(COUNTS[1], first + MOST_COUNTS * spacing), spacing)
    if len(counts) < 3:
        return ()
    loud = np.abs([np.exp(-1j * c * q) @ r for c in counts])
    loud = np.max(loud / np.maximum(np.median(loud, axis=0), 1e-300), axis=1)
    inner = (loud[1:-1] >= loud[:-2]) & (loud[1:-1] >= loud[2:])
    peaks = 1 + np.flatnonzero(inner & (loud[1:-1] > PEAK))
    best = peaks[np.argsort(-loud[peaks], kind="stable")][:MOST_RIPPLES]
    return tuple(float(c) for c in counts[best])


def fastest(q: np.ndarray, dt: float) -> np.ndarray:
    """Largest speed of each joint [rad/s], (n,), from positions (T, n); NaN where unknown."""
    step = _rows(q, dt)
    change = np.abs(q[step:] - q[:-step])
    measured = np.isfinite(change).any(axis=0)
    speeds = np.full(q.shape[1], np.nan)
    speeds[measured] = np.nanmax(change[:, measured], axis=0) / (step * dt)
    return speeds


def _rows(values: np.ndarray, dt: float) -> int:
    """Rows over `SPEED_TIME`, as a multiple of those between readings: of a slow log, several."""
    between = spacing(np.flatnonzero(np.isfinite(values).any(axis=1)))
    return between * max(1, round(SPEED_TIME / (between * dt)))


def distinct(intervals: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The first few intervals that differ in start or end."""
    selected: list[tuple[float, float]] = []
    for each in intervals:
        if all(np.ptp([each, other], axis=0).max() > 2.0 * ENERGY_TIME for other in selected):
            selected.append(each)
    return tuple(selected[:MOST_INTERVALS])


def interval(
    residuals: Sequence[np.ndarray], dts: Sequence[float], sync: bool = False
) -> tuple[float, float] | None:
    """Time interval outside of which all residuals are small [s]; None if there is none.

    Args:
        residuals: Whitened, (T, C) per record.
        dts: Sampling period of each record [s].
        sync: Whether it must start at about the same time in all records that show it.
    """
    starts, stops = [], []
    for r, dt in zip(residuals, dts, strict=True):
        energy = np.nanmean(np.where(np.isfinite(r), np.square(r), 0.0), axis=1)
        width = max(1, round(ENERGY_TIME / dt))
        energy = np.convolve(energy, np.ones(width) / width, mode="same")
        loud = np.flatnonzero(
            energy > max(QUIET * max(np.median(energy), 1.0), LOUD_SHARE * energy.max())
        )
        runs = np.split(loud, np.flatnonzero(np.diff(loud) > 1) + 1)
        threshold = LEAST_RUN * energy[loud].sum()
        loud = np.concatenate([run for run in runs if energy[run].sum() >= threshold] or [loud[:0]])
        if (
            len(loud) == 0
            or (loud[-1] - loud[0]) > LONGEST_SHARE * len(energy)
            or loud[0] < 2 * width
        ):
            continue
        starts.append(loud[0] * dt)
        stops.append(loud[-1] * dt)
    if 2 * len(starts) < len(residuals) or not starts:
        return None
    if sync and np.ptp(starts) > MAX_SHIFT:
        return None
    return round(float(np.median(starts)), 3), round(float(np.median(stops)), 3)
