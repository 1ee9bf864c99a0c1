# SPDX-License-Identifier: Apache-2.0
"""Where evaluations run: in this process, in processes of our own, or on a dask cluster.

All three take the same tasks and give the same scores; only the order in which the
scores arrive differs. Nothing an evaluation does ends the optimisation: an exception is a
score with a reason, and so is an evaluation whose process died twice.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import pickle
import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from multiprocessing.connection import wait
from typing import Any, Protocol

import numpy as np

from loco_control.exceptions import GraphError, LocoError, ParameterError

from .mortal import end_with_parent

CONNECT_SECONDS = 10.0  # for a scheduler and its workers to answer
TRIES = 2  # evaluations of a task whose process dies


@dataclass(frozen=True)
class Score:
    """What an evaluation found; small `value` is good, a `reason` says that it failed."""

    value: float
    reason: str = ""
    extra: dict[str, Any] = field(default_factory=dict)  # plain values, kept with the score


@dataclass(frozen=True)
class Task:
    """One evaluation: its place in the generation, its parameters (d,) and its seed."""

    index: int
    x: np.ndarray
    seed: int


class Workers(Protocol):
    """What evaluates tasks."""

    def evaluate(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Score]]:
        """Index and score of each task, in the order in which they are done."""

    def close(self) -> None:
        """Let go of processes and connections."""


def make(problem: Callable, failure: float, workers: int = 0, scheduler: str = "") -> Workers:
    """Workers for a problem.

    Args:
        problem: As `population.minimise` describes it.
        failure: Value of the score of an evaluation that raises or is not finite.
        workers: Processes; 0 evaluates in this one.
        scheduler: Address of a dask scheduler, to use its workers instead.

    Raises:
        ParameterError: The problem cannot be sent to other processes, or nobody answers there.
    """
    if not scheduler and workers < 1:
        return Here(problem, failure)
    try:
        payload = pickle.dumps((problem, failure))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ParameterError(f"the problem cannot be sent to other processes: {error}") from error
    return Cluster(payload, failure, scheduler) if scheduler else Pool(payload, failure, workers)


def score(problem: Callable, failure: float, x: np.ndarray, seed: int) -> Score:
    """Evaluate one point; whatever goes wrong becomes a failure with a reason."""
    try:
        found = problem(x, seed=seed) if getattr(problem, "seeded", False) else problem(x)
        if not isinstance(found, Score):
            found = Score(float(found))
    except Exception as error:  # noqa: BLE001, an evaluation may do anything
        text = str(error) if isinstance(error, LocoError) else f"{type(error).__name__}: {error}"
        return Score(failure, text or type(error).__name__)
    if not math.isfinite(found.value):
        return Score(failure, found.reason or f"the score is {found.value}", found.extra)
    return found


@dataclass
class Here:
    """Evaluates in this process, in order."""

    problem: Callable
    failure: float

    def evaluate(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Score]]:
        """See `Workers`."""
        for task in tasks:
            yield task.index, score(self.problem, self.failure, task.x, task.seed)

    def close(self) -> None:
        """See `Workers`."""


@dataclass
class _Worker:
    """A process of the pool, our end of its pipe, and what it is working on."""

    process: Any
    pipe: Any
    task: Task | None = None


class Pool:
    """Processes of our own, each with a pipe: a dead one is known by what it was doing.

    Args:
        payload: Pickled problem and value of a failure.
        failure: The latter.
        size: Number of processes.
    """

    def __init__(self, payload: bytes, failure: float, size: int):
        # Children of a fork would share locks and threads; and more than one BLAS thread per
        # process costs milliseconds a step.
        self._context = multiprocessing.get_context("spawn")
        for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ[variable] = "1"
        self._payload, self._failure = payload, failure
        self._workers = [self._start() for _ in range(size)]

    def evaluate(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Score]]:
        """See `Workers`."""
        waiting, deaths = deque(tasks), Counter[int]()
        while waiting or any(worker.task for worker in self._workers):
            for place, worker in enumerate(self._workers):
                if worker.task is None and waiting:
                    self._give(place, waiting.popleft())
            busy = [w for w in self._workers if w.task]
            wait([w.pipe for w in busy] + [w.process.sentinel for w in busy])
            for place, worker in enumerate(self._workers):
                if not worker.task:
                    continue
                task, found = worker.task, self._taken(worker)
                if isinstance(found, Score):
                    worker.task = None
                    yield task.index, found
                elif found == "died":
                    deaths[task.index] += 1
                    code = self._replace(place)
                    if deaths[task.index] < TRIES:
                        waiting.appendleft(task)
                    else:
                        yield (
                            task.index,
                            Score(self._failure, f"its process died, exit code {code}"),
                        )

    def close(self) -> None:
        """Stop all processes, also those in the middle of an evaluation."""
        for worker in self._workers:
            worker.pipe.close()
            if worker.task:
                worker.process.kill()
        for worker in self._workers:
            worker.process.join()

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_serve, args=(theirs, self._payload), daemon=True)
        process.start()
        theirs.close()
        return _Worker(process, ours)

    def _give(self, place: int, task: Task) -> None:
        self._workers[place].task = task
        try:
            self._workers[place].pipe.send(task)
        except OSError:  # it died while it had nothing to do
            self._replace(place)
            self._workers[place].task = task
            self._workers[place].pipe.send(task)

    def _taken(self, worker: _Worker) -> Score | str:
        """Score of a busy worker, "died", or "busy"."""
        try:
            if worker.pipe.poll():
                return worker.pipe.recv()
        except (EOFError, OSError):
            return "died"
        return "busy" if worker.process.is_alive() else "died"

    def _replace(self, place: int) -> int | None:
        old = self._workers[place]
        old.pipe.close()
        old.process.kill()
        old.process.join()
        self._workers[place] = self._start()
        return old.process.exitcode


def _serve(pipe: Any, payload: bytes) -> None:
    """Life of a process of the pool: it ends when the other end of the pipe is closed."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    problem, failure = pickle.loads(payload)  # noqa: S301, made by our parent
    try:
        while True:
            task = pipe.recv()
            pipe.send(score(problem, failure, task.x, task.seed))
    except (EOFError, OSError):
        return


