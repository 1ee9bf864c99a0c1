# SPDX-License-Identifier: Apache-2.0
"""Read a bag (standard messages or those of the HyQ graph) as `Recording` for a calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError
from loco_learning.calibration.recording import Recording, align
from loco_sim.robot.robot import Robot

from ..bag.reader import Bag, seconds
from ..gap.topics import COMMAND, MOTION, ROBOT_STATE, STATES, TRUNK

TYPE = "sensor_msgs/msg/JointState"


def read_recording(
    bag: Bag | str | Path, rate: float, namespace: str = "", robot: Robot | None = None
) -> Recording:
    """Commands and joint angles of a recorded robot.

    Args:
        bag: Bag folder or ``.mcap`` file with `STATES` and `COMMAND`, or with `ROBOT_STATE` and
            `MOTION` of the HyQ graph.
        rate: Samples per second of the result.
        namespace: Namespace of the robot, if the bag has several robots.
        robot: Measured robot; needed for the HyQ graph, whose messages have no joint names.

    Raises:
        MissingFileError: There is no such bag.
        BagError: The bag lacks a topic, or the topic's messages cannot be used.
        ParameterError: States and commands do not match.
    """
    bag = bag if isinstance(bag, Bag) else Bag(bag)
    prefix = f"/{namespace.strip('/')}/" if namespace else "/"
    if robot is not None and {prefix + ROBOT_STATE, prefix + MOTION} <= bag.topics.keys():
        return _own_topics(bag, prefix, robot, rate)
    names = _topics(bag, namespace)
    return align(bag.folder.name, *(_joints(bag, name) for name in names), rate)


def _topics(bag: Bag, namespace: str) -> list[str]:
    """Recorded names of the state topic and the command topic."""
    prefix = f"/{namespace.strip('/')}/" if namespace else ""
    names, missing = [], []
    for topic in (STATES, COMMAND):
        try:
            names.append(bag.resolve(prefix + topic))
        except NameUnknownError:
            missing.append(prefix + topic)
    if missing:
        several = [n for n in bag.topics if n.rsplit("/", 1)[-1] == missing[0].rsplit("/", 1)[-1]]
        hint = " (name one robot by its namespace)" if len(several) > 1 else ""
        raise BagError(
            f"{bag.path.name} has no topic {' and no topic '.join(missing)}{hint}; a calibration "
            f"needs {STATES} and {COMMAND}; it has {', '.join(sorted(bag.topics)) or 'none'}"
        )
    for name in names:
        info = bag.topics[name]
        if info.type != TYPE or not info.count:
            raise BagError(f"{bag.path.name}: {name} has {info.count} messages of {info.type}, "
                           f"wanted are some of {TYPE}")  # fmt: skip
    return names


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


def _own_topics(bag: Bag, prefix: str, robot: Robot, rate: float) -> Recording:
    """Recording of the HyQ graph, joints in the robot's order.

    The command includes torque and stance of the trunk controller.
    """
    state, command = bag.records(prefix + ROBOT_STATE), bag.records(prefix + MOTION)
    count = len(robot.joints)
    if state["q"].shape[1] != count:
        raise BagError(
            f"{bag.path.name} has {state['q'].shape[1]} joints on {prefix}{ROBOT_STATE}, the robot "
            f"has {count}: another robot was measured (choose it with --robot)"
        )
    remaining = {"velocity": command["dq"]}
    if prefix + TRUNK in bag.topics:
        trunk = bag.records(prefix + TRUNK)
        row = np.searchsorted(seconds(trunk, "stamp"), seconds(command, "stamp"), side="right") - 1
        remaining |= {"torque": trunk["tau"][np.maximum(row, 0)]}
        remaining |= {"stance": trunk["stance"][np.maximum(row, 0)]}
    return align(
        bag.folder.name,
        (seconds(state, "stamp"), state["q"], robot.joints),
        (seconds(command, "stamp"), command["q"], robot.joints),
        rate,
        remaining,
    )
