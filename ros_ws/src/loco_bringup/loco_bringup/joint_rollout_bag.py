# SPDX-License-Identifier: Apache-2.0
"""A rollout of a joint robot without ROS, written as the same topics with the same bytes."""

from __future__ import annotations

from typing import Any

from loco_control.ros.joint_codec import JointCodec
from loco_control.ros.joint_topics import JOINT_TOPICS
from loco_control.types import GroundTruth, RobotState
from loco_learning.joint_log import JointLog
from loco_sim.ros.tools import encoders

from .bag_writer import BagWriter

SENSED = ("joint_states", "imu/data", "ground_truth/odom")
SAID = {  # topic: the columns of the log that it carries
    "joint_target": ("target", "target_dq"),
    "joint_command": ("command", "command_dq"),
    "joint_prediction": ("prediction",),
}
_FIELDS = ("position", "velocity")


def write_log(log: JointLog, writer: BagWriter) -> None:
    """Write the messages of a log, tick by tick, with the bytes that the nodes would publish."""
    robot = log.experiment.plant
    said = dict(SAID)
    if not log.experiment.learner.enabled:
        del said["joint_prediction"]
    driven = [robot.joints[i] for i in robot.driven]
    packs = {
        name: JointCodec(driven, name, _FIELDS[: len(columns)]).pack
        for name, columns in said.items()
    }
    encode = {name: made for name, made in encoders(robot.joints).items() if name in SENSED}
    for name in (*SENSED, *said):
        writer.add_row("/" + name, JOINT_TOPICS[name])
    for tick, t in enumerate(log.t.tolist()):
        stamp = round(t * 1e9)
        state, truth = _state(log, tick), _truth(log, tick)
        for name, pack in encode.items():
            writer.write("/" + name, pack(state, truth), stamp)
        for name, columns in said.items():
            values = [log.columns[column][tick] for column in columns]
            writer.write("/" + name, packs[name](t, *values), stamp)


def _state(log: JointLog, tick: int) -> RobotState:
    c: dict[str, Any] = log.columns
    return RobotState(
        tick=tick,
        t=float(c["t"][tick]),
        q=c["q"][tick],
        dq=c["dq"][tick],
        tau=c["tau"][tick],
        grf=c["contact"][tick],  # not in these messages
        orientation=c["imu_orientation"][tick],
        angular_velocity=c["gyro"][tick],
        linear_acceleration=c["acceleration"][tick],
        contact=c["contact"][tick],
    )


def _truth(log: JointLog, tick: int) -> GroundTruth:
    c = log.columns
    rows = (c[name][tick] for name in ("position", "orientation", "velocity", "spin"))
    return GroundTruth(tick, float(c["t"][tick]), *rows)


def ending(log: JointLog) -> str:
    """How a rollout ended, in the words of the plant node."""
    from loco_sim.ros.joint_sim_node import ending as words

    length = len(log) * log.dt
    if log.fall:
        return f"fell at {length:.2f} s: {log.fall}"
    return words(length, None if log.experiment.plant.fixed_base else log.distance)
