# SPDX-License-Identifier: Apache-2.0
"""Rollout without ROS, recorded with the same topics and bytes as a graph."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable, whole_folder
from loco_control.params import to_dict
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.convert import Converter
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.plain import message_class
from loco_control.ros.messages.topics import TOPICS
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.log import PARTS, Log
from loco_learning.runs.rollout import rollout
from loco_sim.plant.simulation import end_text
from loco_sim.ros.encoders import encoders

from ..bag.writer import BagWriter, Limits
from ..outcome import Outcome, Progress, check_new, describe, duration_of
from .bag_log import TOPIC_OF, TRUTH

Encode = Callable[[dict[str, Any]], bytes]  # argument: messages of a tick by name
_FIELDS = ("position", "velocity")
DESCRIPTION = "robot_description"
VIEWED = ("joint_states", "imu/data", "/tf", "/clock")  # standard messages, for viewers
warn = logging.getLogger(__name__)


def run_rollout(
    experiment: Experiment,
    folder: Path,
    on_progress: Callable[[Progress], None],
    limits: Limits | None = None,
) -> Outcome:
    """Run an experiment in this process, without nodes, and record it with these file limits.

    Raises:
        ParameterError: The experiment is a network of masses and springs, which only runs as
            nodes, or the folder holds a bag or cannot be written.
    """
    check_new(folder)
    check_writable(folder)
    if experiment.node_set == "msd":
        raise ParameterError(
            f"{experiment.name} runs as nodes: --layout composed or processes; without ROS its "
            "loop is loco_learning.networks.reservoir.run_loop"
        )
    progress = Progress(duration=duration_of(experiment), phase="running")
    began = time.perf_counter()

    def on_tick(done: int, loop: Any) -> None:
        if done % 250 == 0:
            progress.sim_time = done * experiment.dt
            progress.real_time_factor = progress.sim_time / (time.perf_counter() - began)
            on_progress(progress)

    with whole_folder(folder) as place:
        log = rollout(experiment, on_tick=on_tick, save_weights=place / "weights.npz")
        write_log(log, place, limits)
    outcome = Outcome(Path(folder), fallen=bool(log.fall), text=_end_of(log))
    outcome.real_time_factor = len(log) * experiment.dt / log.wall_time
    return outcome


def _end_of(log: Log) -> str:
    """Text for the end of a rollout, as the plant node reports it."""
    length = len(log) * log.dt
    if log.fall:
        return f"fell at {length:.2f} s: {log.fall}"
    if log.experiment.gait:
        return f"{length:.1f} s simulated"
    return end_text(length, None if log.experiment.plant.fixed_base else log.distance)


def write_log(log: Log, folder: Path, limits: Limits | None = None) -> None:
    """Write a log as a bag, tick by tick, with the bytes that the nodes would publish."""
    custom = describe(log.experiment, layout="rollout", fall=log.fall)
    writer = BagWriter(folder, custom, limits=limits)
    write_messages(log, writer)
    _attach(log, writer)
    writer.close()
    if writer.failed:
        count, end = writer.kept
        warn.warning("recording stopped: %s; kept %d messages to %.3f s", writer.failed, count, end)


def write_messages(log: Log, writer: BagWriter) -> None:
    """Write the messages of a log, tick by tick, with the bytes that the nodes would publish."""
    robot = log.experiment.plant
    table, encode = _of_legs(robot) if log.experiment.gait else _of_joints(log, robot)
    by_topic, every = encoders(robot), {}
    # Standard messages at their own rates; without a gait the first two are in every tick already.
    for name in VIEWED if log.experiment.gait else VIEWED[-2:]:
        encode[name] = lambda row, pack=by_topic[name]: pack(row["state"], row["truth"])
        rate = table[name].rate or 1.0 / log.dt
        every[name] = max(1, round(1.0 / (log.dt * rate)))
    paths = {name: name if name.startswith("/") else f"/{name}" for name in (*encode, DESCRIPTION)}
    for name, path in paths.items():
        writer.add_row(path, table[name])
    text = Codec(message_class(table[DESCRIPTION].kind)(data=robot.urdf)).template
    writer.write(paths[DESCRIPTION], text, 0)
    parts = [part for part in PARTS if log.experiment.gait or part not in ("stance", "trunk")]
    for row, t in enumerate(log.t.tolist()):
        messages = {part: log.message(part, row) for part in parts}
        for name, pack in encode.items():
            if row % every.get(name, 1) == 0:
                writer.write(paths[name], pack(messages), round(t * 1e9))


def _of_legs(robot: Any) -> tuple[dict[str, Any], dict[str, Encode]]:
    """Topic table of a legged robot, and the encoder of each topic."""
    encode_truth = encoders(robot)[TRUTH]
    encode: dict[str, Encode] = {TRUTH: lambda row: encode_truth(row["state"], row["truth"])}
    for part, name in TOPIC_OF.items():
        pack = Converter(PARTS[part]).pack
        encode[name] = lambda row, pack=pack, part=part: pack(row[part])
    return TOPICS, encode


def _of_joints(log: Log, robot: Any) -> tuple[dict[str, Any], dict[str, Encode]]:
    """Topic table of a robot without legs, and the encoder of each topic."""
    driven = [robot.joints[i] for i in robot.driven]
    by_topic, encode = encoders(robot), {}
    for name in ("joint_states", "imu/data", TRUTH):
        encode[name] = lambda row, pack=by_topic[name]: pack(row["state"], row["truth"])
    for part in ("target", "command"):
        pack = JointCodec(driven, f"joint_{part}", _FIELDS).pack
        encode[f"joint_{part}"] = lambda row, pack=pack, part=part: pack(
            row[part].t, row[part].q, row[part].dq
        )
    if log.experiment.learner.enabled:
        pack = JointCodec(driven, "joint_prediction", _FIELDS[:1]).pack
        encode["joint_prediction"] = lambda row, pack=pack: pack(
            row["learning"].t, row["learning"].prediction[: len(driven)]
        )
    return JOINT_TOPICS, encode


def _attach(log: Log, writer: BagWriter) -> None:
    """Attach the experiment and trained weights to the bag; write the experiment beside it."""
    folder = writer.folder
    text = yaml.safe_dump(to_dict(log.experiment), sort_keys=False)
    (folder / "experiment.yaml").write_text(text)
    writer.attach("experiment.yaml", text.encode())
    weights = folder / "weights.npz"
    if weights.is_file():
        writer.attach("weights.npz", weights.read_bytes(), "application/octet-stream")
