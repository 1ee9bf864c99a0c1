# SPDX-License-Identifier: Apache-2.0
"""A rollout without ROS, written as the same topics with the same bytes."""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from loco_control.exceptions import ParameterError
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

if TYPE_CHECKING:
    from loco_learning.joint_experiment import JointExperiment
    from loco_learning.joint_log import JointLog

TOPIC_OF = {  # in the order of a tick
    "state": "robot_state",
    "target": "gait_target",
    "command": "motion_command",
    "learning": "learning_state",
    "stance": "stance",
    "trunk": "trunk_torque",
}
_TRUTH = "ground_truth/odom"
warn = logging.getLogger(__name__)


def run_rollout(
    experiment: Experiment | JointExperiment,
    folder: Path,
    on_progress: Callable[[Progress], None],
) -> Outcome:
    """Run an experiment in this process, without nodes, into a bag.

    Raises:
        ParameterError: It is of a network of masses and springs, which only runs as nodes.
    """
    if experiment.node_set == "msd":
        raise ParameterError(
            f"{experiment.name} runs as nodes: --layout composed or processes; without ROS its "
            "loop is loco_learning.msd_reservoir.run_loop"
        )
    progress = Progress(duration=duration_of(experiment), phase="running")
    began = time.perf_counter()

    def on_tick(done: int, loop: Any) -> None:
        if done % 250 == 0:
            progress.sim_time = done * experiment.dt
            progress.real_time_factor = progress.sim_time / (time.perf_counter() - began)
            on_progress(progress)

    Path(folder).mkdir(parents=True, exist_ok=True)
    weights = str(Path(folder) / "weights.npz")
    if isinstance(experiment, Experiment):
        log = rollout(experiment, on_tick=on_tick, save_weights=weights)
    else:
        from loco_learning.joint_rollout import rollout as joint_rollout

        log = joint_rollout(experiment, on_tick=on_tick, save_weights=weights)
    write_log(log, folder)
    outcome = Outcome(Path(folder), fallen=bool(log.fall), text=_ending(log))
    outcome.real_time_factor = len(log) * experiment.dt / log.wall_time
    return outcome


def _ending(log: Log | JointLog) -> str:
    if not isinstance(log, Log):
        from .joint_rollout_bag import ending

        return ending(log)
    length = len(log) * log.dt
    return f"fell at {length:.2f} s: {log.fall}" if log.fall else f"{length:.1f} s simulated"


def write_log(log: Log | JointLog, folder: Path) -> None:
    """Write a log as a bag, tick by tick, with the bytes that the nodes would publish."""
    writer = BagWriter(folder, describe(log.experiment, layout="rollout", fall=log.fall))
    if isinstance(log, Log):
        _write_messages(log, writer)
    else:
        from . import joint_rollout_bag

        joint_rollout_bag.write_log(log, writer)
    _attach(log, writer)
    writer.close()
    if writer.failed:
        count, end = writer.kept
        warn.warning("recording stopped: %s; kept %d messages to %.3f s", writer.failed, count, end)


def _write_messages(log: Log, writer: BagWriter) -> None:
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


def _attach(log: Log | JointLog, writer: BagWriter) -> None:
    """Put the experiment and trained weights into the bag, the experiment beside it too."""
    folder = writer.folder
    text = yaml.safe_dump(to_dict(log.experiment), sort_keys=False)
    (folder / "experiment.yaml").write_text(text)
    writer.attach("experiment.yaml", text.encode())
    weights = folder / "weights.npz"
    if weights.is_file():
        writer.attach("weights.npz", weights.read_bytes(), "application/octet-stream")


def _row(stacked: Any, cls: type, tick: int) -> Any:
    return cls(**{f.name: getattr(stacked, f.name)[tick] for f in dataclasses.fields(cls)})
