# SPDX-License-Identifier: Apache-2.0
"""Jobs that spawned processes can import."""

import os
import signal
import threading
import time
from pathlib import Path

from loco_control.exceptions import NameUnknownError


def scaled(factor, value, wait=0.0):
    time.sleep(wait)
    return factor * value


def pid_of(seconds):
    time.sleep(seconds)
    return os.getpid()


def dies(mark, times):
    """Kill the process of the job the first `times` times; then say how often it was run."""
    with Path(mark).open("a") as file:
        file.write(".")
    runs = len(Path(mark).read_text())
    if runs <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return runs


def fails(kind):
    if kind == "name":
        raise NameUnknownError("gait", "trott", ["trot", "walk"])
    if kind == "result":
        return threading.Lock()
    raise ZeroDivisionError("too far left")
