# SPDX-License-Identifier: Apache-2.0
"""Optional real-time settings of a process: scheduling, memory locking, processors."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from collections.abc import Callable
from dataclasses import dataclass

from .exceptions import ParameterError
from .params import Params, parameter

_LIBC = ctypes.CDLL(None, use_errno=True)
_PR_SET_TIMERSLACK = 29
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


@dataclass(frozen=True)
class RealtimeParams(Params):
    """Real-time settings requested from the kernel; none by default."""

    fifo: int = parameter(0, "priority under SCHED_FIFO of all threads, 0 for none", "-", 0, 99)
    cpus: str = parameter("", "processors that the threads may use, such as 1 or 0,2; empty: all")
    lock_memory: bool = parameter(False, "keep what is in memory there (mlockall)")
    timer_slack: int = parameter(
        0, "how late the kernel may wake a sleeper, 0 for what the system has", "ns", 0, 10**9
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.cpu_set()

    def cpu_set(self) -> set[int]:
        """Processors by number.

        Raises:
            ParameterError: `cpus` is not a list of numbers.
        """
        parts = [part.strip() for part in self.cpus.split(",")] if self.cpus else []
        if not all(part.isdecimal() for part in parts):
            raise ParameterError(
                f"realtime.cpus must be numbers such as 1 or 0,2, got {self.cpus!r}"
            )
        return set(map(int, parts))


def prepare(requests: RealtimeParams) -> list[str]:
    """Apply the requested settings to this process and all its threads.

    Threads that start later inherit them.

    Returns:
        A line for each request: granted, or refused with the reason.
    """
    steps: list[tuple[str, Callable[[], None], str]] = []
    if requests.fifo:
        need = "CAP_SYS_NICE or a higher `ulimit -r`"
        steps.append((f"SCHED_FIFO {requests.fifo}", lambda: _fifo(requests.fifo), need))
    if requests.cpus:
        cores = f"one of {_listed(os.sched_getaffinity(0))}"
        steps.append((f"processors {requests.cpus}", lambda: _pin(requests.cpu_set()), cores))
    if requests.lock_memory:
        need = f"CAP_IPC_LOCK or a higher `ulimit -l` ({_memory_limit()})"
        steps.append(("memory locked", _lock, need))
    if requests.timer_slack:
        slack = requests.timer_slack
        steps.append((f"timer slack {slack} ns", lambda: _slack(slack), "Linux"))
    return [_try(*request) for request in steps]


def _try(name: str, request: Callable[[], None], need: str) -> str:
    try:
        request()
    except OSError as error:
        return f"{name}: refused ({error.strerror}; needs {need})"
    return f"{name}: granted"


def _of_all_threads(request: Callable[[int], None]) -> None:
    """Apply a request to each thread of this process; threads that have just ended are ignored."""
    for name in os.listdir("/proc/self/task"):
        with contextlib.suppress(ProcessLookupError):
            request(int(name))


def _fifo(priority: int) -> None:
    parameters = os.sched_param(priority)
    _of_all_threads(lambda thread: os.sched_setscheduler(thread, os.SCHED_FIFO, parameters))


def _pin(cpus: set[int]) -> None:
    _of_all_threads(lambda thread: os.sched_setaffinity(thread, cpus))


def _lock() -> None:
    _check(_LIBC.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT))


def _slack(nanoseconds: int) -> None:
    _check(_LIBC.prctl(_PR_SET_TIMERSLACK, nanoseconds, 0, 0, 0))


def _check(result: int) -> None:
    if result:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _memory_limit() -> str:
    soft = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return "unlimited" if soft == resource.RLIM_INFINITY else f"{soft // 1024} KiB"


def _listed(cpus: set[int]) -> str:
    return ", ".join(map(str, sorted(cpus)))
