# SPDX-License-Identifier: Apache-2.0
"""Process of nodes: ``python -m loco_bringup.graph.composed [FOLDER/]MODULE:CLASS …``."""

from __future__ import annotations

import importlib
import os
import signal
import sys

from loco_control.ros.executor import run_nodes

from . import shm


def main() -> None:
    """Run the node classes named on the command line until a signal.

    Whoever started the process removes what is left in shared memory. If nobody is there any
    more, each process becomes one that does, so that the last holds none of it itself.
    """
    orphaned: list[int] = []  # the kernel tells, and the guard; a supervisor interrupts
    signal.signal(signal.SIGTERM, lambda number, frame: orphaned.append(number))
    split = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    classes = []
    for path in sys.argv[1:split]:
        folder, _, path = path.rpartition("/")
        if folder and folder not in sys.path:
            sys.path.append(folder)  # the last: no file there takes the place of a library
        module, _, name = path.partition(":")
        classes.append(getattr(importlib.import_module(module), name))
    code = run_nodes(classes, sys.argv[split:])
    if orphaned:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # one comes for each thread of a supervisor
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        os.execv(sys.executable, [sys.executable, "-m", shm.__name__])
    sys.exit(code)


if __name__ == "__main__":
    main()
