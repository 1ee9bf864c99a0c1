# SPDX-License-Identifier: Apache-2.0
"""A search in a process of its own, for callers that have to stay responsive.

    worker = Worker(task)            # task(tell) -> result, pickled
    for news in worker.news(): ...   # Progress, then Done or Failed

The process is spawned, not forked: its caller may have threads (DDS has).
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from loco_control.exceptions import LocoError

from ..mortal import end_with_parent


@dataclass(frozen=True)
class Progress:
    """How far it is."""

    fraction: float
    stage: str
    best: str


@dataclass(frozen=True)
class Done:
    """It has ended."""

    result: Any


@dataclass(frozen=True)
class Failed:
    """There is no result."""

    text: str


News = Progress | Done | Failed
Task = Callable[[Callable[[float, str, str], None]], Any]


class Worker:
    """A task that runs in a child process.

    Args:
        task: Called in the child with a function that takes progress.
    """

    def __init__(self, task: Task):
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(theirs, task), daemon=True)
        self._process.start()
        theirs.close()
        self._ended = False

    @property
    def pid(self) -> int:
        """Process id."""
        return int(self._process.pid or 0)

    def news(self) -> list[News]:
        """What has happened since the last call, oldest first; `Done` or `Failed` is the last."""
        found: list[News] = []
        try:
            while not self._ended and self._ours.poll():
                found.append(self._ours.recv())
                self._ended = isinstance(found[-1], (Done, Failed))
        except (EOFError, OSError):
            self._process.join(1.0)
            self._ended = True
            found.append(Failed(f"the search died with exit code {self._process.exitcode}"))
        return found

    def close(self) -> None:
        """End the process at once."""
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._ours.close()


def _work(pipe: Connection, task: Task) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller decides, also after Ctrl-C
    try:
        result = task(lambda *news: pipe.send(Progress(*news)))
        pipe.send(Done(result))
    except LocoError as error:
        pipe.send(Failed(str(error)))
    except BrokenPipeError:
        return  # nobody listens any more
