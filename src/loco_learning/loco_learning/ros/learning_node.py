# SPDX-License-Identifier: Apache-2.0
"""Base of all reflex nodes: phase events, saving of weights and diagnostics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from loco_control.ros.node import LocoNode


class LearningNode(LocoNode):
    """Node of a network that learns in phases."""

    ERROR = "error_rad"  # name of the error in diagnostics
    _phase_now, _error, _save_to = "", 0.0, ""

    def follow(self, phase: str, error: float, tick: int, t: float, network: Any = None) -> None:
        """Publish an event when a phase begins, and save the network when the test begins.

        Args:
            phase: Name of the phase of this tick.
            error: Error of the prediction, for diagnostics.
            tick: Control periods since reset.
            t: Simulated time [s].
            network: Object with a method `save`; None saves nothing.
        """
        self._error = error
        if phase == self._phase_now:
            return
        self._phase_now = phase
        self.event("phase", phase, tick, t)
        # Weights are final when the test phase begins.
        if phase == "test" and self._save_to and network:
            self._save(network, tick, t)

    def _save(self, network: Any, tick: int, t: float) -> None:
        """Save; a full disk causes an event, ``weights not saved``, but does not stop the robot."""
        try:
            network.save(Path(self._save_to))
        except OSError as error:
            text = f"{self._save_to}: {error.strerror or error}"
            self.event("weights not saved", text, tick, t)

    def diagnose(self) -> dict[str, Any]:
        """Phase and prediction error."""
        return {"phase": self._phase_now or "waiting", self.ERROR: self._error}
