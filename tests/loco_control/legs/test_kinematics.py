# SPDX-License-Identifier: Apache-2.0
"""Forward and inverse kinematics undo each other, and the conventions of the leg hold."""

import numpy as np
import pytest
from tests.quadrupeds import joint_limits, joint_velocity

from loco_control.exceptions import ParameterError
from loco_control.legs.geometry import (
    COLUMNS,
    HIP_X,
    HIP_Y,
    HIP_Z,
    HYQ,
    KNEE,
    LEFT,
    SIDE,
    SIGN,
    ZERO,
    LegGeometry,
)  # fmt: skip
from loco_control.legs.kinematics import (
    foot_position,
    inverse,
    jacobian,
    joint_position,
    turned_feet,
)
from loco_control.orientation import rotation_base_to_horizontal

LOW, HIGH = joint_limits()
HOME = np.array([-0.2, 0.75, -1.5] * 2 + [-0.2, -0.75, 1.5] * 2)  # of hyq-description


def postures(count=200):
    """Joint positions inside the limits with the feet well below the hips."""
    rng = np.random.default_rng(1)
    q = rng.uniform(LOW, HIGH, (count, 12))
    depth = np.array([-foot_position(row)[:, 2].max() for row in q])
    return q[depth > 0.2]


def test_home_pose_puts_the_feet_where_the_description_does():
    x, y, z = np.abs(foot_position(HOME)).T
    np.testing.assert_allclose(x, 0.367, atol=5e-4)
    np.testing.assert_allclose(y, 0.323, atol=5e-4)
    np.testing.assert_allclose(z, 0.574, atol=5e-4)


def test_legs_stretched_hang_straight_down():
    feet = foot_position(np.zeros(12))
    np.testing.assert_allclose(feet[:, 2], -(0.08 + 0.35 + 0.341), atol=1e-15)
    np.testing.assert_allclose(np.abs(feet[:, 0]), 0.3735)
    np.testing.assert_allclose(np.abs(feet[:, 1]), 0.207)


def test_negative_haa_moves_every_foot_outwards_and_positive_hfe_backwards():
    feet = foot_position(HOME)
    for joint, axis in ((0, 1), (1, 0)):
        moved = HOME.copy()
        moved[joint::3] += -0.1 if joint == 0 else 0.1
        change = foot_position(moved)[:, axis] - feet[:, axis]
        outwards = np.sign(feet[:, 1])
        np.testing.assert_array_equal(np.sign(change), outwards if joint == 0 else -np.ones(4))


def test_left_and_right_mirror_each_other():
    q = postures()[:, :3]
    feet = np.array([foot_position(np.tile(row, 4)) for row in q])
    np.testing.assert_allclose(feet[:, 0] * [1, -1, 1], feet[:, 1], atol=1e-15)
    np.testing.assert_allclose(feet[:, 2] * [1, -1, 1], feet[:, 3], atol=1e-15)


def test_inverse_of_forward_is_the_identity():
    for q in postures():
        np.testing.assert_allclose(joint_position(foot_position(q)), q, atol=1e-12)


def test_forward_of_inverse_is_the_identity():
    rng = np.random.default_rng(2)
    centre = foot_position(HOME)
    for _ in range(100):
        feet = centre + rng.uniform(-0.08, 0.06, (4, 3))
        np.testing.assert_allclose(foot_position(joint_position(feet)), feet, atol=1e-13)


def test_knees_point_to_each_other():
    knees = joint_position(foot_position(HOME))[2::3]
    np.testing.assert_array_equal(np.sign(knees), [-1, -1, 1, 1])


def test_jacobian_is_the_derivative_of_the_foot():
    step = 1e-6
    for q in postures(60):
        J = jacobian(q)
        for joint in range(3):
            up, down = q.copy(), q.copy()
            up[joint::3] += step
            down[joint::3] -= step
            slope = (foot_position(up) - foot_position(down)) / (2.0 * step)
            np.testing.assert_allclose(J[:, :, joint], slope, atol=1e-9)


def test_joint_velocity_moves_the_feet_as_asked_and_the_kernel_agrees():
    rng = np.random.default_rng(3)
    for q in postures(60):
        velocity = rng.normal(size=(4, 3))
        dq = joint_velocity(q, velocity)
        moved = (jacobian(q) @ dq.reshape(4, 3, 1))[..., 0]
        np.testing.assert_allclose(moved, velocity, atol=1e-11)
        again, d_again = inverse(foot_position(q), velocity, HYQ)
        np.testing.assert_allclose(again, q, atol=1e-12)
        np.testing.assert_allclose(d_again, dq, rtol=1e-10, atol=1e-11)


def test_shapes_12_and_4_by_3_are_the_same_robot():
    np.testing.assert_array_equal(foot_position(HOME), foot_position(HOME.reshape(4, 3)))


