# SPDX-License-Identifier: Apache-2.0
"""Correction of a gap that no effect explains: a ridge regression of the residual.

It reproduces the residual in the measured states. It names no cause and does not extrapolate;
the text `KIND` accompanies it in every output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..prediction.phases import STRIDE_PHASES, phases, position, speed
from ..recordings.record import Record
from .localise import JOINT_SIGNALS

KIND = "correction: not an explanation"
PENALTIES = 10.0 ** np.arange(-4.0, 3.0)  # times the number of samples
FOLDS = 5
SMOOTH_SPEED = 0.1  # [rad/s, m/s] speed below which the sign of the velocity is smoothed
LEAST_EXPLAINED = 0.05  # smallest cross-validated share of a channel's residual for a correction


@dataclass(frozen=True)
class Channel:
    """Correction of one channel.

    Attributes:
        signal: Name of the signal.
        name: Joint, foot or axis.
        unit: Unit of the correction.
        explained: Cross-validated share of the residual's energy.
        weights: Weight of each feature; the correction is the sum of weight times feature.
    """

    signal: str
    name: str
    unit: str
    explained: float
    weights: dict[str, float]


@dataclass(frozen=True)
class Correction:
    """Corrections of all channels whose residual can be predicted.

    Attributes:
        kind: `KIND`.
        explained: Share of the whole whitened residual's energy, cross-validated.
        channels: Correction of each channel.
    """

    kind: str
    explained: float
    channels: tuple[Channel, ...]

    def predict(self, record: Record, signal: str, name: str) -> np.ndarray:
        """Correction to add to the model's prediction of a channel, (T,); 0 if there is none."""
        for channel in self.channels:
            if (channel.signal, channel.name) == (signal, name):
                names, x = features(record, _joints([record], signal, name))
                return x @ np.array([channel.weights.get(n, 0.0) for n in names])
        return np.zeros(len(record.t))


def fit(
    records: Sequence[Record],
    channels: Sequence,
    residuals: Sequence[np.ndarray],
    floor: np.ndarray,
) -> Correction | None:
    """Fit the residual channel by channel; None if no channel can be predicted.

    Args:
        records: Measured records.
        channels: Columns of the residuals, with `signal`, `name` and `unit`.
        residuals: Measured minus predicted in the channels' units, (T, C) per record.
        floor: Noise floor of each channel, for weighting, (C,).
    """
    corrections, closed, total = [], 0.0, 0.0
    for column, channel in enumerate(channels):
        joints = _joints(records, channel.signal, channel.name)
        parts = [features(r, joints) for r in records]
        x = np.concatenate([values for _, values in parts])
        y = np.concatenate([r[:, column] for r in residuals])
        valid = np.isfinite(y)
        energy = float(np.square(y[valid]).sum()) / floor[column] ** 2
        total += energy
        if valid.sum() < 20 * FOLDS:
            continue
        explained, weights = ridge(x[valid], y[valid])
        if explained >= LEAST_EXPLAINED:
            closed += explained * energy
            coefficients = dict(zip(parts[0][0], weights.tolist(), strict=True))
            entry = Channel(channel.signal, channel.name, channel.unit, explained, coefficients)
            corrections.append(entry)
    return Correction(KIND, closed / total, tuple(corrections)) if corrections else None


def features(record: Record, joints: Sequence[str]) -> tuple[list[str], np.ndarray]:
    """Functions of the measured state: names, and values (T, F).

    Of each joint: position, velocity, their squares and product, cube of the position, smoothed
    sign of the velocity, command and its difference to the position; contact phases if feet are
    measured.
    """
    named: dict[str, np.ndarray] = {"1": np.ones(len(record.t))}
    for joint in joints:
        q, dq = position(record, joint), speed(record, joint)
        laws = {"q": q, "dq": dq, "q^2": q**2, "q^3": q**3, "q dq": q * dq, "dq|dq|": dq * abs(dq)}
        laws["side of dq"] = np.tanh(dq / SMOOTH_SPEED)
        for kind, values in record.command.items():
            if joint in record.driven:
                command = values[:, record.driven.index(joint)]
                laws[f"{kind} command"] = command
        named |= {f"{joint} {law}": values for law, values in laws.items()}
        names, phase = phases(record, joint)
        if names == STRIDE_PHASES:
            named |= {
                f"{joint} {p}": (phase == i) * 1.0 for i, p in enumerate(STRIDE_PHASES[1:], 1)
            }
    return list(named), np.nan_to_num(np.stack(list(named.values()), axis=1))


def ridge(x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray]:
    """Ridge regression with a penalty from cross-validation over contiguous blocks.

    Args:
        x: Features, (N, F).
        y: Values to explain, (N,).

    Returns:
        Cross-validated share of y's energy, and weights (F,).
    """
    size = np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12)
    z = x / size
    folds = np.arange(len(y)) * FOLDS // len(y)
    grams = [z[folds == f].T @ z[folds == f] for f in range(FOLDS)]
    moments = [z[folds == f].T @ y[folds == f] for f in range(FOLDS)]
    gram, moment = sum(grams), sum(moments)
    lost = []
    for penalty in PENALTIES:
        load = penalty * len(y) * np.eye(z.shape[1])
        error = 0.0
        for f in range(FOLDS):
            w = np.linalg.solve(gram - grams[f] + load, moment - moments[f])
            error += float(np.square(y[folds == f] - z[folds == f] @ w).sum())
        lost.append(error)
    best = int(np.argmin(lost))
    load = PENALTIES[best] * len(y) * np.eye(z.shape[1])
    energy = max(float(y @ y), 1e-300)
    return 1.0 - lost[best] / energy, np.linalg.solve(gram + load, moment) / size


def _joints(records: Sequence[Record], signal: str, name: str) -> tuple[str, ...]:
    """Joints whose states may correct a channel: its own joint, or all for a signal of the body."""
    if signal in JOINT_SIGNALS and all(name in r.joints for r in records):
        return (name,)
    return tuple(j for j in records[0].joints if all(j in r.joints for r in records))
