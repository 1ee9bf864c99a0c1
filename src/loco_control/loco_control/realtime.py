# SPDX-License-Identifier: Apache-2.0
"""Optional real-time settings of a process: scheduling, memory locking, processors."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

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
    lock_memory: bool = parameter(False, "lock all memory: nothing is swapped out (mlockall)")
    timer_slack: int = parameter(
        0, "largest delay of waking a thread; 0: value of the system", "ns", 0, 10**9
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
    lines = []
    if requests.fifo:
        need, rule = "CAP_SYS_NICE or a higher `ulimit -r`", os.sched_param(requests.fifo)
        call = _of_all_threads, os.sched_setscheduler, os.SCHED_FIFO, rule
        lines.append(_granted(f"SCHED_FIFO {requests.fifo}", need, *call))
    if requests.cpus:
        need = f"one of {', '.join(map(str, sorted(os.sched_getaffinity(0))))}"
        call = _of_all_threads, os.sched_setaffinity, requests.cpu_set()
        lines.append(_granted(f"processors {requests.cpus}", need, *call))
    if requests.lock_memory:
        soft = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
        limit = "unlimited" if soft == resource.RLIM_INFINITY else f"{soft // 1024} KiB"
        need = f"CAP_IPC_LOCK or a higher `ulimit -l` ({limit})"
        call = _LIBC.mlockall, _MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT
        lines.append(_granted("memory locked", need, _checked, *call))
    if requests.timer_slack:
        call = _LIBC.prctl, _PR_SET_TIMERSLACK, requests.timer_slack, 0, 0, 0
        lines.append(_granted(f"timer slack {requests.timer_slack} ns", "Linux", _checked, *call))
    return lines


def _granted(name: str, need: str, request: Callable, *arguments: Any) -> str:
    """Line on a request, which is called."""
    try:
        request(*arguments)
    except OSError as error:
        return f"{name}: refused ({error.strerror}; needs {need})"
    return f"{name}: granted"


def _of_all_threads(request: Callable, *arguments: Any) -> None:
    """Apply a request to each thread of this process; threads that have just ended are ignored."""
    for name in os.listdir("/proc/self/task"):
        with contextlib.suppress(ProcessLookupError):
            request(int(name), *arguments)


def _checked(function: Callable, *arguments: int) -> None:
    """Call a function of the C library; an error raises."""
    if function(*arguments):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
