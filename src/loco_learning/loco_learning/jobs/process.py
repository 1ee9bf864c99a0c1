# SPDX-License-Identifier: Apache-2.0
"""Spawned process with a pipe, which ends with its parent."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

ORPHANED = 3  # exit code of a process whose parent has ended


def spawn(
    work: Callable[..., None], arguments: tuple = (), duplex: bool = True
) -> tuple[BaseProcess, Connection]:
    """Start `work(pipe, *arguments)` in a new process; returns the process and the parent's pipe.

    The process is spawned, not forked, since a fork would share locks and threads (of DDS, for
    example). It uses one BLAS thread, since more cost milliseconds per step, and ignores Ctrl-C,
    which the parent handles.

    Args:
        work: A function that can be pickled.
        arguments: Further arguments of `work`, pickled.
        duplex: Whether the process can receive as well as send.
    """
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    os.environ["PYTHONSAFEPATH"] = "1"  # no imports from the current folder
    context = multiprocessing.get_context("spawn")
    parent_end, child_end = context.Pipe(duplex)
    process = context.Process(target=_live, args=(child_end, work, arguments), daemon=True)
    with _bare_script_hidden():
        process.start()
    child_end.close()
    return process, parent_end


@contextlib.contextmanager
def _bare_script_hidden() -> Iterator[None]:
    """Prevent a child from running the user's script, if that does not check `__name__`.

    Python imports the main script into each spawned process; a script without this check would
    start the same work there, recursively.
    """
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is None or main.__spec__ is not None or _asks_for_its_name(path):
        yield
        return
    del main.__file__
    try:
        yield
    finally:
        main.__file__ = path


def _asks_for_its_name(path: str) -> bool:
    try:
        return b"__name__" in Path(path).read_bytes()
    except OSError:
        return True


def end_with_parent() -> None:
    """End this process as soon as its parent has ended; to be called first in a worker.

    A computing worker does not notice the end of its parent, and a killed parent cannot notify
    it. Without a parent process this does nothing.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_outlive, args=(parent,), daemon=True).start()


def _outlive(parent: BaseProcess) -> None:
    parent.join()
    os._exit(ORPHANED)


def _live(pipe: Connection, work: Callable[..., None], arguments: tuple) -> None:
    end_with_parent()
    gc.set_threshold(50_000)  # as in `cli.main`
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    work(pipe, *arguments)
