# SPDX-License-Identifier: Apache-2.0
"""Lateness of a loop that only wakes at its deadlines: the limit of the machine, without ROS.

``python -m loco_workshop.bench.bare_loop SECONDS RATE JSON`` prints JSON; its last
argument holds `RealtimeParams`.
"""

from __future__ import annotations

import gc
import json
import sys
import time
from typing import Any

from loco_control.pacing import Deadlines, sleep_until
from loco_control.params import from_dict
from loco_control.realtime import RealtimeParams, prepare


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