def test_a_foot_out_of_reach_is_refused_by_name():
    feet = foot_position(HOME)
    feet[2, 2] = -0.9
    with pytest.raises(ParameterError, match=r"foot lh .* -0\.9.* out of reach by 0\.\d+ m"):
        joint_position(feet)
    with pytest.raises(ParameterError, match="foot lf"):
        joint_position(np.full((4, 3), np.nan))


def test_the_kernel_stops_at_the_knee_range_instead():
    feet = foot_position(HOME)
    for depth in (-0.9, -0.12):
        feet[:, 2] = depth
        q, dq = inverse(feet, np.ones((4, 3)), HYQ)
        assert np.isfinite(q).all() and np.isfinite(dq).all()
        assert (q[2::3] >= LOW[2::3] - 1e-9).all() and (q[2::3] <= HIGH[2::3] + 1e-9).all()


def test_limits_of_hind_legs_mirror_those_of_front_legs():
    low, high = LOW.reshape(4, 3), HIGH.reshape(4, 3)
    assert (low < high).all()
    np.testing.assert_array_equal(low[2:, 0], low[:2, 0])
    np.testing.assert_array_equal(low[2:, 1:], -high[:2, 1:])


def test_another_geometry_scales_the_feet():
    hyq, names = LegGeometry(), ("hip_x", "hip_y", "hip_length", "thigh_length", "shank_length")
    double = LegGeometry(**{name: 2.0 * getattr(hyq, name) for name in names}).rows()
    np.testing.assert_allclose(foot_position(HOME, double), 2.0 * foot_position(HOME))
    np.testing.assert_allclose(joint_position(foot_position(HOME, double), double), HOME)


def other_robot(seed):
    """Geometry of a robot unlike HyQ: hips of any height, sides, knees either way, other angles."""
    rng, legs = np.random.default_rng(seed), HYQ.copy()
    legs[:, HIP_X] += rng.uniform(-0.1, 0.1, 4)
    legs[:, HIP_Z], legs[:, SIDE] = rng.uniform(-0.1, 0.1, 4), rng.uniform(-0.05, 0.12, 4)
    legs[:, KNEE] = rng.choice([-1.0, 1.0], 4)
    legs[:, SIGN : SIGN + 3] = rng.choice([-1.0, 1.0], (4, 3))
    legs[:, ZERO : ZERO + 3] = rng.uniform(-3.0, 3.0, (4, 3))
    return legs


@pytest.mark.parametrize("seed", range(5))
def test_any_robot_inverts_and_differentiates_as_hyq_does(seed):
    rng, legs = np.random.default_rng([seed, 1]), other_robot(seed)
    centre = legs[:, : HIP_Z + 1] + np.array([0.0, 0.0, -0.55])
    centre[:, 1] = LEFT * (legs[:, HIP_Y] + legs[:, SIDE])
    for _ in range(20):
        feet = centre + rng.uniform(-0.08, 0.06, (4, 3))
        q = joint_position(feet, legs)
        np.testing.assert_allclose(foot_position(q, legs), feet, atol=1e-12)
        bend = legs[:, SIGN + 2] * (q[2::3] - legs[:, ZERO + 2])
        np.testing.assert_array_equal(np.sign(bend), legs[:, KNEE])
        J = jacobian(q, legs)
        for joint in range(3):
            step = np.zeros(12)
            step[joint::3] = 1e-6
            slope = (foot_position(q + step, legs) - foot_position(q - step, legs)) / 2e-6
            np.testing.assert_allclose(J[:, :, joint], slope, atol=1e-8)
        velocity = rng.normal(size=(4, 3))
        dq = inverse(feet, velocity, legs)[1]
        np.testing.assert_allclose(dq, joint_velocity(q, velocity, legs), rtol=1e-8, atol=1e-9)


def test_columns_are_where_their_names_say():
    numbers = {"HIP_X": HIP_X, "HIP_Z": HIP_Z, "SIDE": SIDE, "KNEE": KNEE}
    for name, column in numbers.items():
        assert COLUMNS[column] == name.lower()
    assert COLUMNS[SIGN : SIGN + 3] == ("haa_sign", "hfe_sign", "kfe_sign")
    assert COLUMNS[ZERO : ZERO + 3] == ("haa_zero", "hfe_zero", "kfe_zero")
    assert HYQ.shape == (4, len(COLUMNS))


def test_feet_in_a_turned_frame():
    rng = np.random.default_rng(4)
    q, dq, spin = postures(5)[0], rng.normal(size=(4, 3)), rng.normal(size=3)
    R = rotation_base_to_horizontal(0.2, -0.3)
    feet, J, velocity = turned_feet(q.reshape(4, 3), dq, R, spin, HYQ)
    np.testing.assert_allclose(feet, foot_position(q) @ R.T, atol=1e-14)
    np.testing.assert_allclose(J, R @ jacobian(q), atol=1e-14)
    expected = (J @ dq[:, :, None])[..., 0] + np.cross(spin, feet)
    np.testing.assert_allclose(velocity, expected, atol=1e-14)
