# SPDX-License-Identifier: Apache-2.0
"""Process that survives a killed supervisor and ends the supervisor's nodes.

The supervisor starts the guard first and writes a line ``PID START`` for every node to its
standard input, and ``done`` when all nodes have ended. If the pipe closes without ``done``,
the supervisor is dead: the guard signals the running nodes and removes their shared memory.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time

from . import shm
from .process_info import start_of

# Longest time for a process to end after each signal [s].
TIMEOUTS = ((signal.SIGINT, 10.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0))


def send(pid: int, number: int) -> None:
    """Send a signal to a process; a stopped process is continued first (SIGCONT)."""
    with contextlib.suppress(OSError):
        os.kill(pid, number)
        os.kill(pid, signal.SIGCONT)


def end_all(start_times: dict[int, str], share: float = 1.0) -> None:
    """Wait for the processes, then signal those that still run, until all have ended.

    The kernel has already sent them a signal when the supervisor died, and a second signal
    could interrupt a recorder while it closes its bag.

    Args:
        start_times: Start time of each process, by pid.
        share: Factor on the usual waiting times, in (0, 1].
    """
    for number, timeout in ((signal.SIGCONT, TIMEOUTS[0][1]), *TIMEOUTS[1:]):
        deadline = time.monotonic() + share * timeout
        for pid in _living(start_times):
            send(pid, number)
        while _living(start_times) and time.monotonic() < deadline:
            time.sleep(0.02)


def _living(start_times: dict[int, str]) -> list[int]:
    return [pid for pid, start in start_times.items() if start_of(pid) == start]


def main() -> None:
    """Read pids until the pipe closes, then end the processes if the supervisor has died."""
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
