# SPDX-License-Identifier: Apache-2.0
"""Reflex network with accessible hidden activity and a correction of its joint positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..reflex.network import ReflexNetwork


class GuidedNetwork(ReflexNetwork):
    """`ReflexNetwork` with trained weights, for an agent.

    Attributes:
        correction: Added to the positions of the readout [rad], (k,).
        line: Delay line of the scaled sensors at the last sensed tick, newest first, (M, size).
        activity: Hidden activity u at the last sensed tick, (N,), overwritten at the next one.
    """

    correction: np.ndarray
    line: np.ndarray
    activity: np.ndarray

    def __init__(self, *arguments: Any):
        super().__init__(*arguments)
        self._clear()

    def reset(self) -> None:
        """Reset the state and the correction."""
        super().reset()
        self._clear()

    def _clear(self) -> None:
        self.correction, self._sensed = np.zeros(len(self.outputs)), False

    def sense(self, felt: np.ndarray | None) -> np.ndarray:
        """Hidden activity (N,) in a state; the next step uses it instead of sensing again."""
        self.line = self.delay_line.step(self.senses.sample(felt, False))
        self.activity = self.hidden.step(self.senses.hidden(self.line, False))
        self._sensed = True
        return self.activity

    def _predict(self, felt: np.ndarray | None, target: Any, learning: bool) -> np.ndarray:
        if not self._sensed:
            self.sense(felt)
        self._sensed = False
        output = self.senses.output(self.readout.predict(self.activity))
        output[: len(self.correction)] += self.correction
        return output
