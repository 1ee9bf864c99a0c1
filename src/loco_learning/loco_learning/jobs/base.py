# SPDX-License-Identifier: Apache-2.0
"""Interface of a function that runs in other processes or hosts, and results of its calls."""

from __future__ import annotations

import pickle
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from loco_control.exceptions import GraphError, LocoError


@dataclass(frozen=True)
class Failure:
    """Outcome of a job without a result."""

    reason: str  # one line
    error: Exception | None = None  # raised by the job; None if its process died or was killed
    trace: str = ""  # traceback of the error, from the process that raised it

    def again(self) -> Exception:
        """The error of the job, to be raised in this process."""
        error = self.error or GraphError(f"a job has no result: {self.reason}")
        if self.trace:
            error.__cause__ = RuntimeError(self.trace)
        return error


class Jobs(ABC):
    """A function that runs in some place; a context manager that closes itself."""

    @abstractmethod
    def outcomes(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """Index and result of each job, in order of completion; a `Failure` if there is none.

        Args:
            jobs: Arguments of each call, after the shared ones.
        """

    def results(self, jobs: Sequence[tuple]) -> Iterator[tuple[int, Any]]:
        """Index and result of each job, in order of completion; raises the error of a failure."""
        for index, result in self.outcomes(jobs):
            if isinstance(result, Failure):
                raise result.again()
            yield index, result

    def ordered(self, jobs: Sequence[tuple]) -> Iterator[Any]:
        """Results in the order of the jobs; raises the error of a failed one."""
        pending: dict[int, Any] = {}
        following = 0
        for index, result in self.results(jobs):
            pending[index] = result
            while following in pending:
                yield pending.pop(following)
                following += 1

    @abstractmethod
    def close(self) -> None:
        """Release processes and connections, even during a job."""

    def __enter__(self) -> Jobs:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def outcome(function: Callable[..., Any], job: tuple) -> Any:
    """Result of a call, or a `Failure` with the reason."""
    try:
        return function(*job)
    except Exception as error:  # noqa: BLE001, a job may raise anything
        expected = isinstance(error, LocoError)
        reason = str(error) if expected else f"{type(error).__name__}: {error}"
        return Failure(reason or type(error).__name__, error)


def sendable(result: Any) -> Any:
    """The outcome of a call in a form that can be pickled."""
    if not isinstance(result, Failure) or result.error is None:
        return result
    trace = "".join(traceback.format_exception(None, result.error, result.error.__traceback__))
    return Failure(result.reason, _portable(result.error), trace)


def _portable(error: Exception) -> Exception:
    """The error if it can be pickled, otherwise a similar one."""
    try:
        return pickle.loads(pickle.dumps(error))  # noqa: S301, from this process
    except Exception:  # noqa: BLE001, errors of other packages may raise anything
        kind = LocoError if isinstance(error, LocoError) else RuntimeError
        return kind(str(error))
