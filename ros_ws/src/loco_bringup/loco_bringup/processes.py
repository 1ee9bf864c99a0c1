# SPDX-License-Identifier: Apache-2.0
"""Child processes of a run: started with a log each, stopped in order, never orphaned."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

_PR_SET_PDEATHSIG = 1
# How long a process may take to end after each signal [s].
_PATIENCE = ((signal.SIGINT, 10.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, 5.0))


class Process:
    """One node process in its own session, so that Ctrl-C reaches only the supervisor.

    Args:
        name: Name for messages and for the log file.
        command: Arguments after the Python interpreter.
        log: File that gets stdout and stderr.
    """

    def __init__(self, name: str, command: list[str], log: Path):
        self.name = name
        self.log = log
        log.parent.mkdir(parents=True, exist_ok=True)
        with open(log, "wb") as stream:
            self._popen = subprocess.Popen(
                [sys.executable, *command],
                stdout=stream,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=_environment(),
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._popen.pid

    @property
    def code(self) -> int | None:
        """Exit code, None while it runs."""
        return self._popen.poll()

    def stop(self) -> int:
        """End the process: SIGINT, then SIGTERM, then SIGKILL. Returns its exit code."""
        for number, patience in _PATIENCE:
            if self.code is not None:
                break
            self._popen.send_signal(number)
            try:
                self._popen.wait(patience)
            except subprocess.TimeoutExpired:
                continue
        return self._popen.wait()

    def tail(self, lines: int = 5) -> str:
        """Last lines of the log."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-lines:])


def stop_all(processes: list[Process]) -> dict[str, int]:
    """Interrupt all at once, then wait for each; exit code by name."""
    for process in processes:
        if process.code is None:
            os.kill(process.pid, signal.SIGINT)
    deadline = time.monotonic() + _PATIENCE[0][1]
    while time.monotonic() < deadline and any(p.code is None for p in processes):
        time.sleep(0.01)
    return {p.name: p.stop() for p in processes}


def _environment() -> dict[str, str]:
    """Environment for a fresh interpreter; the ROS wheels set their own paths again."""
    env = dict(os.environ)
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        env.setdefault(name, "1")  # two BLAS threads cost 5 ms a step on two cores
    env.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    env["PYTHONUNBUFFERED"] = "1"
    return env


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
