# SPDX-License-Identifier: Apache-2.0
"""Whether a robot is in the safe state, judged by its joints and not by its word.

The safe state holds each joint where it was at the beginning of the tick and wants no velocity.
Whatever the gains and the load, the torque of a joint is then against its velocity: drives take
energy out of the motion and put none in. Ticks in which a joint turned round are left out, as its
torque is a mean over a tick. A driven robot does the opposite, since a drive has to drive to move
anything: it puts in about as much as it takes out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

# Energy that damping drives may put in, over what they take out. Measured in 33 time-outs of a
# robot that was hit while it trotted: damped at most 5e-5.
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
        """Whether the drives only braked in the states of the ticks from `first` to `last`.

        False, too, if a state is missing, and if there was no motion that could have been braked.
        """
        rows = self._rows(first, last)
        whole = rows.stop - rows.start == last - first + 1 > 0
        return bool(whole and self._in[rows].sum() < PUT_IN * self._out[rows].sum())

    def is_driven(self, first: int, last: int) -> bool:
        """Whether the drives put energy in during the ticks from `first` to `last`."""
        rows = self._rows(first, last)
        return bool(self._in[rows].sum() > PUT_IN * self._out[rows].sum())

    def power(self, first: int, last: int) -> float:
        """Mean power that drives put in during the ticks from `first` to `last` [W]; 0 for none."""
        rows = self._rows(first, last)
        return float(self._in[rows].sum() / max(1, rows.stop - rows.start))

    def _rows(self, first: int, last: int) -> slice:
        return slice(*np.searchsorted(self._ticks, [first, last + 1]).tolist())
