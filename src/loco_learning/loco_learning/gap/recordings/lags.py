# SPDX-License-Identifier: Apache-2.0
"""Delays between signals: reported, never removed.

A delay between command and motion has three causes that cannot be separated here: the clock, the
drive and the body. A delay common to all joints may be that of the clock.
"""

from __future__ import annotations

from math import comb

import numpy as np

from .record import Record, bridged

LONGEST_LAG = 0.3  # [s]
FOLLOWS = 0.3  # correlation of a motion with its command below which it does not follow
LAG_IS_TOLD = 0.9  # correlation below which no delay is reported
SHARP = 0.98  # ratio of the correlation at zero shift to the best, above which none is reported
SHARPER = 0.9999  # the same ratio for two measurements of one motion
HELD = 5.0  # deviation over noise below which a motion tells nothing (taste)
WHOLE = 0.5  # share of both motions that the overlap of a shift must hold to tell anything (taste)
ORDER = 8  # of the differences that tell noise from a motion sampled ten times a period
NORMAL = 0.6745  # median of the absolute value of a standard normal variable
RATE_TIME = 0.01  # width of the difference quotient of a derivative [s]


def notes(record: Record) -> list[str]:
    """Delay of motion after command, and of velocities after angles, a sentence each."""
    messages = []
    command = record.command.get("position")
    if command is not None and "q" in record.signals:
        pairs = [
            (rates(command[:, i], record.dt), rates(_of(record, "q", joint), record.dt))
            for i, joint in enumerate(record.driven)
            if joint in record.joints
        ]
        messages += _messages("motion is behind the command by about", pairs, record.dt, clock=True)
    if "dq" in record.signals:
        pairs = [
            (rates(record.signals["q"][:, i], record.dt), record.signals["dq"][:, i])
            for i in range(len(record.joints))
        ]
        messages += _messages("measured velocity is behind that of the angle by", pairs, record.dt)
    torque = record.command.get("torque")
    if torque is not None and "tau" in record.signals:
        pairs = [
            (torque[:, i], _of(record, "tau", joint))
            for i, joint in enumerate(record.driven)
            if joint in record.joints
        ]
        messages += _messages("measured torque is behind its command by", pairs, record.dt)
    return messages


def warnings(record: Record) -> list[str]:
    """Joints whose motion is not correlated with their commanded position, a sentence each."""
    command, messages = record.command.get("position"), []
    for i, joint in enumerate(record.driven if command is not None else ()):
        if joint not in record.joints:
            continue
        corr = following(command[:, i], _of(record, "q", joint), record.dt)
        if corr < FOLLOWS:
            messages.append(
                f"{joint} does not follow its commanded position (correlation {corr:.2f} at the "
                "best lag): a wrong column, a drive that is off, or a joint that is held"
            )
    return messages


