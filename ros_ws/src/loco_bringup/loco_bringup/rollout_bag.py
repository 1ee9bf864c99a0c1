# SPDX-License-Identifier: Apache-2.0
"""A rollout without ROS, written as the same topics with the same bytes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from loco_control.names import JOINTS
from loco_control.params import to_dict
from loco_control.ros.convert import Converter
from loco_control.ros.topics import topic
from loco_learning.experiment import Experiment
from loco_learning.log import PARTS, Log
from loco_learning.rollout import rollout
from loco_sim.ros.tools import encoders

from .bag_writer import BagWriter
from .run import Outcome, Progress, describe, duration_of

TOPIC_OF = {  # in the order of a tick
    "state": "robot_state",
    "target": "gait_target",
    "command": "motion_command",
    "learning": "learning_state",
    "stance": "stance",
    "trunk": "trunk_torque",
}
_TRUTH = "ground_truth/odom"


def run_rollout(
    experiment: Experiment, folder: Path, on_progress: Callable[[Progress], None]
) -> Outcome:
    """Run an experiment in this process, without nodes, into a bag."""
    progress = Progress(duration=duration_of(experiment), phase="running")
    began = time.perf_counter()

    def on_tick(done: int, loop: Any) -> None:
        if done % 250 == 0:
            progress.sim_time = done * experiment.dt
            progress.real_time_factor = progress.sim_time / (time.perf_counter() - began)
            on_progress(progress)

    Path(folder).mkdir(parents=True, exist_ok=True)
    log = rollout(experiment, on_tick=on_tick, save_weights=str(Path(folder) / "weights.npz"))
    write_log(log, folder)
    outcome = Outcome(Path(folder), fallen=bool(log.fall))
    length = len(log) * experiment.dt
    outcome.text = (
        f"fell at {length:.2f} s: {log.fall}" if log.fall else f"{length:.1f} s simulated"
    )
    outcome.real_time_factor = length / log.wall_time
    return outcome


def write_log(log: Log, folder: Path) -> None:
    """Write a log as a bag, tick by tick, with the bytes that the nodes would publish."""
    writer = BagWriter(folder, describe(log.experiment, layout="rollout", fall=log.fall))
    packs = {part: (name, Converter(PARTS[part]).pack) for part, name in TOPIC_OF.items()}
    truth = encoders(JOINTS)[_TRUTH]
    for name in (*TOPIC_OF.values(), _TRUTH):
        writer.add_row("/" + name, topic(name))
    for tick in range(len(log)):
        t = round(log.t[tick] * 1e9)
        rows = {part: _row(getattr(log, part), PARTS[part], tick) for part in PARTS}
        writer.write("/" + _TRUTH, truth(rows["state"], rows["truth"]), t)
        for part, (name, pack) in packs.items():
            writer.write("/" + name, pack(rows[part]), t)
    text = yaml.safe_dump(to_dict(log.experiment), sort_keys=False)
    (Path(folder) / "experiment.yaml").write_text(text)
    writer.attach("experiment.yaml", text.encode())
    weights = Path(folder) / "weights.npz"
    if weights.is_file():
        writer.attach("weights.npz", weights.read_bytes(), "application/octet-stream")
    writer.close()


def _row(stacked: Any, cls: type, tick: int) -> Any:
    return cls(**{f.name: getattr(stacked, f.name)[tick] for f in dataclasses.fields(cls)})
