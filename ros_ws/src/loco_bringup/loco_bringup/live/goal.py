# SPDX-License-Identifier: Apache-2.0
"""Execution of a goal of the calibrator: connect, listen or read, compute, send the model."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .calibrator import CalibratorNode


class Goal:
    """One goal of an action; computation is in a worker process.

    A subclass has `run`, which executes the goal and returns the result of the action, and
    `publish`, which publishes the state of the action.

    Args:
        node: Node that has accepted the goal.
        handle: Handle of the goal.
    """

    ACTION: Any  # type of the action
    NAME = ""  # name of the action
    WHAT = ""  # the action in error messages

    def __init__(self, node: CalibratorNode, handle: Any):
        self._node, self._handle, self._goal = node, handle, handle.request
        self.duration = node.listen.duration
        self._worker: Any = None

    async def _listen(self, on_share: Callable[[float], None] = lambda share: None) -> Any:
        """Signals of the measured robot over the duration of the goal; None if it is cancelled.

        Args:
            on_share: Called with the share of the duration that was recorded.
        """
        robot, timeout = self._node.measured, self._node.listen.patience
        while robot.signals.length < self.duration and not self._cancelled():
            await self._node.until(lambda: True)
            robot.check(timeout)
            on_share(min(1.0, robot.signals.length / self.duration))
        return None if self._cancelled() else robot.signals

    def _cancelled(self) -> bool:
        return self._handle.is_cancel_requested

    def close(self) -> None:
        """Stop the worker process."""
        if self._worker:
            self._worker.close()
