# SPDX-License-Identifier: Apache-2.0
"""Many calls of one function: in this process, in child processes, or on a dask cluster.

    with pool.start(function, (shared,), workers=2) as jobs:
        for result in jobs.ordered([(1,), (2,)]): ...    # function(shared, 1), function(shared, 2)

All three run the same jobs with the same results; only the order of completion differs. A process
that dies is replaced and its job is repeated once; one that exceeds the time limit is killed.
"""

from __future__ import annotations

import math
import pickle
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from multiprocessing.connection import wait
from typing import Any

from loco_control.exceptions import ParameterError

from .base import Failure, Jobs, outcome, sendable
from .cluster import Cluster
from .process import spawn

__all__ = ["Failure", "InProcess", "Jobs", "Processes", "start", "where"]

TRIES = 2  # runs of a job if its process dies


def start(
    function: Callable[..., Any],
    shared: tuple = (),
    workers: int = 0,
    scheduler: str = "",
    limit: float = math.inf,
) -> Jobs:
    """Jobs of `function(*shared, *job)` in the selected place.

    Args:
        function: The function; pickled unless it runs in this process.
        shared: First arguments of every call, sent once to each process.
        workers: Number of processes; 0 runs the jobs in this process, in their order.
        scheduler: Address of a dask scheduler to use its workers instead, such as
            ``tcp://127.0.0.1:8786``.
        limit: Longest time of a job [s]; enforced for child processes only.

    Raises:
        ParameterError: The function cannot be pickled, or no dask scheduler with a worker
            responds at the address.
    """
    if not scheduler and workers < 1:
        return InProcess(partial(function, *shared))
    try:
        payload = pickle.dumps((function, shared))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ParameterError(f"the problem cannot be sent to other processes: {error}") from error
    if scheduler:
        return Cluster(payload, scheduler)
    return Processes(payload, workers, limit)


def where(workers: int | str) -> tuple[int, str]:
    """Number of processes and address of a scheduler, for `start`.

    Args:
        workers: Number of processes, of which one is this one; or the address of a scheduler.
    """
    if isinstance(workers, str):
        return 0, workers
    return workers if workers > 1 else 0, ""


class InProcess(Jobs):
    """Runs jobs in this process, in their order."""

    def __init__(self, function: Callable[..., Any]):
        self._function = function

    def outcomes(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """See `Jobs`."""
        for index, job in enumerate(jobs):
            yield index, outcome(self._function, job)

    def close(self) -> None:
        """See `Jobs`."""


class _Worker:
    """A process of the pool, the parent's end of its pipe, and its current job."""

    def __init__(self, payload: bytes):
        self.process, self.pipe = spawn(_serve, (payload,))
        self.job, self.deadline = -1, math.inf  # no job

    def answer(self) -> tuple[Any] | str:
        """The result in a tuple, or "busy", or "dead"."""
        running = self.process.is_alive()  # checked first: a process may send and then end
        try:
            if self.pipe.poll():
                return self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(1.0)
            return "dead"
        return "busy" if running else "dead"


class Processes(Jobs):
    """Runs jobs in child processes, each with a pipe; they start when there is work.

    Args:
        payload: Pickled function and shared arguments.
        size: Number of processes.
        limit: Longest time of a job [s].
    """

    def __init__(self, payload: bytes, size: int, limit: float = math.inf):
        self._payload, self._size, self._limit = payload, size, limit
        self._workers: list[_Worker] = []

    def outcomes(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """See `Jobs`."""
        waiting, deaths = deque(range(len(jobs))), Counter[int]()
        try:
            while waiting or self._busy():
                while waiting and (worker := self._free()):
                    self._give(worker, waiting.popleft(), jobs)
                wait([end for w in self._busy() for end in (w.pipe, w.process.sentinel)],
                     self._patience())  # fmt: skip
                for worker in self._busy():
                    job, answer = worker.job, worker.answer()
                    if isinstance(answer, tuple):
                        worker.job = -1
                        yield job, answer[0]
                    elif answer == "dead":
                        code = self._remove(worker)
                        deaths[job] += 1
                        if deaths[job] < TRIES:
                            waiting.appendleft(job)
                        else:
                            yield job, Failure(f"its process died, exit code {code}")
                    elif time.monotonic() > worker.deadline:
                        self._remove(worker)
                        yield job, Failure(f"it took more than {self._limit:g} s")
        finally:
            for worker in self._busy():  # the caller has stopped iterating: results are not needed
                self._remove(worker)

    def close(self) -> None:
        """End all processes, even during a job."""
        for worker in list(self._workers):
            self._remove(worker)

    def _busy(self) -> list[_Worker]:
        return [worker for worker in self._workers if worker.job >= 0]

    def _patience(self) -> float | None:
        """Time until the first job exceeds its limit [s]; None without a limit."""
        rest = min(worker.deadline for worker in self._busy()) - time.monotonic()
        return None if math.isinf(rest) else max(0.0, rest) + 0.01

    def _free(self) -> _Worker | None:
        for worker in self._workers:
            if worker.job < 0:
                return worker
        if len(self._workers) == self._size:
            return None
        self._workers.append(_Worker(self._payload))
        return self._workers[-1]

    def _give(self, worker: _Worker, job: int, jobs: Sequence[tuple]) -> None:
        try:
            worker.pipe.send(jobs[job])
        except OSError:  # the process died while idle
            self._remove(worker)
            worker = _Worker(self._payload)
            self._workers.append(worker)
            worker.pipe.send(jobs[job])
        worker.job, worker.deadline = job, time.monotonic() + self._limit

    def _remove(self, worker: _Worker) -> int | None:
        """End a process; returns its exit code."""
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.kill()
        worker.process.join()
        return worker.process.exitcode


def _serve(pipe: Any, payload: bytes) -> None:
    """Main loop of a process of the pool, until the other end of the pipe is closed."""
    function, shared = pickle.loads(payload)  # noqa: S301, from the parent process
    task = partial(function, *shared)
    try:
        while True:
            result = sendable(outcome(task, pipe.recv()))
            try:
                pipe.send((result,))
            except (pickle.PicklingError, AttributeError, TypeError) as error:
                pipe.send((Failure(f"its result cannot be sent: {error}"),))
    except (EOFError, OSError):
        return
