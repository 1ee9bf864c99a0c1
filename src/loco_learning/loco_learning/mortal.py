# SPDX-License-Identifier: Apache-2.0
"""Processes that end with the one that started them, also when that one is killed."""

from __future__ import annotations

import multiprocessing
import os
import threading

ORPHANED = 3  # exit code


def end_with_parent() -> None:
    """End this process as soon as its parent is gone; call it first in a worker.

    A worker that computes does not notice that nobody listens any more, and a parent that
    was killed can tell nobody. Without a parent, in the first process, nothing happens.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: multiprocessing.process.BaseProcess) -> None:
    parent.join()
    os._exit(ORPHANED)
