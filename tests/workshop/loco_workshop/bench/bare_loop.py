# SPDX-License-Identifier: Apache-2.0
"""Lateness of a loop that only wakes at its deadlines: the limit of the machine, without ROS.

``python -m loco_workshop.bench.bare_loop SECONDS RATE JSON`` prints JSON; its last
argument holds `RealtimeParams`.
"""

from __future__ import annotations

import ctypes
import gc
import json
import sys
import time
from typing import Any

from loco_control.pacing import Deadlines
from loco_control.params import from_dict
from loco_control.realtime import RealtimeParams, prepare

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLOCK_MONOTONIC, _TIMER_ABSTIME = 1, 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def sleep_until(deadline: float) -> None:
    """Sleep until a time of `time.monotonic` [s], or until a signal."""
    seconds = int(deadline)
    until = _Timespec(seconds, int((deadline - seconds) * 1e9))
    _LIBC.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None)


def measure(seconds: float, rate: float, requests: RealtimeParams) -> dict[str, Any]:
    """Lateness of a loop in this process.

    Args:
        seconds: Duration of the loop [s].
        rate: Ticks per second [Hz].
        requests: Requests of the process to the kernel.
    """
    granted = prepare(requests)
    gc.collect()
    gc.freeze()
    ticks, end = Deadlines(rate, catch_up=1_000_000), time.monotonic() + seconds
    while ticks.next < end:
        sleep_until(ticks.next)
        ticks.due()
    return {**ticks.report(), "granted": granted}


def main() -> None:
    """Measure with the options of the command line and print JSON."""
    seconds, rate, requests = sys.argv[1:]
    params = from_dict(RealtimeParams, json.loads(requests), "realtime")
    sys.stdout.write(json.dumps(measure(float(seconds), float(rate), params)))


if __name__ == "__main__":
    main()
