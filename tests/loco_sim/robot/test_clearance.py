# SPDX-License-Identifier: Apache-2.0
"""A bolted robot is above the ground in all poses if the bound of its clearance says so."""

import numpy as np
import pytest

from loco_sim.meshes import solids
from loco_sim.robot.clearance import base_height, clearance
from loco_sim.robot.description import Description
from loco_sim.robot.urdf_check import SIZES

SOLIDS = {
    "box": ('size="0.1 0.2 0.5"', solids.box((0.1, 0.2, 0.5))),
    "sphere": ('radius="0.2"', solids.capsule(0.2)),
    "cylinder": ('radius="0.1" length="0.6"', solids.cylinder(0.1, 0.6)),
    "capsule": ('radius="0.1" length="0.6"', solids.capsule(0.1, 0.6)),
}


@pytest.mark.parametrize("shape", sorted(set(SIZES) - {"mesh"}))
def test_every_shape_of_a_urdf_has_a_bound_that_none_of_its_poses_is_below(shape, tmp_path):
    """Without one a robot is simulated by the engine, and its set-up is not tested."""
    size, triangles = SOLIDS[shape]
    robot = Description(
        '<robot name="r"><link name="base"/><link name="rod"><collision>'
        f'<origin xyz="0 0 -0.3"/><geometry><{shape} {size}/></geometry></collision></link>'
        '<joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/>'
        '<axis xyz="1 0 0"/></joint></robot>'
    )
    bound = clearance(robot, 1.0, tmp_path)
    reach = np.linalg.norm((triangles.reshape(-1, 3) + (0.0, 0.0, -0.3))[:, 1:], axis=1).max()
    assert -np.inf < bound <= 1.0 - reach + 1e-12
    assert base_height(robot, tmp_path) >= reach
