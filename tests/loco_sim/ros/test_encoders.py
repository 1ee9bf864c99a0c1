# SPDX-License-Identifier: Apache-2.0
"""Frames of /tf: one tree from odom on with every link of the URDF, as viewers need it."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.ros.messages.plain import deserialize, message_class
from loco_sim.robot import robot as robots
from loco_sim.ros.encoders import encoders


def frames(robot, q, t=1.25):
    state = SimpleNamespace(t=t, q=q)
    truth = SimpleNamespace(position=[1.0, 2.0, 0.5], orientation=[0.0, 0.0, 0.6, 0.8])
    data = encoders(robot)["/tf"](state, truth)
    return deserialize(data, message_class("tf2_msgs/msg/TFMessage")).transforms


@pytest.mark.parametrize("name", robots.names())
def test_frames_are_one_tree_with_every_link(name):
    robot = robots.load(name)
    said = frames(robot, np.linspace(-0.5, 0.5, len(robot.joints)))
    parents = {f.child_frame_id: f.header.frame_id for f in said}
    assert len(parents) == len(said)  # no link has two parents
    links = set(re.findall(r'<link name="([^"]+)"', robot.urdf))
    assert set(parents) == links | {"base_link"}
    for link in parents:
        while link != "odom":
            link = parents[link]
    assert {(f.header.stamp.sec, f.header.stamp.nanosec) for f in said} == {(1, 250_000_000)}
    for f in said:
        turn = f.transform.rotation
        assert turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2 == pytest.approx(1.0)


def test_a_knee_that_bends_moves_the_shank():
    robot = robots.load("hyq")
    q = np.zeros(12)
    before = {f.child_frame_id: f.transform.rotation for f in frames(robot, q)}
    q[robot.joints.index("lf_kfe_joint")] = -1.0
    after = {f.child_frame_id: f.transform.rotation for f in frames(robot, q)}
    moved = {n for n in before if repr(before[n]) != repr(after[n])}
    assert moved == {"lf_lowerleg"}


def test_the_base_is_where_the_ground_truth_says():
    robot = robots.load("pendulum")
    base = frames(robot, np.zeros(1))[0]
    assert (base.header.frame_id, base.child_frame_id) == ("odom", "base_link")
    place = base.transform.translation
    assert (place.x, place.y, place.z) == (1.0, 2.0, 0.5)
