# SPDX-License-Identifier: Apache-2.0
"""Read a bag as `Recording` for a calibration, by the topics that `loco gap` reads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from loco_control.exceptions import ParameterError
from loco_learning.calibration.recording import Recording, align
from loco_learning.gap.recordings.tracks import Track
from loco_sim.robot.robot import Robot

from ..bag.foreign.opening import open_bag
from ..bag.reader import Bag
from ..gap import topics


def read_recording(
    bag: Bag | str | Path, rate: float, robot: Robot, namespace: str = ""
) -> Recording:
    """Commands and joint angles of a recorded robot.

    Args:
        bag: Bag folder or file of any recorder, with the topics of a graph of loco.
        rate: Samples per second of the result.
        robot: Measured robot.
        namespace: Namespace of the robot, if several robots in the bag have its joints.

    Raises:
        MissingFileError: There is no such bag.
        BagError: The bag lacks a topic, or the topic's messages cannot be used.
        ParameterError: States and commands do not match.
    """
    bag = bag if isinstance(bag, Bag) else open_bag(bag)
    tracks, _ = topics.read(bag, robot, namespace, base_pose=False)
    driven = [robot.joints[i] for i in robot.driven]
    states = _columns(bag, tracks, "q", robot.joints)
    commands = _columns(bag, tracks, "command_position", driven)
    extra = {}
    for name, role, places in (
        ("velocity", "command_velocity", commands[2]),
        ("torque", "command_torque", list(robot.joints)),
        ("stance", "stance", list(robot.feet)),
    ):
        if any(track.role == role for track in tracks):
            t, x, names = _columns(bag, tracks, role, places)
            row = np.searchsorted(t, commands[0], side="right") - 1
            extra[name] = np.zeros((len(row), len(places)))
            extra[name][:, [places.index(n) for n in names]] = x[np.maximum(row, 0)]
    return align(bag.folder.name, states, commands, rate, extra)


def _columns(
    bag: Bag, tracks: Sequence[Track], role: str, places: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stamps [s], values (T, places), and the places with a signal of a role.

    Raises:
        ParameterError: There is none, or their stamps differ.
    """
    by_place = {track.place: track for track in tracks if track.role == role}
    names = [place for place in places if place in by_place]
    first = by_place[names[0]] if names else None
    if first is None or any(not np.array_equal(by_place[n].t, first.t) for n in names):
        raise ParameterError(
            f"{bag.path.name}: a calibration needs {role} of {', '.join(places)} in the same "
            f"messages; it has {', '.join(names) or 'none'}"
        )
    order = np.argsort(first.t, kind="stable")
    return first.t[order], np.stack([by_place[n].x[order] for n in names], axis=1), names
