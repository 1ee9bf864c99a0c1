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

# How long a process may take to end after each signal [s].
PATIENCE = ((signal.SIGINT, 10.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0))


def start_of(pid: int) -> str:
    """When a process began, "" if there is none: with the pid it names one process for good.

    A process whose first thread has ended has its files and locks until the last one has.
    """
    try:
        with open(f"/proc/{pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        threads = len(os.listdir(f"/proc/{pid}/task"))
    except OSError:
        return ""
    return "" if fields[0] == "Z" and threads < 2 else fields[19]


def send(pid: int, number: int) -> None:
    """Send a signal to a process, which is woken first if it was stopped."""
    with contextlib.suppress(OSError):
        os.kill(pid, number)
        os.kill(pid, signal.SIGCONT)


def end_all(begins: dict[int, str], share: float = 1.0) -> None:
    """Wait for the processes, then signal those that still run, until none is left.

    The kernel has told them already that the supervisor died, and a second signal could
    meet a recorder that is closing its bag.

    Args:
        begins: Begin of each process, by pid.
        share: Share of the usual patience, in (0, 1].
    """
    for number, patience in ((signal.SIGCONT, PATIENCE[0][1]), *PATIENCE[1:]):
        deadline = time.monotonic() + share * patience
        for pid in _alive(begins):
            send(pid, number)
        while _alive(begins) and time.monotonic() < deadline:
            time.sleep(0.02)


def _alive(begins: dict[int, str]) -> list[int]:
    return [pid for pid, start in begins.items() if start_of(pid) == start]


def main() -> None:
    """Read pids until the pipe closes."""
    begins: dict[int, str] = {}
    for line in sys.stdin:
        if line.strip() == "done":
            return
        pid, _, start = line.strip().partition(" ")
        begins[int(pid)] = start
    end_all(begins, *map(float, sys.argv[1:]))
    shm.clean()


if __name__ == "__main__":
    main()
