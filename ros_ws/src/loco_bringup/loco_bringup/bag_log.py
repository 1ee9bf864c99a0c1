# SPDX-License-Identifier: Apache-2.0
"""A bag as the `Log` that metrics and figures work on."""

from __future__ import annotations

import dataclasses

import numpy as np
import yaml

from loco_control.exceptions import BagError
from loco_control.ros.convert import SHAPES
from loco_control.types import GroundTruth
from loco_learning.experiment import from_values
from loco_learning.log import PARTS, Log

from .bag import Bag
from .rollout_bag import TOPIC_OF

_TRUTH = "ground_truth/odom"


def read_log(bag: Bag) -> Log:
    """Log of a recorded run: the ticks that every control topic has.

    Raises:
        BagError: A control topic is missing, or the topics share no tick.
    """
    missing = [name for name in TOPIC_OF.values() if not _recorded(bag, name)]
    if missing:
        raise BagError(f"{bag.path} has no messages on {', '.join(missing)}; it is no run of loco")
    truth = [_TRUTH] if any(n.endswith(_TRUTH) and t.count for n, t in bag.topics.items()) else []
    read = bag.records_of([*TOPIC_OF.values(), *truth])
    records = {part: read[name] for part, name in TOPIC_OF.items()}
    ticks = set.intersection(*(set(r["tick"].tolist()) for r in records.values()))
    if not ticks:
        raise BagError(f"{bag.path}: the control topics have no tick in common")
    parts = {part: _stack(part, _chosen(r, ticks)) for part, r in records.items()}
    experiment = from_values(yaml.safe_load(bag.attachment("experiment.yaml")))
    return Log(
        **parts,
        truth=truth_at(read.get(_TRUTH), parts["state"].t),
        experiment=experiment,
        seed=experiment.seed,
        fall=fall_of(bag),
    )


def _recorded(bag: Bag, name: str) -> bool:
    found = [t for t in bag.topics.values() if t.name.rsplit("/", 1)[-1] == name]
    return bool(found) and found[0].count > 0


def _chosen(records: np.ndarray, ticks: set[int]) -> np.ndarray:
    """One record per tick, in tick order."""
    _, first = np.unique(records["tick"], return_index=True)
    records = records[first]
    return records[np.isin(records["tick"], list(ticks))]


def _stack(part: str, records: np.ndarray):
    cls = PARTS[part]
    values = {"tick": records["tick"].astype(np.int64), "t": seconds(records, "stamp")}
    for f in dataclasses.fields(cls):
        if f.name not in values:
            column = np.ascontiguousarray(records[f.name])
            values[f.name] = column.reshape(-1, *SHAPES[f.name]) if f.name in SHAPES else column
    return cls(**values)


def seconds(records: np.ndarray, path: str) -> np.ndarray:
    """Times of a stamp field [s], shape (n,)."""
    whole = records[path + ".sec"].astype(np.int64) * 1_000_000_000
    return (whole + records[path + ".nanosec"]) / 1e9


def truth_at(odometry: np.ndarray | None, t: np.ndarray) -> GroundTruth:
    """Ground truth at the times of the states; NaN where the bag has none."""
    n = len(t)
    truth = GroundTruth(np.arange(n), t, *(np.full((n, k), np.nan) for k in (3, 4, 3, 3)))
    if odometry is None:
        return truth
    times = seconds(odometry, "header.stamp")
    row = np.searchsorted(times, t - 1e-6).clip(max=len(times) - 1)
    fits = np.abs(times[row] - t) < 1e-6
    for field, path, axes in (
        ("position", "pose.pose.position", "xyz"),
        ("orientation", "pose.pose.orientation", "xyzw"),
        ("linear_velocity", "twist.twist.linear", "xyz"),
        ("angular_velocity", "twist.twist.angular", "xyz"),
    ):
        columns = np.stack([odometry[f"{path}.{axis}"] for axis in axes], axis=1)
        getattr(truth, field)[fits] = columns[row[fits]]
    return truth


def fall_of(bag: Bag, topic: str = "events") -> str:
    """Why the robot of a bag fell; empty if it did not. Robots in namespaces have each a topic."""
    if not any(name.rsplit("/", 1)[-1] == "events" for name in bag.topics):
        return bag.metadata.get("fall", "")
    return next((e.text for e in bag.messages(topic) if e.kind == "fall"), "")
