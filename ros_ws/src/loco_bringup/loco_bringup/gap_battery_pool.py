# SPDX-License-Identifier: Apache-2.0
"""Processes that work on cases, each with a time limit; one that hangs or dies is replaced."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from loco_learning.mortal import end_with_parent

LOOK = 0.5  # seconds between looks at the clock


@dataclass
class _Hand:
    process: Any
    pipe: Any
    job: int = -1  # none
    since: float = 0.0


def run(
    function: Callable[..., Any], jobs: Sequence[tuple], workers: int, limit: float
) -> Iterator[tuple[int, Any]]:
    """Index and result of each job, in the order in which they are done.

    Args:
        function: Called with the values of a job in another process; can be pickled.
        jobs: Arguments.
        workers: Processes.
        limit: Seconds that a job may take.

    Yields:
        A text instead of a result says why there is none.
    """
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    waiting = deque(range(len(jobs)))
    hands = [_start(function) for _ in range(min(workers, len(jobs)))]
    try:
        while waiting or any(hand.job >= 0 for hand in hands):
            for hand in hands:
                if hand.job < 0 and waiting:
                    hand.job, hand.since = waiting.popleft(), time.monotonic()
                    hand.pipe.send(jobs[hand.job])
            busy = [hand for hand in hands if hand.job >= 0]
            wait([hand.pipe for hand in busy], LOOK)
            for place, hand in enumerate(hands):
                if hand.job < 0:
                    continue
                job, (done, result) = hand.job, _taken(hand, limit)
                if done:
                    hand.job = -1
                    if isinstance(result, _Gone):
                        hand.process.kill()
                        hand.process.join()
                        hands[place] = _start(function)
                        result = str(result)
                    yield job, result
    finally:
        for hand in hands:
            hand.process.kill()
            hand.process.join()


class _Gone(str):
    """Why a process had to be replaced."""

    __slots__ = ()


def _taken(hand: _Hand, limit: float) -> tuple[bool, Any]:
    try:
        if hand.pipe.poll():
            return True, hand.pipe.recv()
    except (EOFError, OSError):
        return True, _Gone("its process died")
    if time.monotonic() - hand.since > limit:
        return True, _Gone(f"it took more than {limit:g} s")
    return (True, _Gone("its process died")) if not hand.process.is_alive() else (False, None)


def _start(function: Callable[..., Any]) -> _Hand:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, function), daemon=True)
    process.start()
    theirs.close()
    return _Hand(process, ours)


def _serve(pipe: Any, function: Callable[..., Any]) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    try:
        while True:
            arguments = pipe.recv()
            try:
                result = function(*arguments)
            except Exception as error:  # noqa: BLE001, one case must not end the battery
                result = f"{type(error).__name__}: {error}"
            pipe.send(result)
    except (EOFError, OSError):
        return
