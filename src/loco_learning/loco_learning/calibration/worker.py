# SPDX-License-Identifier: Apache-2.0
"""A calibration in a process of its own, for callers that have to stay responsive.

    worker = Worker(recording, "tigrillo", options)
    while worker.alive: for news in worker.news(): ...

The process is spawned, not forked: its caller may have threads (DDS has).
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from loco_control.exceptions import LocoError

from ..mortal import end_with_parent
from .params import CalibrationParams
from .progress import Fit, Generation
from .recording import Recording


@dataclass(frozen=True)
class Started:
    """The recording is understood and the model as given has been compared with it."""

    before: float  # its error


@dataclass(frozen=True)
class Progress:
    """A generation is done."""

    generation: Generation
    model: str  # text of the best model.yaml, empty if none got better


@dataclass(frozen=True)
class Done:
    """The search has ended."""

    fit: Fit
    model: str  # text of the best model.yaml


@dataclass(frozen=True)
class Failed:
    """There is no result."""

    text: str


News = Started | Progress | Done | Failed
# Makes what has `run`, `cancel`, `model`, `before` and `options`: a `fit.Calibration`.
Maker = Callable[[Recording, str, CalibrationParams], Any]


def make_calibration(recording: Recording, robot: str, options: CalibrationParams) -> Any:
    """The calibration of `fit`, imported where it runs."""
    from .fit import Calibration

    return Calibration(recording, robot, options)


class Worker:
    """A calibration that runs in a child process.

    Args:
        recording: What was measured, or a function that reads it, to be called in the child.
        robot: Name of a robot or path of a ``robot.yaml`` or ``model.yaml``.
        options: What is fitted and how.
        make: Makes the calibration, in the child.
    """

    def __init__(
        self,
        recording: Recording | Callable[[], Recording],
        robot: str,
        options: CalibrationParams,
        make: Maker = make_calibration,
    ):
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_work, args=(theirs, make, recording, robot, options), daemon=True
        )
        self._process.start()
        self._pid = int(self._process.pid or 0)
        theirs.close()
        self._ended = False

    @property
    def pid(self) -> int:
        """Process id."""
        return self._pid

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
            found.append(Failed(f"the fit died with exit code {self._process.exitcode}"))
        return found

    def cancel(self) -> None:
        """Ask for an end after the generation that is running."""
        try:
            self._ours.send("cancel")
        except OSError:
            pass  # it has ended

    def close(self) -> None:
        """End the process at once."""
        if self._process.is_alive():
            self._process.terminate()
            self._process.join(2.0)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._ours.close()


def _work(
    pipe: Connection,
    make: Maker,
    recording: Recording | Callable[[], Recording],
    robot: str,
    options: CalibrationParams,
) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the caller decides, also after Ctrl-C
    try:
        found = recording() if callable(recording) else recording
        calibration = make(found, robot, options)
        before = calibration.before.error[options.loss]
        pipe.send(Started(before))
        threading.Thread(target=_obey, args=(pipe, calibration), daemon=True).start()
        fit = calibration.run(_teller(pipe, calibration, before))
        pipe.send(Done(fit, calibration.model(fit.values).dumps()))
    except LocoError as error:
        pipe.send(Failed(str(error)))
    except BrokenPipeError:
        return  # nobody listens any more


def _obey(pipe: Connection, calibration: Any) -> None:
    """Cancel when told to, and when the caller is gone."""
    try:
        pipe.recv()
    except (EOFError, OSError):
        pass
    calibration.cancel()


def _teller(pipe: Connection, calibration: Any, before: float) -> Callable[[Generation], None]:
    best = before

    def tell(generation: Generation) -> None:
        nonlocal best
        text = ""
        if generation.best < best:
            best = generation.best
            text = calibration.model(generation.values).dumps()
        pipe.send(Progress(generation, text))

    return tell
