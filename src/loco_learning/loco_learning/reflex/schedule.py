# SPDX-License-Identifier: Apache-2.0
"""When a network watches, learns, learns ever more rarely, and rests."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from ..params import PHASES, PhasedParams

STAND, TRAIN, CLOSING, TEST = range(len(PHASES))


class Schedule:
    """Phases of a training by tick, and at which ticks the readout learns.

    In closing, of each block of ticks the last share rho only predicts, where
    rho grows from 0 to 1; what ramps is the learning, never a mix of signals.
    Source: thesis section 7.2.3; the block from the author's code.

    Args:
        params: Length of the phases and of a block.
        dt: Control period [s].
    """

    def __init__(self, params: PhasedParams, dt: float):
        self.params, self.dt = params, dt
        phase_ends = np.cumsum(list(params.durations.values()))
        self._phase_ends = [
            round(end / dt) for end in phase_ends.tolist()
        ]  # first tick after each phase

    def phase_of(self, tick: int) -> int:
        """Index in `PHASES`; test goes on after its end."""
        return min(bisect_right(self._phase_ends, tick), TEST)

    def phase_at(self, t: float) -> int:
        """Index in `PHASES` at simulated time t [s]."""
        return self.phase_of(round(t / self.dt))

    def learns(self, tick: int, phase: int) -> bool:
        """The readout is updated at this tick; never if its weights came from a file."""
        if not self.params.enabled or self.params.weights or phase not in (TRAIN, CLOSING):
            return False
        if phase == TRAIN:
            return True
        start, stop = self._phase_ends[TRAIN], self._phase_ends[CLOSING]
        rho = (tick - start) / (stop - start)
        block = self.params.closing_block
        return tick % block < block * (1.0 - rho)
