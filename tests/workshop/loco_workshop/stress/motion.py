# SPDX-License-Identifier: Apache-2.0
"""Detection of the safe state from the joint motion, independent of the robot's events.

The safe state holds each joint at its position at the start of the tick, with zero target
velocity. For any gains and load the joint torque then opposes the velocity: drives remove energy
and supply none. Ticks with a reversal of a joint's velocity are ignored, since the torque is a
mean over a tick. In a driven robot the drives supply about as much energy as they remove.
"""

from __future__ import annotations

from typing import Any

import numpy as np

# Largest ratio of supplied to removed energy of damping drives. Measured in 33 time-outs of a
# trotting robot: damped at most 5e-5.
PUT_IN = 0.01


class Motion:
    """Motion of the drives of a run, by tick.

    Args:
        states: Records of `robot_state` with the fields tick, dq [rad/s] and tau [N·m].
    """

    def __init__(self, states: Any):
        _, rows = np.unique(states["tick"], return_index=True)
        self._ticks = states["tick"][rows].astype(np.int64)
        dq = states["dq"][rows].reshape(len(rows), -1)
        power = states["tau"][rows].reshape(dq.shape) * dq  # [W]
        power[1:][np.sign(dq[1:]) != np.sign(dq[:-1])] = 0.0
        self._in = np.maximum(power, 0.0).sum(axis=1)
        self._out = np.maximum(-power, 0.0).sum(axis=1)

    def is_damped(self, first: int, last: int) -> bool:
        """Whether the drives only braked in the ticks from `first` to `last`.

        Also False if a state is missing, or if there was no motion to brake.
        """
        rows = self._rows(first, last)
        complete = rows.stop - rows.start == last - first + 1 > 0
        return bool(complete and self._in[rows].sum() < PUT_IN * self._out[rows].sum())

    def is_driven(self, first: int, last: int) -> bool:
        """Whether the drives supplied energy during the ticks from `first` to `last`."""
        rows = self._rows(first, last)
        return bool(self._in[rows].sum() > PUT_IN * self._out[rows].sum())

    def power(self, first: int, last: int) -> float:
        """Mean power supplied by the drives from tick `first` to `last` [W]; 0 without ticks."""
        rows = self._rows(first, last)
        return float(self._in[rows].sum() / max(1, rows.stop - rows.start))

    def _rows(self, first: int, last: int) -> slice:
        return slice(*np.searchsorted(self._ticks, [first, last + 1]).tolist())
