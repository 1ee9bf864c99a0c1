# SPDX-License-Identifier: Apache-2.0
"""Process that outlives a killed supervisor and ends the nodes that it left.

The supervisor starts it first and writes a line ``PID START`` for every node into its
standard input, and ``done`` when all have ended. If the pipe closes without that, the
supervisor is dead: the guard signals what still runs and removes its shared memory.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

from . import shm
from .process_info import start_of

# How long a process may take to end after each signal [s].
PATIENCE = ((signal.SIGINT, 10.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0))


def send(pid: int, number: int) -> None:
    """Send a signal to a process, which is woken first if it was stopped."""
    with contextlib.suppress(OSError):
        os.kill(pid, number)
        os.kill(pid, signal.SIGCONT)


def end_all(start_times: dict[int, str], share: float = 1.0) -> None:
    """Wait for the processes, then signal those that still run, until none is left.

    The kernel has told them already that the supervisor died, and a second signal could
    meet a recorder that is closing its bag.

    Args:
        start_times: Begin of each process, by pid.
        share: Share of the usual patience, in (0, 1].
    """
    for number, timeout in ((signal.SIGCONT, PATIENCE[0][1]), *PATIENCE[1:]):
        deadline = time.monotonic() + share * timeout
        for pid in _living(start_times):
            send(pid, number)
        while _living(start_times) and time.monotonic() < deadline:
            time.sleep(0.02)


def _living(start_times: dict[int, str]) -> list[int]:
    return [pid for pid, start in start_times.items() if start_of(pid) == start]


def main() -> None:
    """Read pids until the pipe closes."""
    start_times: dict[int, str] = {}
    for line in sys.stdin:
        if line.strip() == "done":
            return
        pid, _, start = line.strip().partition(" ")
        start_times[int(pid)] = start
    end_all(start_times, *map(float, sys.argv[1:]))
    shm.clean()


if __name__ == "__main__":
    main()
