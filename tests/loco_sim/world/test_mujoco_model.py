# SPDX-License-Identifier: Apache-2.0
"""Lowest points of shapes: no vertex is lower, whatever the shape and its attitude."""

import mujoco
import numpy as np
import pytest

from loco_sim.world.mujoco_model import lowest_point

SHAPES = {
    "sphere": ("0.2", lambda p: np.linalg.norm(p, axis=1) <= 0.2),
    "box": ("0.1 0.2 0.3", lambda p: (np.abs(p) <= [0.1, 0.2, 0.3]).all(axis=1)),
    "cylinder": ("0.2 0.3", lambda p: (np.hypot(p[:, 0], p[:, 1]) <= 0.2) & (abs(p[:, 2]) <= 0.3)),
    "capsule": (
        "0.1 0.3",
        lambda p: np.linalg.norm(p - [0, 0, 1] * np.clip(p[:, 2:], -0.3, 0.3), axis=1) <= 0.1,
    ),
    "ellipsoid": ("0.1 0.2 0.3", lambda p: ((p / [0.1, 0.2, 0.3]) ** 2).sum(axis=1) <= 1.0),
}


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_no_point_of_a_shape_is_lower(kind, seed):
    size, inside = SHAPES[kind]
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=4)
    quat = " ".join(map(str, turn / np.linalg.norm(turn)))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="{kind}" size="{size}" pos="1 2 3" quat="{quat}"/>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    point = np.array(lowest_point(model, data, 0))
    matrix = data.geom_xmat[0].reshape(3, 3)
    drawn = rng.uniform(-0.45, 0.45, (200_000, 3))
    drawn = drawn[inside(drawn)]
    lowest = (drawn @ matrix.T)[:, 2].min() + 3.0
    assert lowest - 0.03 < point[2] <= lowest  # as low as any, and no lower than its surface
    own = (point - [1.0, 2.0, 3.0]) @ matrix
    assert inside(own[None] * (1.0 - 1e-9))[0] and not inside(own[None] * 1.01)[0]
