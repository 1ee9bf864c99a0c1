# SPDX-License-Identifier: Apache-2.0
"""Training schedule: the phases, and the ticks at which the readout learns."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from ..params import PHASES, PhasedParams

STAND, TRAIN, CLOSING, TEST = range(len(PHASES))


class Schedule:
    """Phases of a training by tick, and at which ticks the readout learns.

    In closing, the last share rho of the ticks of each block only predicts, where
    rho grows from 0 to 1; the rate of learning is ramped, signals are never mixed.
    Source: thesis section 7.2.3; the block from the author's code.

    Args:
        params: Length of the phases and of a block.
        dt: Control period [s].
    """

    def __init__(self, params: PhasedParams, dt: float):
        self.params, self.dt = params, dt
        phase_ends = np.cumsum(list(params.durations.values())).tolist()
        self._phase_ends = [round(end / dt) for end in phase_ends]  # first tick after each phase

    def phase_of(self, tick: int) -> int:
        """Index in `PHASES`; test continues after its end."""
        return min(bisect_right(self._phase_ends, tick), TEST)

    def phase_at(self, t: float) -> int:
        """Index in `PHASES` at simulated time t [s]."""
        return self.phase_of(round(t / self.dt))

    def learns(self, tick: int, phase: int) -> bool:
        """True if the readout is updated at this tick; False if its weights are from a file."""
        if not self.params.enabled or self.params.weights or phase not in (TRAIN, CLOSING):
            return False
        if phase == TRAIN:
            return True
        start, stop = self._phase_ends[TRAIN], self._phase_ends[CLOSING]
        rho = (tick - start) / (stop - start)
        block = self.params.closing_block
        return tick % block < block * (1.0 - rho)
