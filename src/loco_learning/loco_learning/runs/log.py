# SPDX-License-Identifier: Apache-2.0
"""Log of a run as plain arrays: columns by name, one row per tick."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loco_control import types
from loco_control.params import to_dict

from .. import archive
from ..params import OPEN, PHASES
from .experiment import Experiment, from_values

PARTS = {  # messages of a tick
    "state": types.RobotState,
    "truth": types.GroundTruth,
    "target": types.GaitTarget,
    "command": types.MotionCommand,
    "learning": types.LearningState,
    "stance": types.Stance,
    "trunk": types.TrunkTorque,
}


class Column(NamedTuple):
    """Origin of a column: a field of one of the messages of a tick."""

    part: str  # message, a key of `PARTS`
    field: str  # field of the class in `loco_control.types`
    shape: tuple[Any, ...]  # shape of a row; n joints, m driven joints, f feet, k outputs
    kind: type = float


COLUMNS = {
    "t": Column("state", "t", ()),  # simulated time [s]
    "q": Column("state", "q", ("n",)),  # readings of the joint sensors [rad]
    "dq": Column("state", "dq", ("n",)),  # [rad/s]
    "tau": Column("state", "tau", ("n",)),  # torque of drives, mean over the last period [N·m]
    "grf": Column("state", "grf", ("f", 3)),  # ground reaction forces, world frame [N]
    "contact": Column("state", "contact", ("f",), bool),  # the foot touches the ground
    "imu_orientation": Column("state", "orientation", (4,)),  # reading of the IMU, x y z w
    "gyro": Column("state", "angular_velocity", (3,)),  # [rad/s]
    "acceleration": Column("state", "linear_acceleration", (3,)),  # specific force [m/s²]
    "position": Column("truth", "position", (3,)),  # true position of the base in world [m]
    "orientation": Column("truth", "orientation", (4,)),  # true attitude of the base, x y z w
    "velocity": Column("truth", "linear_velocity", (3,)),  # true, base frame [m/s]
    "spin": Column("truth", "angular_velocity", (3,)),  # true, base frame [rad/s]
    "target": Column("target", "q", ("m",)),  # positions of the target generator [rad]
    "target_dq": Column("target", "dq", ("m",)),  # [rad/s]
    "command": Column("command", "q", ("m",)),  # commanded positions of the drives [rad]
    "command_dq": Column("command", "dq", ("m",)),  # [rad/s]
    "prediction": Column("learning", "prediction", ("k",)),  # positions, then velocities
    "error": Column("learning", "error", ()),  # rms of predicted minus target positions [rad]
    "phase": Column("learning", "phase", (), np.int64),  # index in `PHASES`
}
WALKING = {  # further columns of a robot with legs: gait, stance and trunk
    "target_feet": Column("target", "foot_position", ("f", 3)),  # in the base frame [m]
    "target_feet_velocity": Column("target", "foot_velocity", ("f", 3)),  # [m/s]
    "stride_phase": Column("target", "phase", ("f",)),  # 0 at touchdown [strides], in [0, 1)
    "target_speed": Column("target", "speed", ()),  # target of the forward speed [m/s]
    "target_frequency": Column("target", "frequency", ()),  # target of the stride frequency [Hz]
    "clock": Column("target", "stance", ("f",), bool),  # stance by the gait clock
    "weight_norm": Column("learning", "weight_norm", ()),  # Frobenius norm of the readout
    "driving": Column("learning", "driving", (), bool),  # the prediction is commanded
    "learning": Column("learning", "learning", (), bool),  # the readout was updated
    "foot_height": Column("stance", "foot_height", ("f",)),  # height of the commanded foot [m]
    "stance": Column("stance", "stance", ("f",), bool),  # the leg carries the trunk
    "estimator": Column("stance", "estimator", (), np.int64),  # index in `ESTIMATORS`
    "trunk_tau": Column("trunk", "tau", ("n",)),  # feed-forward torque [N·m]
    "wrench": Column("trunk", "wrench", (6,)),  # target at the trunk, force then moment
}
REFLEX_TIME = "reflex_time"  # wall-clock time of a step of the network [s]; rollouts only


@dataclass
class Log:
    """A run: columns with ticks as the first axis, (T, ...), and its outcome.

    A column is read as an attribute: ``log.q`` has shape (T, n). A recording may lack some.
    """

    columns: dict[str, np.ndarray] = field(repr=False)
    experiment: Experiment
    seed: int = 0
    fall: str = ""  # reason of a fall, or of a diverged simulation; empty if neither
    wall_time: float = float("nan")  # duration of the whole run [s]

    def __getattr__(self, name: str) -> np.ndarray:
        columns = self.__dict__.get("columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"this log has no {name!r}; columns: {', '.join(columns)}")

    def __len__(self) -> int:
        return len(self.columns["t"])

    def has(self, *names: str) -> bool:
        """True if the log has these columns, each with at least one value."""
        return all(
            name in self.columns and not np.isnan(self.columns[name]).all() for name in names
        )

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return self.experiment.dt

    @property
    def complete(self) -> bool:
        """True if the run lasted as long as its experiment specifies."""
        return len(self) >= self.experiment.ticks

    @property
    def distance(self) -> float:
        """Displacement of the base along x, forward, from the first to the last tick [m]."""
        x = self.columns["position"][:, 0]
        return float(x[-1] - x[0]) if len(x) else 0.0

    def phase_of(self, name: str) -> slice:
        """Ticks of a phase of `PHASES`; empty if it was not reached."""
        ticks = np.flatnonzero(self.columns["phase"] == PHASES.index(name))
        return slice(int(ticks[0]), int(ticks[-1]) + 1) if len(ticks) else slice(0, 0)

    def phases(self) -> dict[str, slice]:
        """Ticks of the phases that were reached; without training, "train" is `OPEN`."""
        phases = {}
        for name in PHASES:
            ticks = self.phase_of(name)
            if ticks.stop > ticks.start:
                called = name != "train" or self.experiment.learner.enabled
                phases[name if called else OPEN] = ticks
        return phases

    def ticks(self) -> np.ndarray:
        """Control periods since reset, (T,)."""
        return np.rint(self.columns["t"] / self.dt).astype(int)

    def message(self, part: str, row: int) -> Any:
        """A message of `PARTS` as sent in a tick; None for fields whose column is missing."""
        fields = {f.name: None for f in dataclasses.fields(PARTS[part])}
        for name, column in columns_of(self.experiment).items():
            if column.part == part and name in self.columns:
                fields[column.field] = self.columns[name][row]
        if part == "trunk":
            fields["stance"] = self.columns["stance"][row]  # the same legs
        t = float(self.columns["t"][row])
        return PARTS[part](**{**fields, "tick": round(t / self.dt), "t": t})

    def cut(self, interval: slice) -> Log:
        """The log restricted to the ticks of `interval`."""
        return dataclasses.replace(self, columns={k: v[interval] for k, v in self.columns.items()})

    def changed(self, **columns: np.ndarray) -> Log:
        """Copy with some columns replaced."""
        return dataclasses.replace(self, columns={**self.columns, **columns})

    def save(self, path: str | Path) -> None:
        """Write columns, experiment, seed and outcome to one ``.npz`` file."""
        meta = {
            "experiment": to_dict(self.experiment),
            "seed": self.seed,
            "fall": self.fall,
            "wall_time": self.wall_time,
        }
        archive.write(path, "log", meta, self.columns)

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a file of `save`.

        Raises:
            MissingFileError: The file does not exist.
            ParameterError: The file is not a log of this version.
        """
        with archive.reading(path, "log") as (meta, columns):
            return cls(columns, from_values(meta.pop("experiment")), **meta)


