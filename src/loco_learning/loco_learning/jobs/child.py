# SPDX-License-Identifier: Apache-2.0
"""A long computation in a child process, for callers that have to stay responsive.

The process sends events through a pipe; a `LocoError` in it, or its death, is an event of kind
`Failed`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from loco_control.exceptions import LocoError

from .process import spawn


@dataclass(frozen=True)
class Failed:
    """Event: the computation has failed."""

    text: str


class Child:
    """A child process and its events.

    Args:
        title: Name of the computation, for the message if its process dies.
        last: Class of the final event; `Failed` is another.
        work: Called in the child with its end of the pipe and the arguments.
        arguments: Arguments of `work`, pickled.
        duplex: Whether the child can receive as well as send.
    """

    def __init__(
        self,
        title: str,
        last: type,
        work: Callable[..., None],
        arguments: tuple,
        duplex: bool = False,
    ):
        self._title, self._last, self._finished = title, (last, Failed), False
        self._process, self._ours = spawn(_serve, (work, arguments), duplex)

    @property
    def pid(self) -> int:
        """Process id."""
        return int(self._process.pid or 0)

    def news(self) -> list[Any]:
        """Events since the last call, oldest first; the final event is the last."""
        news: list[Any] = []
        try:
            while not self._finished and self._ours.poll():
                news.append(self._ours.recv())
                self._finished = isinstance(news[-1], self._last)
        except (EOFError, OSError):
            self._process.join(1.0)
            self._finished = True
            news.append(Failed(f"{self._title} died with exit code {self._process.exitcode}"))
        return news

    def close(self) -> None:
        """Terminate the process immediately."""
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._ours.close()


def _serve(pipe: Connection, work: Callable[..., None], arguments: tuple) -> None:
    try:
        work(pipe, *arguments)
    except LocoError as error:
        pipe.send(Failed(str(error)))
    except BrokenPipeError:
        return  # the parent has closed the pipe
