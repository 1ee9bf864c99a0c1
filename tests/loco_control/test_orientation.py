# SPDX-License-Identifier: Apache-2.0
"""Quaternions, angles and matrices say the same."""

import math

import numpy as np
import pytest

from loco_control.orientation import (
    quaternion,
    roll_pitch_yaw,
    rotation_base_to_horizontal,
    wrap_angle,
)

ANGLES = np.random.default_rng(0).uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (50, 3))


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_one_axis_is_right_handed(axis):
    R = rotation_base_to_world(quaternion(*(0.3 * np.eye(3)[axis])))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    np.testing.assert_allclose(R[axis], np.eye(3)[axis], atol=1e-15)
    np.testing.assert_allclose([R[a, a], R[b, a]], [np.cos(0.3), np.sin(0.3)])


def rotation_base_to_world(orientation: np.ndarray) -> np.ndarray:
    """Rotation matrix, (3, 3), of a unit quaternion x y z w, (4,)."""
    roll, pitch, yaw = roll_pitch_yaw(orientation)
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ rotation_base_to_horizontal(roll, pitch)


def test_angles_survive_the_quaternion():
    for angles in ANGLES:
        q = quaternion(*angles)
        assert np.linalg.norm(q) == pytest.approx(1.0)
        np.testing.assert_allclose(roll_pitch_yaw(q), angles, atol=1e-12)
        np.testing.assert_allclose(roll_pitch_yaw(-q), angles, atol=1e-12)


def test_rotation_matrix_is_that_of_the_quaternion():
    v = np.array([0.3, -0.2, 0.9])
    for angles in ANGLES:
        q = quaternion(*angles)
        turned = v + 2.0 * np.cross(q[:3], np.cross(q[:3], v) + q[3] * v)
        np.testing.assert_allclose(rotation_base_to_world(q) @ v, turned, atol=1e-12)


def test_horizontal_frame_is_the_world_without_the_heading():
    R = rotation_base_to_horizontal(0.2, -0.4)
    np.testing.assert_allclose(R, rotation_base_to_world(quaternion(0.2, -0.4, 0.0)), atol=1e-15)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)


def test_pitch_straight_up_is_finite():
    assert roll_pitch_yaw(np.array([0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5) + 1e-9]))[1] == (
        pytest.approx(np.pi / 2)
    )


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(0.1, 0.1), (7.0, 7.0 - 2 * np.pi), (-3.5, 2.78319)]
)
def test_wrap_angle(angle, wrapped):
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-5)
