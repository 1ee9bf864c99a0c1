# SPDX-License-Identifier: Apache-2.0
"""Detection of nodes that make no progress during start-up, independent of machine speed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from loco_control.exceptions import ParameterError

from .process_info import processor_time, waiting_time

MIN_SHARE = 0.05  # smallest share of the time in which a process does not wait for a processor


@dataclass(frozen=True)
class StartLimits:
    """Limits on the start-up time of the nodes of a run.

    Attributes:
        timeout: Time without progress after which a start has failed, more than 0 [s]. Taste: a
            person waits about a minute before looking for a fault.
        busy: Share of one core that all processes together use while they import or compile, of
            the time in which they do not wait for a processor, so that a busy machine does not
            matter. Measured on two cores beside a running test suite: five processes of which four
            wait for the fifth use 0.04 to 0.06, while they import 0.35 to 1.3.
        longest: Total time after which a start has failed even if processes are busy, in
            multiples of `timeout`. Taste: it ends nodes that compute forever.
        window: Time over which the CPU usage is measured, at most a quarter of
            `timeout` [s]. Taste.
    """

    timeout: float = 60.0
    busy: float = 0.15
    longest: float = 10.0
    window: float = 2.0

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout < math.inf:
            raise ParameterError(
                f"start timeout must be a finite number of seconds above 0, got {self.timeout:g}"
            )


@dataclass
class StartMonitor:
    """Monitor of the progress of nodes during start-up.

    Progress is an event of a node, a change of the nodes that a node waits for, or CPU time
    spent on imports and compilation.

    Args:
        limits: Limits on the time without progress.
        pids: Function that returns the ids of all processes.
        clock: Function that returns the time [s].
        used: Function that returns the CPU time of a process so far [s].
        waited: Function that returns how long a process waited for a processor so far [s].
    """

    limits: StartLimits
    pids: Callable[[], Iterable[int]]
    clock: Callable[[], float] = time.monotonic
    used: Callable[[int], float] = processor_time
    waited: Callable[[int], float] = waiting_time

    def __post_init__(self) -> None:
        self._begin = self._progress = self._sampled = self.clock()
        self._times = self._read()

    def advance(self) -> None:
        """Register progress of a node."""
        self._progress = self.clock()

    def failure(self) -> str:
        """Reason why the start has failed; empty while it may still succeed."""
        time_now = self.clock()
        if time_now - self._sampled >= min(self.limits.window, self.limits.timeout / 4.0):
            if self._share(time_now - self._sampled) > self.limits.busy:
                self._progress = time_now
            self._sampled = time_now
        if time_now - self._progress > self.limits.timeout:
            return f"not ready: no progress for {self.limits.timeout:g} s"
        if time_now - self._begin > self.limits.longest * self.limits.timeout:
            return f"not ready after {time_now - self._begin:.0f} s, though its processes are busy"
        return ""

    def _share(self, passed: float) -> float:
        """Sum of the shares of a core that the processes used since the last call."""
        before, self._times = self._times, self._read()
        share = 0.0
        for pid, (used, waited) in self._times.items():
            used_before, waited_before = before.get(pid, (0.0, 0.0))
            had = max(passed - (waited - waited_before), MIN_SHARE * passed)
            share += (used - used_before) / had
        return share

    def _read(self) -> dict[int, tuple[float, float]]:
        return {pid: (self.used(pid), self.waited(pid)) for pid in self.pids()}
