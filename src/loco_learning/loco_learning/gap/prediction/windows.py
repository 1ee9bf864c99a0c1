# SPDX-License-Identifier: Apache-2.0
"""Pieces of a record that each start in the measured state: multiple shooting.

For a robot that falls over or steps on ground, initial errors do not decay: a simulation from the
first sample departs after the first contact that comes too late. Short simulations from smoothed
measurements stay close.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from loco_sim import lazy
from loco_sim.effects.base import Effect, overrides
from loco_sim.geometry import multiply
from loco_sim.robot.robot import Robot
from loco_sim.world.world import Base

from ..recordings.record import Record
from ..statistics import noise
from . import odometry
from .channels import at_home, heading
from .running import Start

signal = lazy.module("scipy.signal")  # loaded on first use, since it takes 0.5 s

HALVES = (2, 3, 5, 8, 13)  # half widths of local polynomials [samples]
LONGER = (21, 34, 55)  # further ones at the start of a record, where a robot mostly rests
AGREES = 1.5  # largest difference to shorter ones, in deviations (least error on a wave)
JUMP = 0.02  # time around a touch-down or lift-off in which velocities jump [s]
CHANCE = 1.5  # noise deviations of the cubic coefficient at which a parabola still fits
CURVED = 0.1  # largest rms of a command about a parabola, of its range; steps have 0.15 (taste)


def segments(record: Record, robot: Robot, length: float) -> list[Start]:
    """Consecutive pieces of a record that start where the state of the robot was measured.

    A single remaining sample belongs to the last piece. On the ground, pieces start where no foot
    touches down or lifts off, since velocities jump there.

    Args:
        record: Measured record.
        robot: The robot; joints that were not measured have their standing position.
        length: Length of each piece [s].
    """
    rows = max(2, round(length / record.dt))
    q, dq = joint_states(record, robot)
    bases = None if robot.fixed_base else base_states(record)
    quiet = np.ones(len(record.t), dtype=bool)
    if bases and not any(bases):
        legs = odometry.legs(record, robot, q, dq)
        bases, quiet = carried_states(legs), quiet if legs is None else steady(legs, JUMP)
    starts, stop = [], 0
    while stop < len(record.t) - 1:
        row, stop = stop, min(stop + rows, len(record.t))
        later = np.flatnonzero(quiet[row : row + rows // 2])
        row += int(later[0]) if len(later) else 0
        base = bases[row] if bases else None
        valid = np.all(np.isfinite(q[row])) and np.all(np.isfinite(dq[row]))
        if valid and (robot.fixed_base or base is not None):
            stop = row + rows if row + rows < len(record.t) - 1 else len(record.t)
            starts.append(Start(row, stop, q[row], dq[row], base))
    return starts


def steady(legs: odometry.Legs, time: float) -> np.ndarray:
    """Samples without touch-down or lift-off within a time [s] before and after, (T,) flags."""
    return ~binary_dilation(legs.steps, iterations=max(1, round(time / legs.dt)))


def adjust_starts(
    robot: Robot, effects: Sequence[Effect], starts: list[Start], legs: odometry.Legs | None
) -> list[Start]:
    """Pieces with the base states that a robot with effects has, given its IMU and leg data."""
    acting = [effect for effect in effects if not effect.absent()]
    if legs and any(overrides(effect, "depth") for effect in acting):
        load, depth = dict(zip(robot.feet, legs.load.T, strict=True)), np.zeros(legs.load.shape)
        for effect in acting:
            for foot, offset in effect.depth(load, legs.dt).items():
                depth[:, robot.feet.index(foot)] += offset
        bases = carried_states(legs, depth)
        starts = [s._replace(base=bases[s.row]) for s in starts]
    for effect in acting:
        if overrides(effect, "begin"):
            starts = [s._replace(base=effect.begin(s.base)) for s in starts]
    return starts


def select_evenly(starts: list[Start], limit: int) -> list[Start]:
    """At most `limit` of the pieces, evenly spread."""
    rows = np.unique(np.linspace(0, len(starts) - 1, min(limit, len(starts))).round().astype(int))
    return [starts[i] for i in rows]


class StateStd(NamedTuple):
    """Standard deviations of the initial states of the pieces of a record.

    Attributes:
        q: Deviation of joint positions [rad or m], (T, n).
        dq: Deviation of joint velocities, (T, n).
        velocity: Deviation of the velocity of the base [m/s].
        height: Deviation of the height of the base [m].
        turn: Deviation of the attitude of the base [rad].
        spin: Deviation of the angular velocity of the base [rad/s].
    """

    q: np.ndarray
    dq: np.ndarray
    velocity: float
    height: float
    turn: float
    spin: float


def state_std(record: Record, robot: Robot) -> StateStd:
    """Standard deviations of the initial states of the pieces of a record."""
    shape = len(record.t), len(robot.joints)
    if robot.fixed_base:
        q, dq = np.zeros((2, *shape))
        for joint, estimate in enumerate(_joints(record, robot)):
            if estimate is not None:
                q[:, joint], dq[:, joint] = estimate.level_noise, estimate.rate_noise
        return StateStd(q, dq, 0.0, 0.0, 0.0, 0.0)
    readings = {k: record.read_of(robot, k) for k in ("q", "dq")}
    error = {
        k: np.array(
            [deviation(x, record.step_of(k, j)) for x, j in zip(v.T, robot.joints, strict=True)]
        )
        for k, v in readings.items()
    }
    reach = (2 * HALVES[0] + 1) ** 1.5 * record.dt / np.sqrt(12.0)  # for a parabola's slope
    speed = np.where(np.isfinite(readings["dq"]).any(axis=0), error["dq"], error["q"] / reach)
    estimate = odometry.legs(record, robot, *joint_states(record, robot))
    moved, high = odometry.estimate_base(estimate).apart if estimate else (0.0, 0.0)
    turn = 2.0 * _of_imu(record, "orientation") if estimate else 0.0
    spin = _of_imu(record, "gyro")
    joints = (np.broadcast_to(each, shape) for each in (error["q"], speed))
    return StateStd(*joints, moved, high, turn, spin)


def perturb(starts: list[Start], std: StateStd, rng: np.random.Generator) -> list[Start]:
    """Pieces with initial states drawn from their uncertainty."""
    result = []
    for s in starts:
        q, dq = (rng.standard_normal(len(s.q)) for _ in range(2))
        v, w, r = rng.standard_normal((3, 3))
        base = s.base and Base(
            (*s.base.position[:2], s.base.position[2] + std.height * rng.standard_normal()),
            multiply((*(0.5 * std.turn * r), 1.0), s.base.orientation),
            tuple(s.base.velocity + std.velocity * v),
            tuple(s.base.angular_velocity + std.spin * w),
        )
        q, dq = s.q + std.q[s.row] * q, s.dq + std.dq[s.row] * dq
        result.append(s._replace(q=q, dq=dq, base=base))
    return result


def deviation(values: np.ndarray, step: float) -> float:
    """Standard deviation of a column's noise, given its quantisation step; 0 if not measured."""
    return noise_of(values[np.isfinite(values)], step)


