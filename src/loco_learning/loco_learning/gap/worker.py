# SPDX-License-Identifier: Apache-2.0
"""Search in a process of its own, for callers that have to stay responsive.

worker = Worker(task)            # task(tell) -> result, pickled
for news in worker.news(): ...   # Progress, then Done or Failed
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from ..jobs.child import Child, Failed

__all__ = ["Done", "Failed", "News", "Progress", "Task", "Worker"]


@dataclass(frozen=True)
class Progress:
    """Progress of the work."""

    fraction: float
    stage: str
    best: str


@dataclass(frozen=True)
class Done:
    """End of the work, with its result."""

    result: Any


News = Progress | Done | Failed
Task = Callable[[Callable[[float, str, str], None]], Any]


class Worker(Child):
    """A task that runs in a child process and sends events of type `News`.

    Args:
        task: Called in the child with a function that accepts progress.
    """

    def __init__(self, task: Task):
        super().__init__("the search", Done, _work, (task,))


def _work(pipe: Connection, task: Task) -> None:
    pipe.send(Done(task(lambda *news: pipe.send(Progress(*news)))))
