# SPDX-License-Identifier: Apache-2.0
"""Pure delays: of the motion command on its way to the drives, and of the torque."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from .base import Effect


def delayed(pending: deque, value: Any, steps: int) -> Any:
    """The value of `steps` calls ago; the first value while there was none.

    Args:
        pending: Values under way, oldest first; changed in place.
        value: The newest.
        steps: Delay in calls, >= 0.
    """
    pending.append(value)
    return pending.popleft() if len(pending) > steps else pending[0]


@dataclass
class CommandDelay(Effect, name="command_delay"):
    """Motion commands reach the drives late, by a whole number of physics steps.

    When it begins, the command of that moment is held until the late ones arrive.
    Source: thesis chapter 8, a delay between network and motors of unpublished size.
    """

    delay: float = parameter(0.0, "delay, rounded to physics steps", "s", low=0.0, high=1.0)

    def configure(self, world: Any) -> None:
        self._steps = round(self.delay / world.dt)

    def reset(self, rng: np.random.Generator) -> None:
        self._pending: deque = deque()

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        return delayed(self._pending, (q, dq), self._steps)


@dataclass
class ActuationDelay(Effect, name="actuation_delay"):
    """Joint torques act late, by a whole number of physics steps.

    When it begins, the torque of that moment is held until the late ones arrive.
    The delay is inside the impedance loop, so it takes damping away.
    """

    delay: float = parameter(0.0, "delay, rounded to physics steps", "s", low=0.0, high=1.0)

    def reset(self, rng: np.random.Generator) -> None:
        self._pending: deque = deque()

    def on_torque(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        return delayed(self._pending, tau, round(self.delay / dt))
