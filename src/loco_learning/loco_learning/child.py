# SPDX-License-Identifier: Apache-2.0
"""A long computation in a process of its own, for callers that have to stay responsive.

The process is spawned, not forked: its caller may have threads (DDS has). It tells what
happens through a pipe; a `LocoError` in it is news of kind `Failed`, and so is its death.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from loco_control.exceptions import LocoError

from .mortal import end_with_parent


@dataclass(frozen=True)
class Failed:
    """There is no result."""

    text: str


class Child:
    """A process and the news from it.

    Args:
        what: What runs, for the message that it died.
        last: Kind of news after which nothing follows; `Failed` is another.
        work: Called in the child with its end of the pipe and the arguments.
        arguments: Pickled.
        duplex: The child may be told something, too.
    """

    def __init__(
        self,
        what: str,
        last: type,
        work: Callable[..., None],
        arguments: tuple,
        duplex: bool = False,
    ):
        self._what, self._last = what, (last, Failed)
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe(duplex)
        self._process = context.Process(target=_serve, args=(theirs, work, arguments), daemon=True)
        self._process.start()
        theirs.close()
        self._ended = False

    @property
    def pid(self) -> int:
        """Process id."""
        return int(self._process.pid or 0)

    def news(self) -> list[Any]:
        """What has happened since the last call, oldest first; the end of it is the last."""
        found: list[Any] = []
        try:
            while not self._ended and self._ours.poll():
                found.append(self._ours.recv())
                self._ended = isinstance(found[-1], self._last)
        except (EOFError, OSError):
            self._process.join(1.0)
            self._ended = True
            found.append(Failed(f"{self._what} died with exit code {self._process.exitcode}"))
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


def _serve(pipe: Connection, work: Callable[..., None], arguments: tuple) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller decides, also after Ctrl-C
    try:
        work(pipe, *arguments)
    except LocoError as error:
        pipe.send(Failed(str(error)))
    except BrokenPipeError:
        return  # nobody listens any more
