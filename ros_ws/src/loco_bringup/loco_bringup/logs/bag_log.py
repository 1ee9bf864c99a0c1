# SPDX-License-Identifier: Apache-2.0
"""Read a bag as a `Log`, the input of metrics and figures."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError
from loco_control.ros.messages.convert import SHAPES
from loco_control.ros.messages.joint_codec import ImuReader, JointCodec
from loco_learning.reflex.schedule import CLOSING, TRAIN, Schedule
from loco_learning.runs.experiment import Experiment, from_values
from loco_learning.runs.log import Log, columns_of, empty

from ..bag.reader import Bag, seconds

TOPIC_OF = {  # topics of a legged robot by part of the log, in the order within a tick
    "state": "robot_state",
    "target": "gait_target",
    "command": "motion_command",
    "learning": "learning_state",
    "stance": "stance",
    "trunk": "trunk_torque",
}
JOINT_TOPICS = ("joint_states", "joint_target", "joint_command")  # topics of a robot without legs
TRUTH = "ground_truth/odom"
_IMU, _PREDICTION = "imu/data", "joint_prediction"
_TRUTH = {  # column: field of `TRUTH` and its components
    "position": ("pose.pose.position", "xyz"),
    "orientation": ("pose.pose.orientation", "xyzw"),
    "velocity": ("twist.twist.linear", "xyz"),
    "spin": ("twist.twist.angular", "xyz"),
}


def read_log(bag: Bag, namespace: str = "") -> Log:
    """Log of a recorded run, at the ticks that are present in every control topic.

    Columns of a missing IMU, ground truth or prediction are NaN. The log of a robot without
    legs lacks forces and contacts, which are in no standard message.

    Args:
        bag: The recording.
        namespace: Namespace of the robot, in a bag of several robots.

    Raises:
        BagError: A control topic is missing, or the topics share no tick.
        NameUnknownError: Several robots are in the bag and `namespace` is not one of them.
    """
    if "experiment.yaml" not in bag.attachments():
        _need(bag, TOPIC_OF.values())
    values = bag.yaml("experiment.yaml")
    experiment = from_values(values if isinstance(values, dict) else {})
    if experiment.gait:
        return _walking(bag, experiment)
    return _jointed(bag, experiment, namespace)


def _need(bag: Bag, names: Iterable[str]) -> None:
    recorded = {n.rsplit("/", 1)[-1] for n, topic in bag.topics.items() if topic.count}
    missing = [name for name in names if name not in recorded]
    if missing:
        text = f"{bag.path} has no messages on {', '.join(missing)}; it is no run of loco"
        raise BagError(
            f"{text} (`loco report`, `compare`, `gap check` read what other programs recorded)"
        )


def _walking(bag: Bag, experiment: Experiment) -> Log:
    """Log from the messages of `TOPIC_OF`, which contain their tick numbers."""
    _need(bag, TOPIC_OF.values())
    truth_topics = (
        [TRUTH] if any(n.endswith(TRUTH) and t.count for n, t in bag.topics.items()) else []
    )
    read = bag.records_of([*TOPIC_OF.values(), *truth_topics])
    records = {part: read[name] for part, name in TOPIC_OF.items()}
    ticks = set.intersection(*(set(r["tick"].tolist()) for r in records.values()))
    if not ticks:
        raise BagError(f"{bag.path}: the control topics have no tick in common")
    records = {part: _select(r, ticks) for part, r in records.items()}
    columns = {"t": seconds(records["state"], "stamp")}
    for name, column in columns_of(experiment).items():
        if column.part in records and name != "t":
            values = np.ascontiguousarray(records[column.part][column.field])
            if column.field in SHAPES:
                values = values.reshape(-1, *SHAPES[column.field])
            columns[name] = values.astype(column.kind, copy=False)
    columns |= _truth_columns(read.get(TRUTH), columns["t"])
    return Log(columns, experiment, experiment.seed, fall_of(bag))


def _select(records: np.ndarray, ticks: set[int]) -> np.ndarray:
    """One record per tick, in tick order."""
    _, first = np.unique(records["tick"], return_index=True)
    records = records[first]
    return records[np.isin(records["tick"], list(ticks))]


def _truth_columns(odometry: np.ndarray | None, t: np.ndarray) -> dict[str, np.ndarray]:
    """Ground truth at the times of the states; NaN if the bag has none."""
    columns = {name: np.full((len(t), len(axes)), np.nan) for name, (_, axes) in _TRUTH.items()}
    if odometry is not None:
        times = seconds(odometry, "header.stamp")
        row = np.searchsorted(times, t - 1e-6).clip(max=len(times) - 1)
        fits = np.abs(times[row] - t) < 1e-6
        for name, (path, axes) in _TRUTH.items():
            values = np.stack([odometry[f"{path}.{axis}"] for axis in axes], axis=1)
            columns[name][fits] = values[row[fits]]
    return columns


def fall_of(bag: Bag, topic: str = "events") -> str:
    """Reason for the fall of a robot; empty if it did not fall. Each robot has its own topic."""
    if not any(name.rsplit("/", 1)[-1] == "events" for name in bag.topics):
        return bag.metadata.get("fall", "")
    return next((e.text for e in bag.messages(topic) if e.kind == "fall"), "")


# ---- standard messages, joined by their stamps ------------------------------------------


def _jointed(bag: Bag, experiment: Experiment, namespace: str) -> Log:
    """Log at the ticks at which states, targets and commands have the same stamp."""
    plant, topics = experiment.plant, _Topics(bag, namespace)
    driven = tuple(plant.joints[i] for i in plant.driven)
    names = (plant.joints, driven, driven)
    needed = [topics.joints(n, names[i]) for i, n in enumerate(JOINT_TOPICS)]
    times = reduce(np.intersect1d, [series.time for series in needed])
    if not len(times):
        raise BagError(f"{bag.path}: {', '.join(JOINT_TOPICS)} have no stamp in common")
    state, target, command = (series.at(times) for series in needed)
    columns = empty(experiment, len(times))
    for name in ("grf", "contact"):
        del columns[name]
    columns |= {"t": times / 1e9, "q": state[0], "dq": state[1], "tau": state[2]}
    columns |= {"target": target[0], "target_dq": target[1]}
    columns |= {"command": command[0], "command_dq": command[1]}
    odometry = topics.bag.records(topics.full(TRUTH)) if topics.has(TRUTH) else None
    columns |= _truth_columns(odometry, columns["t"]) | _imu(topics, times)
    columns |= _learning(experiment, topics, driven, times, columns)
    fall_reason = fall_of(bag, topics.full("events") if topics.has("events") else "events")
    return Log(columns, experiment, experiment.seed, fall_reason)


class _Series(NamedTuple):
    """A topic: ascending stamps [ns], (T,), and arrays with one row per stamp."""

    time: np.ndarray
    values: tuple[np.ndarray, ...]

    def at(self, times: np.ndarray) -> list[np.ndarray]:
        """Rows at the given stamps; NaN for stamps that the topic lacks."""
        row = np.searchsorted(self.time, times).clip(max=len(self.time) - 1)
        exact = self.time[row] == times
        return [np.where(exact[:, None], value[row], np.nan) for value in self.values]


class _Topics:
    """Topics of one robot in a bag."""

    def __init__(self, bag: Bag, namespace: str):
        self.bag, self._prefix = bag, namespace.strip("/")

    def full(self, name: str) -> str:
        """Recorded name of a topic."""
        return self.bag.resolve(f"/{self._prefix}/{name}" if self._prefix else name)

    def has(self, name: str) -> bool:
        """Whether the bag has messages of this topic."""
        try:
            return self.bag.topics[self.full(name)].count > 0
        except NameUnknownError:
            return False

    def joints(self, name: str, names: tuple[str, ...]) -> _Series:
        """Positions, velocities and efforts of a JointState topic, each (T, len(names))."""
        if not any(n.endswith("/" + name) and t.count for n, t in self.bag.topics.items()):
            raise BagError(
                f"{self.bag.path} has no messages on {name}; a run of joints needs "
                f"{', '.join(JOINT_TOPICS)}"
            )
        data = self.bag.raw(self.full(name))[1]
        first = self.bag.message(self.full(name), data[0])
        fields = [f for f in ("position", "velocity", "effort") if len(getattr(first, f))]
        codec = JointCodec(names, name, fields, first.header.frame_id)
        return _series([codec.read(d) for d in data])

    def imu(self) -> _Series:
        """Orientation, angular velocity and specific force."""
        data = self.bag.raw(self.full(_IMU))[1]
        reader = ImuReader()
        return _series([reader.read(d) for d in data])


def _series(rows: list[tuple]) -> _Series:
    time, *values = zip(*rows, strict=True)
    time, first = np.unique(np.array(time, dtype=np.int64), return_index=True)
    return _Series(time, tuple(np.array(value)[first] for value in values))


def _imu(topics: _Topics, times: np.ndarray) -> dict[str, np.ndarray]:
    names = ("imu_orientation", "gyro", "acceleration")
    if not topics.has(_IMU):
        return {
            name: np.full((len(times), k), np.nan) for name, k in zip(names, (4, 3, 3), strict=True)
        }
    return dict(zip(names, topics.imu().at(times), strict=True))


def _learning(
    experiment: Experiment,
    topics: _Topics,
    driven: tuple[str, ...],
    times: np.ndarray,
    columns: dict[str, np.ndarray],
) -> dict[str, np.ndarray]:
    """Scheduled learning phase, recorded prediction, and prediction error."""
    if not experiment.learner.enabled:
        return {"phase": np.full(len(times), TRAIN)}
    schedule = Schedule(experiment.learner, experiment.dt)
    phase = np.array([schedule.phase_at(t) for t in columns["t"].tolist()])
    positions = np.full(columns["target"].shape, np.nan)
    if topics.has(_PREDICTION):
        positions = topics.joints(_PREDICTION, driven).at(times)[0]
    error = np.sqrt(np.mean((positions - columns["target"]) ** 2, axis=1))
    # No message has the predicted velocities; while the readout drives, they equal the command.
    predicted = np.isfinite(positions) & (phase >= CLOSING)[:, None]
    velocities = np.where(predicted, columns["command_dq"], np.nan)
    prediction = np.concatenate((positions, velocities), axis=1)
    return {"phase": phase, "prediction": prediction, "error": error}
