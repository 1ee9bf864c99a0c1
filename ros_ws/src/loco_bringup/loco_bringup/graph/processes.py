# SPDX-License-Identifier: Apache-2.0
"""Child processes of a run: started with one log each, stopped in order, never orphaned.

Three mechanisms prevent orphans: `stop_all` on every exit path, a signal from the kernel when
the supervisor dies, and the `guard`, which also ends processes that ignore the signal.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from . import shm
from .guard import TIMEOUTS, send
from .process_info import start_of

RECORDER = "recorder"  # name of the process that writes the bag
_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1
_MINUTE = 60.0  # [s]


@dataclass(frozen=True)
class Restart:
    """Restart policy of a process that died: largest number of restarts per minute, 0 for never."""

    per_minute: int = 0

    def allows(self, code: int, times: Sequence[float], time_now: float) -> bool:
        """Whether a process may be restarted.

        Args:
            code: Exit code of the process; after 0 it is not restarted.
            times: Times of earlier restarts [s].
            time_now: Current time [s].
        """
        recent = [t for t in times if time_now - t < _MINUTE]
        return code != 0 and len(recent) < self.per_minute


NO_RESTART = Restart()


class Guard:
    """The guard process, which ends the nodes if this process is killed.

    Args:
        share: Factor on the usual waiting times, in (0, 1].
    """

    def __init__(self, share: float = 1.0) -> None:
        self._popen = subprocess.Popen(
            [sys.executable, "-m", "loco_bringup.graph.guard", str(share)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=_environment(),
            start_new_session=True,
            text=True,
        )

    def watch(self, pid: int) -> None:
        """Also end this process if the supervisor is killed."""
        self._tell(f"{pid} {start_of(pid)}")

    def dismiss(self) -> None:
        """End the guard, once all processes have ended."""
        self._tell("done")
        with contextlib.suppress(OSError):
            self._popen.stdin.close()
        self._popen.wait()

    def _tell(self, line: str) -> None:
        with contextlib.suppress(OSError):  # the guard was killed: the kernel's signal must suffice
            self._popen.stdin.write(line + "\n")
            self._popen.stdin.flush()


class Process:
    """One node process in its own session, so that Ctrl-C reaches only the supervisor.

    Args:
        name: Name for messages and for the log file.
        command: Arguments after the Python interpreter.
        log: File for stdout and stderr.
        restart: Restart policy.
        guard: Guard with which the process is registered.

    Attributes:
        restarts: Times of its restarts, `time.monotonic` [s].
    """

    def __init__(
        self,
        name: str,
        command: list[str],
        log: Path,
        restart: Restart = NO_RESTART,
        guard: Guard | None = None,
    ):
        self.name, self.log, self.restart = name, log, restart
        self.restarts: list[float] = []
        self._command, self._guard = command, guard
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_bytes(b"")
        self._start()

    def _start(self) -> None:
        parent = os.getpid()
        with open(self.log, "ab") as stream:
            self._popen = subprocess.Popen(
                [sys.executable, *self._command],
                stdout=stream,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                env=_environment(),
                start_new_session=True,
                preexec_fn=lambda: _die_with(parent),
            )
        if self._guard:
            self._guard.watch(self.pid)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._popen.pid

    @property
    def code(self) -> int | None:
        """Exit code, None while it runs; minus the signal that killed it."""
        return self._popen.poll()

    def revive(self) -> bool:
        """Restart a process that died if its policy allows; returns whether it was restarted."""
        time_now = time.monotonic()
        if self.code is None or not self.restart.allows(self.code, self.restarts, time_now):
            return False
        self.restarts.append(time_now)
        self._start()
        return True

    def stop(self) -> int:
        """End the process: SIGINT, then SIGTERM, then SIGKILL. Returns its exit code."""
        for number, timeout in TIMEOUTS:
            if self.code is not None:
                break
            send(self.pid, number)
            try:
                self._popen.wait(timeout)
            except subprocess.TimeoutExpired:
                continue
        return self._popen.wait()

    def tail(self, lines: int = 5) -> str:
        """Last lines of the log."""
        return "\n".join(self.log.read_text(errors="replace").splitlines()[-lines:])


def start_nodes(
    name: str,
    classes: Sequence[str],
    params: Path,
    log: Path,
    guard: Guard,
    namespace: str = "",
    restart: Restart = NO_RESTART,
) -> Process:
    """Start a process of nodes, given as ``module:Class``, with a parameter file."""
    ros = ["--ros-args", "--params-file", str(params)]
    ros += ["-r", f"__ns:=/{namespace}"] if namespace else []
    command = ["-m", "loco_bringup.graph.composed", *classes, *ros]
    return Process(name, command, log, restart, guard)


def stop_all(processes: list[Process], guard: Guard | None = None) -> dict[str, int]:
    """Stop all processes and clean up shared memory; returns the exit code by name.

    The recorder is stopped last, so that the last messages of the others are in the bag.
    """
    for last in (False, True):
        group = [p for p in processes if (p.name == RECORDER) == last and p.code is None]
        for process in group:
            send(process.pid, signal.SIGINT)
        deadline = time.monotonic() + TIMEOUTS[0][1]
        while time.monotonic() < deadline and any(p.code is None for p in group):
            time.sleep(0.01)
    codes = {p.name: p.stop() for p in processes}
    shm.clean()  # for killed processes; two that close a port at once can also leave it
    if guard:
        guard.dismiss()
    return codes


def _environment() -> dict[str, str]:
    """Environment for a new interpreter, in which the ROS wheels set their own paths again."""
    env = dict(os.environ)
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        env.setdefault(name, "1")  # two BLAS threads cost 5 ms per step on two cores
    env["PYTHONUNBUFFERED"] = "1"
    env["PYTHONSAFEPATH"] = "1"  # no imports from the current folder (Python 3.11 and later)
    return env


def _die_with(parent: int) -> None:
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # the parent died before the request
        os._exit(1)
