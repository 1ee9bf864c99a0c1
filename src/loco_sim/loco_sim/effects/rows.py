# SPDX-License-Identifier: Apache-2.0
"""Arrays for the laws of the effects in the joints, and the number of each law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Numbers of the laws in `laws.torques`; friction laws have none.
GAIN, DELAY, LAG, LIMIT, SPEED_LINE, SAG, BACKLASH, SERIES, HOLD = range(9)
SPRING, SATURATION, RESCALED, SHIFTED, END_STOP, HYSTERESIS, MAXWELL, LEARNED = range(9, 17)
WAVE, COUPLED, COMPENSATION = range(17, 20)
OF_DRIVES = 9  # smaller numbers are laws on the drive torque, the others on the joint torque
FEATURES = 18  # number of features of `learned_kernels.learned_torque`
CONSTANTS, MEMORY = 7 + FEATURES, 5  # numbers per row
ON_MOTOR = 2  # index among the constants of a drive law: 1 if it acts on the motor behind a gear
MAX_INT = np.iinfo(np.int64).max


class Laws(NamedTuple):
    """Arrays for the kernels in `laws`: r rows of m laws."""

    plan: np.ndarray  # law, first row, row after the last, first step, step after last, (m, 5)
    joint: np.ndarray  # joint index of each row, (r,)
    const: np.ndarray  # constants of each row, (r, CONSTANTS)
    memory: np.ndarray  # state of each row, (r, MEMORY)
    line: np.ndarray  # delay lines of all rows


NO_LAWS = Laws(
    np.zeros((0, 5), dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    np.zeros((0, CONSTANTS)),
    np.zeros((0, MEMORY)),
    np.zeros(0),
)
