# SPDX-License-Identifier: Apache-2.0
"""Screening and fits in several processes; results come in the order in which they were asked."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from ..mortal import end_with_parent
from .case import Case

_case: Case | None = None


def _begin(case: Case) -> None:
    global _case
    _case = case
    end_with_parent()


def _call(function: Callable, arguments: tuple) -> Any:
    return function(_case, *arguments)


class Tasks:
    """Calls functions of a case and plain arguments, in this process or in others.

    Args:
        case: First argument of every call.
        workers: Processes; 1 calls in this one.
    """

    def __init__(self, case: Case, workers: int = 1):
        self._case, self._pool = case, None
        if workers > 1:
            for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
                os.environ[variable] = "1"
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(workers, context, _begin, (case,))

    def each(self, function: Callable, arguments: Sequence[tuple]) -> Iterator[Any]:
        """Results of calls, in the order of the arguments."""
        if self._pool is None:
            for entry in arguments:
                yield function(self._case, *entry)
        else:
            futures = [self._pool.submit(_call, function, entry) for entry in arguments]
            for future in futures:
                yield future.result()

    def close(self) -> None:
        """End the processes, also those that still work."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
