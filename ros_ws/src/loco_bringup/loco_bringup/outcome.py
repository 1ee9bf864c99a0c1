# SPDX-License-Identifier: Apache-2.0
"""Progress, outcome and bag metadata of a run, with or without ROS nodes."""

from __future__ import annotations

import contextlib
import json
import platform
from collections import deque
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from loco_control.exceptions import ParameterError
from loco_control.reading import within
from loco_learning.jobs.kept import versions
from loco_learning.runs.experiment import Experiment

STEP = "physics_step"  # key of a bag's metadata: physics step of the plant [s]
LIMIT = 1000  # largest number of events that a supervisor retains
VERSIONS = ("ros-rclpy", "pybullet", "mujoco", "numpy", "scipy", "numba", "mcap")


@dataclass
class Progress:
    """Values displayed in the progress line."""

    phase: str = "starting"
    sim_time: float = 0.0
    duration: float = 0.0
    real_time_factor: float = 0.0
    pids: dict[str, int] = field(default_factory=dict)  # process ids by name
    # Newest event: time of arrival [s], text.
    events: deque[tuple[float, Any]] = field(default_factory=lambda: deque(maxlen=LIMIT))


@dataclass
class Outcome:
    """Result of a run."""

    folder: Path
    text: str = ""
    fallen: bool = False
    interrupted: bool = False
    real_time_factor: float = 0.0
    dropped: int = 0
    exit_codes: dict[str, int] = field(default_factory=dict)
    restarts: dict[str, int] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)  # plant's report (clock realtime)
    granted: list[str] = field(default_factory=list)  # kernel settings, granted or refused

    @property
    def exit_code(self) -> int:
        """0 if done, 3 if the robot fell, 130 if interrupted."""
        return 130 if self.interrupted else 3 if self.fallen else 0


def default_folder(experiment: Experiment, root: Path = Path("bags")) -> Path:
    """New bag folder named after the experiment and the time.

    Raises:
        ParameterError: The name of the experiment leads to a folder outside `root`.
    """
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    return within(root, f"{experiment.name}_{stamp}", "name of an experiment")


def file_at(out: str | Path | None, default: Path) -> Path:
    """Path of the single file that a command writes, from its option ``--out``.

    Args:
        out: The file, if it has the ending of `default`, else its folder; None for the default.
        default: Default path.
    """
    path = default if out is None else Path(out)
    return path if path.suffix == default.suffix and not path.is_dir() else path / default.name


def check_new(folder: Path) -> None:
    """Raise `ParameterError` if a folder for a new bag already contains one."""
    if any(Path(folder).glob("*.mcap")):
        raise ParameterError(f"{folder} holds a bag already; choose another folder")


def remove_bag(folder: Path) -> None:
    """Delete the recording of a run that never began; its logs and parameters are kept."""
    for path in (*Path(folder).glob("*.mcap"), Path(folder) / "metadata.yaml"):
        path.unlink(missing_ok=True)


def duration_of(experiment: Experiment) -> float:
    """Simulated time of a run [s]."""
    return experiment.ticks / experiment.control_rate


def describe(experiment: Experiment, **extra: Any) -> dict[str, str]:
    """Metadata of a run for its bag: experiment, seed, versions, physics step of its plant."""
    values = {"experiment": experiment.name, "seed": experiment.seed, "robot": experiment.robot}
    values |= {"recorded_at": datetime.now().astimezone().isoformat(timespec="seconds")}
    values |= {"versions": json.dumps(versions(VERSIONS)), "processor": processor()}
    if hasattr(experiment, "sim_params"):  # networks of masses and springs have no engine
        values[STEP] = 1.0 / experiment.sim_params.physics_rate
    values |= extra
    return {key: str(value) for key, value in values.items()}


def processor() -> str:
    """Name, family and model of the processor, on which the last bits of sums and tanh depend."""
    about: dict[str, str] = {}
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            key, _, value = line.partition(":")
            about.setdefault(key.strip(), value.strip())
    if "model name" not in about:
        return platform.processor() or platform.machine()
    cpu_family, model = about.get("cpu family", "?"), about.get("model", "?")
    return f"{about['model name']}, family {cpu_family}, model {model}"
