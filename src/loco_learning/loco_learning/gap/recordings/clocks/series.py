# SPDX-License-Identifier: Apache-2.0
"""Detection of two motions in one signal: a second publisher on its topic, or failed readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from loco_control.exceptions import ParameterError

from ..tracks import Track
from .params import SERIES


def single(name: str, tracks: Sequence[Track]) -> None:
    """Check that each measured position is one motion.

    Args:
        name: Name of the record, for messages.
        tracks: Signals of the robot.

    Raises:
        ParameterError: Readings of a position alternate between two motions. The user has to say
            which of them is the joint's.
    """
    for track in tracks:
        if track.role != "q" or not np.all(np.isfinite(track.x)):
            continue
        order = np.argsort(track.t, kind="stable")
        second = other_motion(track.x[order])
        if second is not None and not _as_fast(track, order, second, tracks):
            raise ParameterError(f"{name}: {track.label}: {_message(track, order, second)}")


def _as_fast(
    track: Track, order: np.ndarray, second: np.ndarray, tracks: Sequence[Track]
) -> bool:
    """True if the measured velocity is that of the jumps, so that the joint itself alternates."""
    speeds = [s for s in tracks if s.role == "dq" and s.place == track.place and len(s.t) > 1]
    if not speeds:
        return False
    x, t = track.x[order], track.t[order]
    rows = np.flatnonzero(second[1:] != second[:-1])
    needed = np.abs(x[rows + 1] - x[rows]) / np.maximum(t[rows + 1] - t[rows], 1e-9)
    sorted_ = np.argsort(speeds[0].t, kind="stable")
    measured = np.abs(np.interp(t[rows], speeds[0].t[sorted_], speeds[0].x[sorted_]))
    return bool(np.nanmedian(measured) > SERIES.own * np.median(needed))


def _message(track: Track, order: np.ndarray, second: np.ndarray) -> str:
    x, t = track.x[order], track.t[order]
    rate = 1.0 / max(float(np.median(np.diff(t[second]))), 1e-9)
    constant = float(np.ptp(x[second])) == 0.0
    value = f"{x[second][0]:.6g}"
    text = f"{int(second.sum()):,} of {len(x):,} readings are "
    text += f"{value if constant else 'of a second motion'}, at {rate:.3g} Hz, "
    if constant:
        return text + (
            "between those of a motion: a second publisher, such as a joint_state_publisher, or "
            f"readings that failed? missing: {value} in the mapping leaves them out, "
            "trust_units: true keeps them"
        )
    return text + (
        "between those of another: two publishers of the same joints? Record the topic of the "
        "drives alone; trust_units: true keeps them"
    )


def other_motion(x: np.ndarray) -> np.ndarray | None:
    """Flags of the readings, (K,), of a second motion mixed into one; None if there is none.

    The second motion is constant, or the one with fewer readings of two that move.

    Args:
        x: Readings in the order of their time stamps, (K,).
    """
    span, jump = float(np.ptp(x)) if len(x) else 0.0, np.diff(x)
    large = np.abs(jump) > SERIES.apart * span
    back = np.flatnonzero((jump[:-1] * jump[1:] < 0.0) & large[:-1] & large[1:])
    if 2 * len(back) < SERIES.changes:
        return None
    finest = span * float(np.min(np.diff(np.unique(np.round(x / span, 9)))))
    threshold = max(SERIES.apart * span, SERIES.steps * finest)
    standing = _standing(x, back, threshold)
    return _moving(x, threshold) if standing is None else standing


def _standing(x: np.ndarray, back: np.ndarray, min_distance: float) -> np.ndarray | None:
    """Flags of the most frequent value at reversals; None if it is no second motion."""
    indices = np.unique(np.concatenate([back, back + 1, back + 2]))
    values, counts = np.unique(x[indices], return_counts=True)
    flags = x == values[np.argmax(counts)]
    remaining = np.flatnonzero(~flags)
    if not _mixed(flags) or len(remaining) < SERIES.changes:
        return None
    minority = flags if 2 * flags.sum() < len(x) else ~flags
    if np.mean(np.isin(np.flatnonzero(minority[1:-1]), back)) < SERIES.spikes:
        return None  # values that the motion passes through
    line = np.interp(np.flatnonzero(flags), remaining, x[remaining])
    distance = float(np.median(np.abs(x[flags] - line)))
    rest = x[remaining]
    usual = float(np.median(np.abs(rest[1:-1] - 0.5 * (rest[2:] + rest[:-2]))))
    return flags if distance > max(min_distance, SERIES.shorter * usual) else None


def _moving(x: np.ndarray, min_distance: float) -> np.ndarray | None:
    """Flags of the smaller of two smooth motions with long jumps between them; None if one.

    Readings that stand out and follow no motion of their own are the joint's, or faults.
    """
    each = np.abs(np.diff(x))
    labels, jumps = _labels(x, int(np.argmax(each)))
    changed = labels[1:] != labels[:-1]
    if not _mixed(labels) or float(np.median(jumps[1:][changed])) < min_distance:
        return None
    within = sum(float(np.sum(np.abs(np.diff(x[labels == side])))) for side in (False, True))
    across, inside = float(np.sum(each[changed])), within - float(np.sum(each[~changed]))
    second = labels == (np.mean(labels) < 0.5)
    moves = np.diff(x[second])
    is_rough = np.std(np.diff(moves)) > SERIES.rough * np.std(moves)
    return None if is_rough or across <= SERIES.shorter * inside else second


def _mixed(flags: np.ndarray) -> bool:
    """True if readings alternate often, mostly for a single reading, unlike a motion that rests."""
    changed = flags[1:] != flags[:-1]
    isolated = int(np.sum(changed[:-1] & changed[1:]))
    return bool(changed.sum() >= SERIES.changes and 4 * isolated >= changed.sum())


def _labels(x: np.ndarray, start: int) -> tuple[np.ndarray, np.ndarray]:
    """Assign readings to two motions by proximity, with the distance between the motions, (K,).

    The assignment starts at a jump between the motions and proceeds in both directions.
    """
    labels, jumps = np.zeros(len(x), dtype=bool), np.zeros(len(x))
    labels[start + 1] = True
    for rows in (range(start + 2, len(x)), range(start - 1, -1, -1)):
        last = [float(x[start]), float(x[start + 1])]
        for row in rows:
            value = float(x[row])
            side = abs(value - last[1]) < abs(value - last[0])
            labels[row], jumps[row] = side, abs(last[1] - last[0])
            last[side] = value
    return labels, jumps
