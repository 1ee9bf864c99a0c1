# SPDX-License-Identifier: Apache-2.0
"""Everything that was said in a run, one array per field over all ticks."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.params import to_dict
from loco_control.types import (
    GaitTarget,
    GroundTruth,
    LearningState,
    MotionCommand,
    RobotState,
    Stance,
    TrunkTorque,
)

from . import archive
from .experiment import Experiment, from_values
from .params import PHASES

PARTS = {
    "state": RobotState,
    "target": GaitTarget,
    "command": MotionCommand,
    "learning": LearningState,
    "stance": Stance,
    "trunk": TrunkTorque,
    "truth": GroundTruth,
}


@dataclass
class Log:
    """A run: the messages of all ticks, stacked.

    Each part is the dataclass of the message of that name with its fields
    stacked along a first axis over ticks: ``log.state.q`` has shape (T, 12),
    ``log.learning.error`` shape (T,).
    """

    state: RobotState
    target: GaitTarget
    command: MotionCommand
    learning: LearningState
    stance: Stance
    trunk: TrunkTorque
    truth: GroundTruth
    experiment: Experiment = field(default_factory=Experiment)
    seed: int = 0
    fall: str = ""  # why the robot fell; empty if it did not
    reflex_time: np.ndarray = field(default_factory=lambda: np.empty(0))  # wall clock [s], (T,)
    wall_time: float = float("nan")  # of the whole run [s]

    def __len__(self) -> int:
        return len(self.learning.prediction)

    @property
    def t(self) -> np.ndarray:
        """Simulated time [s], (T,)."""
        return np.asarray(self.state.t)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return self.experiment.dt

    @property
    def complete(self) -> bool:
        """The run lasted as long as its experiment says."""
        return len(self) >= self.experiment.ticks

    def phase(self, name: str) -> slice:
        """Ticks of a phase of `PHASES`; empty if it was not reached."""
        ticks = np.flatnonzero(self.learning.phase == PHASES.index(name))
        return slice(int(ticks[0]), int(ticks[-1]) + 1) if len(ticks) else slice(0, 0)

    def cut(self, interval: slice) -> Log:
        """The same run, only the ticks of `interval`."""
        parts = {name: stack(getattr(self, name), interval) for name in PARTS}
        return dataclasses.replace(self, **parts, reflex_time=self.reflex_time[interval])

    def save(self, path: str | Path) -> None:
        """Write arrays, experiment, seed and outcome to one ``.npz`` file."""
        meta = {
            "experiment": to_dict(self.experiment),
            "seed": self.seed,
            "fall": self.fall,
            "wall_time": self.wall_time,
        }
        arrays = {
            f"{name}.{f.name}": getattr(getattr(self, name), f.name)
            for name in PARTS
            for f in dataclasses.fields(PARTS[name])
        }
        arrays["reflex_time"] = self.reflex_time
        archive.write(path, "log", meta, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read what `save` wrote.

        Raises:
            MissingFileError: There is no such file.
            ParameterError: It is not a log of this version.
        """
        meta, arrays = archive.read(path, "log")
        parts = {
            name: kind(**{f.name: arrays[f"{name}.{f.name}"] for f in dataclasses.fields(kind)})
            for name, kind in PARTS.items()
        }
        return cls(
            **parts,
            experiment=from_values(meta["experiment"]),
            seed=meta["seed"],
            fall=meta["fall"],
            reflex_time=arrays["reflex_time"],
            wall_time=meta["wall_time"],
        )


class Column:
    """Grows a stacked message tick by tick, in arrays of a known length."""

    def __init__(self, kind: type, length: int):
        self._kind, self._length = kind, length
        self._values = attrgetter(*(f.name for f in dataclasses.fields(kind)))
        self._arrays: list[np.ndarray] = []

    def add(self, row: int, message: Any) -> None:
        """Copy the fields of a message to a row."""
        values = self._values(message)
        if not self._arrays:
            self._arrays = [self._empty(value) for value in values]
        for array, value in zip(self._arrays, values, strict=True):
            array[row] = value

    def stacked(self, rows: int) -> Any:
        """The message class with its first `rows` rows as arrays."""
        return self._kind(*[array[:rows] for array in self._arrays])

    def _empty(self, value: Any) -> np.ndarray:
        value = np.asarray(value)
        return np.zeros((self._length, *value.shape), value.dtype)


def stack(part: Any, interval: slice) -> Any:
    """Rows `interval` of a stacked message."""
    return dataclasses.replace(
        part, **{f.name: getattr(part, f.name)[interval] for f in dataclasses.fields(part)}
    )
