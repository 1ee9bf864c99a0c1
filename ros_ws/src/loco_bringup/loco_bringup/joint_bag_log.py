# SPDX-License-Identifier: Apache-2.0
"""A bag of standard messages as the `JointLog` that metrics and figures work on."""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np
import yaml
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from loco_control.exceptions import BagError, NameUnknownError
from loco_control.ros.joint_codec import ImuReader, JointCodec
from loco_learning.joint_experiment import JointExperiment, from_values
from loco_learning.joint_log import JointLog, empty
from loco_learning.schedule import TRAIN, Schedule

from .bag import Bag
from .bag_log import fall_of, truth_at

NEEDED = ("joint_states", "joint_target", "joint_command")
_TRUTH, _IMU, _PREDICTION = "ground_truth/odom", "imu/data", "joint_prediction"


def is_joint(bag: Bag) -> bool:
    """The bag is a run of a joint robot: its experiment says so, or its topics do."""
    if "experiment.yaml" in bag.attachments():
        return _values(bag).get("kind") == "joint"
    names = {name.rsplit("/", 1)[-1] for name, topic in bag.topics.items() if topic.count}
    return "robot_state" not in names and set(NEEDED) <= names


def read_joint_log(bag: Bag, namespace: str = "") -> JointLog:
    """Log of a recorded run: the ticks at which states, targets and commands have one stamp.

    Without IMU or ground truth in the bag those columns are NaN, and so is a prediction
    that was never said; contacts are no standard message and stay empty.

    Args:
        bag: The recording.
        namespace: Of the robot, in a bag of several.

    Raises:
        BagError: A topic is missing, or the topics share no stamp.
        NameUnknownError: Several robots are in the bag and `namespace` is not one of them.
    """
    experiment = from_values(_values(bag))
    plant, topics = experiment.plant, _Topics(bag, namespace)
    driven = tuple(plant.joints[i] for i in plant.driven)
    needed = [topics.joints(n, plant.joints if n == NEEDED[0] else driven) for n in NEEDED]
    times = reduce(np.intersect1d, [series.time for series in needed])
    if not len(times):
        raise BagError(f"{bag.path}: {', '.join(NEEDED)} have no stamp in common")
    state, target, command = (series.at(times) for series in needed)
    columns = empty(experiment, len(times))
    columns |= {"t": times / 1e9, "q": state[0], "dq": state[1], "tau": state[2]}
    columns |= {"target": target[0], "target_dq": target[1]}
    columns |= {"command": command[0], "command_dq": command[1]}
    columns |= _truth(topics, columns["t"]) | _imu(topics, times)
    columns |= _learning(experiment, topics, driven, times, columns)
    fall = fall_of(bag, topics.full("events") if topics.has("events") else "events")
    return JointLog(columns, experiment, experiment.seed, fall)


def _values(bag: Bag) -> dict:
    values = yaml.safe_load(bag.attachment("experiment.yaml"))
    return values if isinstance(values, dict) else {}


class _Series(NamedTuple):
    """A topic: stamps [ns], ascending, (T,), and arrays with a row per stamp."""

    time: np.ndarray
    values: tuple[np.ndarray, ...]

    def at(self, times: np.ndarray) -> list[np.ndarray]:
        """Rows at given stamps; NaN where the topic has none."""
        row = np.searchsorted(self.time, times).clip(max=len(self.time) - 1)
        known = self.time[row] == times
        return [np.where(known[:, None], value[row], np.nan) for value in self.values]


class _Topics:
    """Topics of one robot in a bag."""

    def __init__(self, bag: Bag, namespace: str):
        self.bag, self._prefix = bag, namespace.strip("/")

    def full(self, name: str) -> str:
        """Recorded name."""
        return self.bag.resolve(f"/{self._prefix}/{name}" if self._prefix else name)

    def has(self, name: str) -> bool:
        """The bag has messages of this topic."""
        try:
            return self.bag.topics[self.full(name)].count > 0
        except NameUnknownError:
            return False

    def joints(self, name: str, names: tuple[str, ...]) -> _Series:
        """Positions, velocities and efforts of a JointState topic, each (T, len(names))."""
        if not any(n.endswith("/" + name) and t.count for n, t in self.bag.topics.items()):
            raise BagError(
                f"{self.bag.path} has no messages on {name}; a run of joints needs "
                f"{', '.join(NEEDED)}"
            )
        data = self.bag.raw(self.full(name))[1]
        first = deserialize_message(data[0], JointState)
        fields = [f for f in ("position", "velocity", "effort") if len(getattr(first, f))]
        codec = JointCodec(names, name, fields, first.header.frame_id)
        return _series([codec.read(d) for d in data])

    def imu(self) -> _Series:
        """Orientation, turning rate and specific force."""
        data = self.bag.raw(self.full(_IMU))[1]
        reader = ImuReader()
        return _series([reader.read(d) for d in data])


def _series(rows: list[tuple]) -> _Series:
    time, *values = zip(*rows, strict=True)
    time, first = np.unique(np.array(time, dtype=np.int64), return_index=True)
    return _Series(time, tuple(np.array(value)[first] for value in values))


def _truth(topics: _Topics, t: np.ndarray) -> dict[str, np.ndarray]:
    name = topics.full(_TRUTH) if topics.has(_TRUTH) else ""
    truth = truth_at(topics.bag.records(name) if name else None, t)
    return {
        "position": truth.position,
        "orientation": truth.orientation,
        "velocity": truth.linear_velocity,
        "spin": truth.angular_velocity,
    }


def _imu(topics: _Topics, times: np.ndarray) -> dict[str, np.ndarray]:
    names = ("imu_orientation", "gyro", "acceleration")
    if not topics.has(_IMU):
        return {
            name: np.full((len(times), k), np.nan) for name, k in zip(names, (4, 3, 3), strict=True)
        }
    return dict(zip(names, topics.imu().at(times), strict=True))


def _learning(
    experiment: JointExperiment,
    topics: _Topics,
    driven: tuple[str, ...],
    times: np.ndarray,
    columns: dict[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Phase by the schedule, prediction as it was said, and how far it was off."""
    if not experiment.learner.enabled:
        return {"phase": np.full(len(times), TRAIN)}
    schedule = Schedule(experiment.learner, experiment.dt)
    phase = np.array([schedule.phase_at(t) for t in columns["t"].tolist()])
    prediction = np.full(columns["target"].shape, np.nan)
    if topics.has(_PREDICTION):
        prediction = topics.joints(_PREDICTION, driven).at(times)[0]
    error = np.sqrt(np.mean((prediction - columns["target"]) ** 2, axis=1))
    return {"phase": phase, "prediction": prediction, "error": error}
