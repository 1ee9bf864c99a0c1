# SPDX-License-Identifier: Apache-2.0
"""Rows that the laws of the effects in the joints run over, and the number of each law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Numbers of the laws in `laws.torques`; a law of friction has none.
GAIN, DELAY, LAG, LIMIT, SPEED_LINE, SAG, BACKLASH, SERIES = range(8)
SPRING, SATURATION, RESCALED, SHIFTED, END_STOP, HYSTERESIS, MAXWELL, LEARNED = range(8, 16)
WAVE, COUPLED = range(16, 18)
OF_DRIVES = 8  # laws below are about the torque of drives, the others about that on the joint
FEATURES = 18  # of `learned_kernels.learned_torque`
CONSTANTS, MEMORY = 7 + FEATURES, 5  # per row
ON_MOTOR = 2  # among the constants of a drive's law: 1 where it is about the motor behind a gear
NEVER = np.iinfo(np.int64).max


class Laws(NamedTuple):
    """Arrays that the kernels in `laws` run over: r rows of m laws."""

    plan: np.ndarray  # law, first row, row after the last, first step, step after the last, (m, 5)
    joint: np.ndarray  # of each row, (r,)
    const: np.ndarray  # (r, CONSTANTS)
    memory: np.ndarray  # (r, MEMORY)
    line: np.ndarray  # delay lines of all rows


NO_LAWS = Laws(
    np.zeros((0, 5), dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, CONSTANTS)),
    np.zeros((0, MEMORY)),
    np.zeros(0),
)