class Cluster:
    """Workers of an existing dask cluster; it repeats the evaluations of a worker that dies.

    Args:
        payload: Pickled problem and value of a failure.
        failure: The latter.
        address: Of the scheduler, such as ``tcp://127.0.0.1:8786``.

    Raises:
        ParameterError: Nobody answers at the address, or its workers cannot import loco.
    """

    def __init__(self, payload: bytes, failure: float, address: str):
        try:
            import distributed
        except ImportError as error:
            raise ParameterError(f"--scheduler needs the package distributed: {error}") from error
        self._distributed, self._payload, self._failure = distributed, payload, failure
        self._address = address
        try:
            self._client = distributed.Client(
                address, timeout=CONNECT_SECONDS, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise ParameterError(
                f"no dask scheduler answers at {address!r}; start one with `dask scheduler` and "
                "`dask worker ADDRESS`, or leave --scheduler out to use processes of this machine"
            ) from error
        self._try()

    def _try(self) -> None:
        """Refuse a cluster whose workers cannot evaluate."""
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_SECONDS)
            self._client.submit(_ready, pure=False).result(timeout=CONNECT_SECONDS)
        except Exception as error:
            self.close()
            raise ParameterError(
                f"the dask cluster at {self._address} has no worker that can import loco_learning: "
                f"{type(error).__name__}: {error}"
            ) from error

    def evaluate(self, tasks: Sequence[Task]) -> Iterator[tuple[int, Score]]:
        """See `Workers`."""
        index = {}
        for task in tasks:
            future = self._client.submit(_remote, self._payload, task.x, task.seed, pure=False)
            index[future] = task.index
        for future in self._distributed.as_completed(index, loop=self._client.loop):
            if future.status == "cancelled":
                raise GraphError(
                    f"the dask scheduler at {self._address} is gone; every evaluation so far is "
                    "kept, start again to go on"
                )
            error = future.exception()
            if error is None:
                yield index[future], future.result()
            else:  # the worker died again and again
                yield index[future], Score(self._failure, f"{type(error).__name__}: {error}")

    def close(self) -> None:
        """Let go of the cluster, which goes on; what we had not got yet is cancelled."""
        self._client.close(timeout=2.0)


@lru_cache(maxsize=2)
def _unpacked(payload: bytes) -> tuple[Callable, float]:
    return pickle.loads(payload)  # noqa: S301, made by the optimisation that uses this cluster


def _remote(payload: bytes, x: np.ndarray, seed: int) -> Score:
    problem, failure = _unpacked(payload)
    return score(problem, failure, x, seed)


def _ready() -> bool:
    return True
