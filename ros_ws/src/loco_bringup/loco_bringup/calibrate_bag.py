# SPDX-License-Identifier: Apache-2.0
"""A bag of standard messages as the `Recording` that a calibration works on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError
from loco_learning.calibration.recording import Recording, align

from .bag import Bag

STATES, COMMANDS = "joint_states", "joint_command"
TYPE = "sensor_msgs/msg/JointState"


def read_recording(bag: Bag | str | Path, rate: float, namespace: str = "") -> Recording:
    """Commands and joint angles of a recorded robot.

    Args:
        bag: Bag folder or ``.mcap`` file with `STATES` and `COMMANDS`.
        rate: Samples per second of the result.
        namespace: Of the robot, where the bag holds several.

    Raises:
        MissingFileError: There is no such bag.
        BagError: It lacks a topic or the topic's messages are not of use.
        ParameterError: States and commands do not fit together.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    names = _topics(bag, namespace)
    return align(bag.folder.name, *(_joints(bag, name) for name in names), rate)


def _topics(bag: Bag, namespace: str) -> list[str]:
    """Recorded names of the two topics."""
    prefix = f"/{namespace.strip('/')}/" if namespace else ""
    found, missing = [], []
    for topic in (STATES, COMMANDS):
        try:
            found.append(bag.resolve(prefix + topic))
        except NameUnknownError:
            missing.append(prefix + topic)
    if missing:
        several = [n for n in bag.topics if n.rsplit("/", 1)[-1] == missing[0].rsplit("/", 1)[-1]]
        hint = " (name one robot by its namespace)" if len(several) > 1 else ""
        raise BagError(
            f"{bag.path.name} has no topic {' and no topic '.join(missing)}{hint}; a calibration "
            f"needs {STATES} and {COMMANDS}; it has {', '.join(sorted(bag.topics)) or 'none'}"
        )
    for name in found:
        info = bag.topics[name]
        if info.type != TYPE or not info.count:
            raise BagError(f"{bag.path.name}: {name} has {info.count} messages of {info.type}, "
                           f"wanted are some of {TYPE}")  # fmt: skip
    return found


def _joints(bag: Bag, topic: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stamps [s], positions [rad] and joint names of a topic, in the order of the stamps."""
    messages = bag.messages(topic)
    names = list(messages[0].name)
    for message in messages:
        if list(message.name) != names or len(message.position) != len(names):
            raise BagError(
                f"{bag.path.name}: messages of {topic} differ in their joints, or lack positions"
            )
    t = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    q = np.array([m.position for m in messages], dtype=float)
    order = np.argsort(t, kind="stable")
    return t[order], q[order], names
