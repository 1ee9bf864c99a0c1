# SPDX-License-Identifier: Apache-2.0
"""Calibration in a process of its own, for callers that have to stay responsive.

worker = Worker(recording, "tigrillo", options)
while worker.alive: for news in worker.news(): ...
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from ..jobs.child import Child, Failed
from .params import CalibrationParams
from .progress import Fit, Generation
from .recording import Recording

__all__ = [
    *("Done", "Failed", "Maker", "News", "Progress", "Started", "Worker"),
    "make_calibration",
]


@dataclass(frozen=True)
class Started:
    """Event: the recording was read and compared with the initial model."""

    before: float  # error of the initial model


@dataclass(frozen=True)
class Progress:
    """Event: a generation is complete."""

    generation: Generation
    model: str  # text of the best model.yaml, empty without improvement


@dataclass(frozen=True)
class Done:
    """Event: the search has ended."""

    fit: Fit
    model: str  # text of the best model.yaml


News = Started | Progress | Done | Failed
# Makes a `fit.Calibration`, or an object with its `run`, `cancel`, `model`, `before`, `options`.
Maker = Callable[[Recording, str, CalibrationParams], Any]


def make_calibration(recording: Recording, robot: str, options: CalibrationParams) -> Any:
    """The calibration of `fit`, imported in the process where it runs."""
    from .fit import Calibration

    return Calibration(recording, robot, options)


class Worker(Child):
    """A calibration that runs in a child process and sends events of type `News`.

    Args:
        recording: Measurements, or a function that reads them in the child.
        robot: Name of a robot or path of a ``robot.yaml`` or ``model.yaml``.
        options: Parameters to fit, and settings of the search.
        make: Function that makes the calibration in the child.
    """

    def __init__(
        self,
        recording: Recording | Callable[[], Recording],
        robot: str,
        options: CalibrationParams,
        make: Maker = make_calibration,
    ):
        arguments = make, recording, robot, options
        super().__init__("the fit", Done, _work, arguments, duplex=True)

    def cancel(self) -> None:
        """Request an end after the current generation."""
        try:
            self._ours.send("cancel")
        except OSError:
            pass  # the process has ended


def _work(
    pipe: Connection,
    make: Maker,
    recording: Recording | Callable[[], Recording],
    robot: str,
    options: CalibrationParams,
) -> None:
    measured = recording() if callable(recording) else recording
    calibration = make(measured, robot, options)
    before = calibration.before.error[options.loss]
    pipe.send(Started(before))
    threading.Thread(target=_obey, args=(pipe, calibration), daemon=True).start()
    fit = calibration.run(_teller(pipe, calibration, before))
    pipe.send(Done(fit, calibration.model(fit.values).dumps()))


def _obey(pipe: Connection, calibration: Any) -> None:
    """Cancel on request, and when the caller has ended."""
    try:
        pipe.recv()
    except (EOFError, OSError):
        pass
    calibration.cancel()


def _teller(pipe: Connection, calibration: Any, before: float) -> Callable[[Generation], None]:
    best = before

    def report(generation: Generation) -> None:
        nonlocal best
        text = ""
        if generation.best < best:
            best = generation.best
            text = calibration.model(generation.values).dumps()
        pipe.send(Progress(generation, text))

    return report