def _of_imu(record: Record, signal: str) -> float:
    """Noise of the first component of an IMU signal; 0 if it was not measured."""
    if not record.has(signal):
        return 0.0
    return deviation(record.signals[signal][:, 0], record.step(signal))


def carried_states(
    legs: odometry.Legs | None, depth: np.ndarray | None = None
) -> list[Base] | None:
    """Base state at each sample from IMU and legs, at x = y = 0; None without them."""
    if legs is None:
        return None
    motion = odometry.estimate_base(legs, depth)
    rows = zip(motion.height, legs.turn, motion.velocity, legs.spin, strict=True)
    return [
        Base((0.0, 0.0, float(z)), tuple(r.tolist()), tuple(v.tolist()), tuple(w.tolist()))
        for z, r, v, w in rows
    ]


def joint_states(record: Record, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed positions [rad or m] and velocities of the joints, (T, n) each.

    For a fixed base, velocities are derivatives of the positions where the velocity sensor is
    noisier, as those of drives often are. On the ground they are the sensor's, with its jumps at
    contacts.
    """
    q = np.repeat(robot.standing[None].astype(float), len(record.t), axis=0)
    dq = np.zeros(q.shape)
    for joint, estimate in enumerate(_joints(record, robot)):
        if estimate is not None:
            q[:, joint], dq[:, joint] = estimate.level, estimate.rate
    return q, dq


def _joints(record: Record, robot: Robot) -> list[Smooth | None]:
    """Smoothed position and velocity of each joint for `joint_states`; None if not measured."""
    measured, speeds = record.joints_of(robot, "q"), record.joints_of(robot, "dq")
    estimates: list[Smooth | None] = []
    for joint, read, speed in zip(robot.joints, measured.T, speeds.T, strict=True):
        step, speed_step = record.step_of("q", joint), record.step_of("dq", joint)
        estimate = None if np.all(np.isnan(read)) else smoothed(read, record.dt, step)
        if estimate is not None and np.isfinite(speed).all():
            direct = smoothed(speed, record.dt, speed_step)
            prefer = (direct.level_noise <= estimate.rate_noise) | (not robot.fixed_base)
            pairs = (direct.level, estimate.rate), (direct.level_noise, estimate.rate_noise)
            rate, left = (np.where(prefer, *pair) for pair in pairs)
            estimate = estimate._replace(rate=rate, rate_noise=left)
        estimates.append(estimate)
    return estimates


def first_state(record: Record, robot: Robot) -> np.ndarray:
    """Position [rad or m], velocity and acceleration of the joints at the first sample, (3, n).

    Smoothed over the first samples only, so that a robot that first rests and later moves fast is
    smoothed over its rest.
    """
    state = np.zeros((3, len(robot.joints)))
    state[0] = robot.standing
    for joint, estimate in _firsts(record, robot):
        state[:, joint] = estimate[:3]
    return state


def first_doubt(record: Record, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of `first_state`, (n,) each; 0 for joints that were not measured."""
    q, dq = np.zeros(len(robot.joints)), np.zeros(len(robot.joints))
    for joint, estimate in _firsts(record, robot):
        q[joint], dq[joint] = estimate[3:]
    return q, dq


def _firsts(record: Record, robot: Robot) -> Iterator[tuple[int, tuple]]:
    """Index of each measured joint with the results of `_first`."""
    measured = record.joints_of(robot, "q")
    commands = np.zeros_like(measured)
    if "position" in record.command:
        commands[:, robot.driven] = record.command_of(robot, "position")
    for joint in range(len(robot.joints)):
        if np.isfinite(measured[:, joint]).sum() > 2 * HALVES[0]:
            step = record.step_of("q", robot.joints[joint])
            rows, values, sigma = _first_readings(measured[:, joint].tobytes(), step)
            command = commands[np.rint(rows).astype(int), joint]
            columns = (x.tobytes() for x in (rows * record.dt, values, command))
            yield joint, _first_of(*columns, sigma)


@lru_cache(maxsize=64)
def _first_readings(column: bytes, step: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Rows and values of the readings that `_first` may need, (S,), and the noise of all.

    The tests of a set-up change one joint of many.
    """
    rows, values = _of_sensor(np.frombuffer(column))
    sigma = float(np.hypot(noise_of(values, step), 0.5 * step))  # quantisation included
    max_samples = 2 * max(*HALVES, *LONGER) + 1
    return rows[:max_samples], values[:max_samples], sigma


@lru_cache(maxsize=4096)
def _first_of(t: bytes, values: bytes, command: bytes, sigma: float) -> tuple[float, ...]:
    """`_first` of columns as bytes, see `_first_readings`."""
    return _first(np.frombuffer(t), np.frombuffer(values), sigma, np.frombuffer(command))


def _first(
    t: np.ndarray, values: np.ndarray, sigma: float, command: np.ndarray
) -> tuple[float, float, float, float, float]:
    """Value, rate and its rate at time 0, and deviations of the first two, from a parabola.

    The parabola is the longest one whose residual is noise. What it misses shows first in the cubic
    coefficient, whose standard deviation from noise is sqrt(7 / n) of that of the noise. A command
    that steps changes the motion before it shows in a coarse encoder, so the command must fit a
    parabola over this length as well.

    The deviations include the noise of a cubic over the same length, as the parabola may be off by
    as much, and the change of the rate within one sample, since the internal state of the drive is
    unknown.
    """
    for side in reversed((*HALVES, *LONGER)):
        n = min(2 * side + 1, len(t))
        _, curved = _fitted(t[:n], command[:n], 2)
        estimate, left = _fitted(t[:n], values[:n], 3)
        fits = abs(estimate.coef[3]) <= CHANCE * sigma * np.sqrt(7.0 / n)
        if left <= sigma and fits and curved <= max(sigma, CURVED * np.ptp(command[:n])):
            break
    else:  # at most up to the sample that the largest step of the command affects
        n = min(n, max(3, 2 + int(np.argmax(np.abs(np.diff(command[:n]))))))
    parabola, _ = _fitted(t[:n], values[:n], 2)
    powers = t[:n, None] ** np.arange(min(4, n))
    std = sigma * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    bend = parabola.deriv(2)(0.0)
    change = bend * (t[1] - t[0]) / np.sqrt(12.0)
    estimate = parabola(0.0), parabola.deriv()(0.0), bend, std[0], np.hypot(std[1], change)
    return tuple(float(x) for x in estimate)


def _fitted(t: np.ndarray, values: np.ndarray, degree: int) -> tuple[np.polynomial.Legendre, float]:
    """Polynomial fit of values, and the rms of its residual."""
    polynomial = np.polynomial.Legendre.fit(t, values, degree)
    return polynomial, float(np.sqrt(np.mean((polynomial(t) - values) ** 2)))


def base_states(record: Record) -> list[Base | None]:
    """State of the base at each sample, relative to the first; None where it was not measured."""
    position, orientations = (record.signals.get(k) for k in ("base_position", "base_orientation"))
    if position is None or orientations is None:
        return [None] * len(record.t)
    place = at_home(position, record)
    half_angle = -0.5 * heading(orientations)
    home = (0.0, 0.0, float(np.sin(half_angle)), float(np.cos(half_angle)))
    turn = np.array([multiply(home, row) for row in orientations.tolist()])
    flips = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
    turn[1:] *= np.cumprod(np.where(flips == 0.0, 1.0, np.where(flips < 0.0, -1.0, 1.0)))[:, None]
    x, v = _smoothed_columns(place, record.dt)
    r, w = _smoothed_columns(turn, record.dt)
    r /= np.linalg.norm(r, axis=1, keepdims=True)
    states: list[Base | None] = []
    for row in range(len(record.t)):
        back = (-r[row, 0], -r[row, 1], -r[row, 2], r[row, 3])
        spin = tuple(2.0 * s for s in multiply(w[row].tolist(), back)[:3])  # 2 dr/dt r^-1
        state = Base(tuple(x[row].tolist()), tuple(r[row].tolist()), tuple(v[row].tolist()), spin)
        states.append(state if np.all(np.isfinite(np.concatenate(state))) else None)
    return states


class Smooth(NamedTuple):
    """Smoothed samples of a signal.

    Attributes:
        level: Values, (T,); NaN where nothing was measured.
        rate: Time derivative of the values [1/s], (T,).
        level_noise: Standard deviation of the error of the values, (T,); larger at the ends.
        rate_noise: Standard deviation of the error of the rate [1/s], (T,).
    """

    level: np.ndarray
    rate: np.ndarray
    level_noise: np.ndarray
    rate_noise: np.ndarray


def smoothed(values: np.ndarray, dt: float, step: float = 0.0) -> Smooth:
    """Smoothed values and rates from local cubics.

    At each sample the cubic is as long as possible while its value, or slope, agrees with those of
    all shorter ones: short where the motion is curved, long where it is smooth (intersection of
    confidence intervals: Goldenshluger and Nemirovski 1997, Katkovnik 1999). The width counts
    samples of the sensor, which may be slower than the time axis.

    Args:
        values: Samples, (T,); single gaps are interpolated.
        dt: Time between samples [s].
        step: Quantisation step of the values.
    """
    valid = np.isfinite(values)
    if valid.sum() < 2 * HALVES[0] + 1:
        return Smooth(*np.full((2, len(values)), np.nan), *np.full((2, len(values)), np.inf))
    sensor_rows, filled = _of_sensor(values)
    delta, rows = (sensor_rows[1] - sensor_rows[0]) * dt, np.arange(len(values))
    off_by = max(noise_of(filled, step), step / np.sqrt(12.0))
    estimates, deviations = [], []
    for order in (0, 1):
        best, best_std = np.zeros(len(filled)), np.full(len(filled), np.inf)
        low, high = np.full((2, len(filled)), -np.inf) * [[1.0], [-1.0]]
        for side in HALVES:
            if 2 * side + 1 > len(filled):
                break
            shape = {"window_length": 2 * side + 1, "polyorder": 3, "deriv": order}
            filtered = signal.savgol_filter(filled, **shape, delta=delta, mode="interp")
            std = off_by / delta**order * _noise_gain(side, order, len(filled))
            low = np.maximum(low, filtered - AGREES * std)
            high = np.minimum(high, filtered + AGREES * std)
            longer = (low <= high) & (std < best_std)
            best[longer], best_std[longer] = filtered[longer], std[longer]
        estimates.append(np.where(valid, np.interp(rows, sensor_rows, best), np.nan))
        deviations.append(np.hypot(1.0, AGREES) * np.interp(rows, sensor_rows, best_std))
    return Smooth(*estimates, *deviations)


def _noise_gain(side: int, order: int, count: int) -> np.ndarray:
    """Noise gain of a cubic fit over 2 half + 1 of `count` samples, at each of them, (count,)."""
    place, last = np.arange(count), count - 1
    place = np.minimum(place, side) + np.maximum(place - (last - side), 0)  # centre, except at ends
    return _shares(side, order)[place]


@lru_cache
def _shares(side: int, order: int) -> np.ndarray:
    """Noise gain of a cubic fit at each position in its window, (2 half + 1,)."""
    width = 2 * side + 1
    rows = [signal.savgol_coeffs(width, 3, deriv=order, pos=p) for p in range(width)]
    return np.linalg.norm(rows, axis=1)


def _smoothed_columns(values: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed columns and their rates, (T, k) each."""
    columns = [smoothed(column, dt) for column in values.T]
    return tuple(np.stack([c[i] for c in columns], axis=1) for i in (0, 1))


def _of_sensor(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Evenly spaced rows from the first to the last reading, at the typical sensor period.

    The last row is that of the last reading, however unevenly the sensor was read.

    Returns:
        Rows and interpolated values, (S,) each.
    """
    rows = np.flatnonzero(np.isfinite(values))
    gaps = np.diff(rows)
    stride = float(np.mean(gaps[gaps <= 1.5 * np.median(gaps)]))
    sensor_rows = np.linspace(rows[0], rows[-1], 1 + round((rows[-1] - rows[0]) / stride))
    return sensor_rows, np.interp(sensor_rows, rows, values[rows])


def noise_of(values: np.ndarray, step: float = 0.0) -> float:
    """Standard deviation of white noise on a smooth signal, from its third differences.

    Args:
        values: Evenly spaced samples, (S,).
        step: Quantisation step of the readings; quantisation counts as noise.
    """
    return noise.white([values], step, orders=(3,), fewest=1)
