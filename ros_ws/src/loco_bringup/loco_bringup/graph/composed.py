# SPDX-License-Identifier: Apache-2.0
"""Run nodes in one process: ``python -m loco_bringup.graph.composed [FOLDER/]MODULE:CLASS …``."""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys

from loco_control.ros.executor import run_nodes

from . import shm


def main() -> None:
    """Run the node classes named on the command line until a signal arrives.

    The parent process removes leftovers in shared memory. If the parent has died, each process
    is replaced by one that cleans up (`shm`), so that it no longer uses these files itself.
    """
    gc.set_threshold(50_000)  # as in `cli.main`, until the nodes are prepared
    orphaned: list[int] = []  # SIGTERM means that the parent died; a live one sends SIGINT
    signal.signal(signal.SIGTERM, lambda number, frame: orphaned.append(number))
    split = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    classes = []
    for path in sys.argv[1:split]:
        folder, _, path = path.rpartition("/")
        if folder and folder not in sys.path:
            sys.path.append(folder)  # at the end: no file there shadows a library
        module, _, name = path.partition(":")
        classes.append(getattr(importlib.import_module(module), name))
    code = run_nodes(classes, sys.argv[split:])
    if orphaned:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # sent once per thread of the supervisor
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        os.execv(sys.executable, [sys.executable, "-m", shm.__name__])
    sys.exit(code)


if __name__ == "__main__":
    main()
