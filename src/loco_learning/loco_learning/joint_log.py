# SPDX-License-Identifier: Apache-2.0
"""A run of a joint robot as plain arrays, one row per tick."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.params import to_dict

from . import archive
from .joint_experiment import JointExperiment, from_values

COLUMNS = {  # name: shape of a row, by counts of joints n, driven joints m and feet f
    "t": (),  # simulated time [s]
    "q": ("n",),  # what the joint sensors say [rad]
    "dq": ("n",),  # [rad/s]
    "tau": ("n",),  # torque of the drives, mean over the last control period [N·m]
    "target": ("m",),  # what the oscillators want [rad]
    "target_dq": ("m",),  # [rad/s]
    "command": ("m",),  # what the drives are told [rad]
    "command_dq": ("m",),  # [rad/s]
    "prediction": ("m",),  # of the learner [rad]; zeros while it is off
    "error": (),  # rms of prediction minus target [rad]
    "phase": (),  # index in `PHASES`
    "position": (3,),  # true position of the base in world [m]
    "orientation": (4,),  # true attitude of the base, x y z w
    "velocity": (3,),  # true, base frame [m/s]
    "spin": (3,),  # true, base frame [rad/s]
    "imu_orientation": (4,),  # what the IMU says, x y z w
    "gyro": (3,),  # [rad/s]
    "acceleration": (3,),  # specific force [m/s²]
    "contact": ("f",),  # the foot touches the ground
}
KINDS = {"phase": np.int64, "contact": bool}


@dataclass
class JointLog:
    """Columns of `COLUMNS`, each with a first axis over ticks (T, ...), and how the run ended."""

    columns: dict[str, np.ndarray] = field(repr=False)
    experiment: JointExperiment
    seed: int = 0
    fall: str = ""  # why the robot fell, or how the simulation diverged; empty if neither
    wall_time: float = float("nan")  # of the whole run [s]

    def __getattr__(self, name: str) -> np.ndarray:
        columns = self.__dict__.get("columns", {})
        if name in columns:
            return columns[name]
        raise AttributeError(f"a joint log has no {name!r}; columns: {', '.join(COLUMNS)}")

    def __len__(self) -> int:
        return len(self.columns["t"])

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return self.experiment.dt

    @property
    def complete(self) -> bool:
        """The run lasted as long as its experiment says."""
        return len(self) >= self.experiment.ticks

    @property
    def distance(self) -> float:
        """How far the base got along x, forward, from the first tick to the last [m]."""
        x = self.columns["position"][:, 0]
        return float(x[-1] - x[0]) if len(x) else 0.0

    def cut(self, interval: slice) -> JointLog:
        """The same run, only the ticks of `interval`."""
        return dataclasses.replace(self, columns={k: v[interval] for k, v in self.columns.items()})

    def save(self, path: str | Path) -> None:
        """Write columns, experiment, seed and outcome to one ``.npz`` file."""
        meta = {
            "experiment": to_dict(self.experiment),
            "seed": self.seed,
            "fall": self.fall,
            "wall_time": self.wall_time,
        }
        archive.write(path, "joint_log", meta, self.columns)

    @classmethod
    def load(cls, path: str | Path) -> JointLog:
        """Read what `save` wrote.

        Raises:
            MissingFileError: There is no such file.
            ParameterError: It is not a joint log of this version.
        """
        meta, columns = archive.read(path, "joint_log")
        return cls(columns, from_values(meta.pop("experiment")), **meta)


def empty(experiment: JointExperiment, ticks: int) -> dict[str, np.ndarray]:
    """Columns of zeros for a run of `ticks`."""
    plant = experiment.plant
    counts: dict[Any, int] = {
        "n": len(plant.joints), "m": len(plant.driven), "f": len(plant.feet)
    }  # fmt: skip
    return {
        name: np.zeros((ticks, *(counts.get(k, k) for k in shape)), KINDS.get(name, float))
        for name, shape in COLUMNS.items()
    }