def following(command: np.ndarray, q: np.ndarray, dt: float) -> float:
    """Largest correlation of a motion with its command, for delays up to `LONGEST_LAG`.

    Args:
        command: Commanded position, (T,).
        q: Measured position, (T,); NaN where it was not measured.
        dt: Time between samples [s].

    Returns:
        Correlation in [-1, 1]; 1 if one of the two hardly moves, so that nothing can be said.
    """
    valid = np.isfinite(q) & np.isfinite(command)
    if valid.sum() < 20 or is_constant(command[valid]):
        return 1.0
    a = command - np.mean(command[valid])
    b = bridged(np.where(valid, q, np.nan)) - np.mean(q[valid])
    return float(np.max(_correlation(a, b, max(1, min(int(LONGEST_LAG / dt), len(a) // 3)))))


def _of(record: Record, signal: str, joint: str) -> np.ndarray:
    return record.signals[signal][:, record.joints.index(joint)]


def rates(x: np.ndarray, dt: float) -> np.ndarray:
    """Central difference quotient over about `RATE_TIME`, without delay, (T,)."""
    offset = max(1, min(round(0.5 * RATE_TIME / dt), (len(x) - 1) // 2))
    slope = np.full(len(x), np.nan)
    slope[offset:-offset] = (x[2 * offset :] - x[: -2 * offset]) / (2.0 * offset * dt)
    return slope


def is_held(x: np.ndarray) -> bool:
    """Whether values change by no more than `HELD` times their noise or half quantisation step.

    The noise is that of differences of high order, which the motion hardly changes.
    """
    x = x[np.isfinite(x)]
    if len(x) < 2 * ORDER or is_constant(x):
        return True
    steps = np.abs(np.diff(x))
    size = float(np.median(np.abs(np.diff(x, ORDER)))) / (NORMAL * np.sqrt(comb(2 * ORDER, ORDER)))
    noise = max(size, 0.5 * float(np.min(steps[steps > 0.0])))
    return bool(np.std(x) < HELD * noise)


def is_constant(x: np.ndarray) -> bool:
    """Whether values differ by no more than the rounding of their mean."""
    return bool(np.ptp(x) <= 1e-9 * np.max(np.abs(x)))


def lag(
    first: np.ndarray, second: np.ndarray, dt: float, sharp: float = SHARP
) -> tuple[float, float]:
    """Delay of `second` after `first` [s], and their correlation at this delay.

    The maximum of the cross-correlation, refined by a parabola through its neighbours. The
    correlation is 0 if it is nearly as high without a delay.
    """
    valid = np.isfinite(first) & np.isfinite(second)
    if valid.sum() < 20:
        return 0.0, 0.0
    inner = slice(int(np.argmax(valid)), len(valid) - int(np.argmax(valid[::-1])))
    if is_constant(first[valid]) or is_constant(second[valid]):
        return 0.0, 0.0
    a, b = (np.where(valid, x - np.mean(x[valid]), 0.0)[inner] for x in (first, second))
    reach = min(int(LONGEST_LAG / dt), len(a) // 3)
    score = _correlation(a, b, reach)
    best = int(np.argmax(score))
    if not 0 < best < len(score) - 1 or score[reach] > sharp * score[best]:
        return 0.0, 0.0
    left, peak, right = score[best - 1 : best + 2]
    if not np.isfinite(left + right):
        return 0.0, 0.0
    bend = left - 2.0 * peak + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return (best - reach + shift) * dt, float(peak)


def _correlation(a: np.ndarray, b: np.ndarray, reach: int) -> np.ndarray:
    """Correlation of a with b shifted by -reach to reach samples, over their overlap.

    It is -inf where the overlap lacks most of a motion: a step soon after the begin, for example.
    """
    width = 1 << (2 * len(a) - 1).bit_length()
    product = np.fft.irfft(np.fft.rfft(b, width) * np.conj(np.fft.rfft(a, width)), width)
    product = np.concatenate([product[-reach:], product[: reach + 1]])
    shift = np.arange(-reach, reach + 1)
    first, stop = np.maximum(-shift, 0), len(a) - np.maximum(shift, 0)
    count = stop - first

    def sums(x: np.ndarray, by: np.ndarray | int) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(x)])
        return total[stop + by] - total[first + by]

    mean_a, mean_b = sums(a, 0) / count, sums(b, shift) / count
    spread_a = sums(a * a, 0) / count - mean_a**2
    spread_b = sums(b * b, shift) / count - mean_b**2
    score = (product / count - mean_a * mean_b) / np.sqrt(np.maximum(spread_a * spread_b, 1e-300))
    complete = (variation * count >= WHOLE * len(a) * np.var(x)
                for variation, x in ((spread_a, a), (spread_b, b)))  # fmt: skip
    return np.where(np.logical_and(*complete), score, -np.inf)


def _messages(what: str, pairs: list, dt: float, clock: bool = False) -> list[str]:
    sharp = SHARP if clock else SHARPER
    estimates = [lag(first, second, dt, sharp) for first, second in pairs]
    reliable = 1e3 * np.array([time for time, corr in estimates if corr > LAG_IS_TOLD])
    if not len(reliable) or np.max(np.abs(reliable)) < 0.25e3 * dt:
        return []
    text = f"{what} {np.median(reliable):.1f} ms"
    if len(reliable) > 1:
        text += f" (joints {np.min(reliable):.1f} to {np.max(reliable):.1f} ms)"
    if clock:
        text += "; clock, drive and body are not told apart here and nothing was shifted"
    return [text]
