# SPDX-License-Identifier: Apache-2.0
"""Links carried by links end where the forward kinematics puts them."""

import numpy as np
import pytest

from loco_sim.geometry import rotation_matrix
from loco_sim.robot import robot as robots
from loco_sim.robot.frames import link_frames
from loco_sim.ros.skeleton import Skeleton


def whole(skeleton, pose):
    """Rotation and origin of every link in the base frame, from a chain of transforms."""
    frames, rows = (
        {skeleton.base: (np.eye(3), np.zeros(3))},
        list(zip(skeleton.links, pose, strict=True)),
    )
    while rows:
        (parent, child), row = rows.pop(0)
        if parent not in frames:
            rows.append(((parent, child), row))
            continue
        turn, origin = frames[parent]
        own = np.array(rotation_matrix(row[3:])).reshape(3, 3)
        frames[child] = turn @ own, origin + turn @ row[:3]
    return frames


@pytest.mark.parametrize("name", robots.names())
def test_links_are_where_the_kinematics_puts_them(name):
    robot = robots.load(name)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, len(robot.joints))
    skeleton = Skeleton(robot)
    wanted = link_frames(robot, q[None])
    frames = whole(skeleton, skeleton.pose(q))
    assert set(frames) == set(wanted)
    for link, (turn, origin) in frames.items():
        np.testing.assert_allclose(turn, wanted[link][0][0], atol=1e-12)
        np.testing.assert_allclose(origin, wanted[link][1][0], atol=1e-12)


def test_a_robot_without_joints_has_no_transforms():
    class Stone:
        urdf, joints = '<robot name="s"><link name="stone"/></robot>', ()

    assert Skeleton(Stone).pose(np.zeros(0)).shape == (0, 7)
    assert Skeleton(Stone).base == "stone"