def columns_of(experiment: Experiment) -> dict[str, Column]:
    """Columns of the messages of a run."""
    return {**COLUMNS, **WALKING} if experiment.gait else COLUMNS


def empty(experiment: Experiment, ticks: int) -> dict[str, np.ndarray]:
    """Columns of zeros for a run of `ticks`."""
    plant = experiment.plant
    counts: dict[Any, int] = {
        "n": len(plant.joints),
        "m": len(plant.driven),
        "f": len(plant.feet),
        "k": 2 * len(experiment.outputs),
    }
    return {
        name: np.zeros((ticks, *(counts.get(k, k) for k in column.shape)), column.kind)
        for name, column in columns_of(experiment).items()
    }


def writer(
    experiment: Experiment, columns: dict[str, np.ndarray]
) -> Callable[[int, dict[str, Any]], None]:
    """Function that writes the messages of a tick, by the names of their parts, to a row."""
    parts: dict[str, list[tuple[str, str]]] = {}
    for name, column in columns_of(experiment).items():
        parts.setdefault(column.part, []).append((column.field, name))
    plan = [
        (part, attrgetter(*(f for f, _ in pairs)), [columns[name] for _, name in pairs])
        for part, pairs in parts.items()
    ]

    def write(row: int, messages: dict[str, Any]) -> None:
        for part, values, arrays in plan:
            for array, value in zip(arrays, values(messages[part]), strict=True):
                array[row] = value

    return write
