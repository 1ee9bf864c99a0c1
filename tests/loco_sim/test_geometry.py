# SPDX-License-Identifier: Apache-2.0
"""Rotations in plain floats obey the laws of rotations."""

import numpy as np
import pytest

from loco_sim.geometry import multiply, roll_pitch, rotate, rotate_back, rotation_matrix


@pytest.fixture
def quaternions():
    drawn = np.random.default_rng(0).standard_normal((20, 4))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def test_a_rotation_matrix_is_orthonormal_and_right_handed(quaternions):
    for quaternion in quaternions:
        matrix = np.array(rotation_matrix(quaternion)).reshape(3, 3)
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_a_quaternion_product_turns_twice(quaternions):
    vector = (0.3, -1.0, 2.0)
    for a, b in zip(quaternions, quaternions[::-1], strict=True):
        both = rotate(rotation_matrix(multiply(a, b)), vector)
        one_by_one = rotate(rotation_matrix(a), rotate(rotation_matrix(b), vector))
        np.testing.assert_allclose(both, one_by_one, atol=1e-14)


def test_rotating_back_undoes_rotating(quaternions):
    vector = (0.3, -1.0, 2.0)
    for quaternion in quaternions:
        matrix = rotation_matrix(quaternion)
        np.testing.assert_allclose(rotate_back(matrix, rotate(matrix, vector)), vector)


@pytest.mark.parametrize("roll", [-2.0, 0.0, 0.5])
@pytest.mark.parametrize("pitch", [-1.2, 0.0, 0.3])
def test_roll_and_pitch_come_back_whatever_the_yaw(roll, pitch):
    def about(axis, angle):
        return (*(np.eye(3)[axis] * np.sin(angle / 2)), np.cos(angle / 2))

    for yaw in (-3.0, 0.0, 1.0):
        turn = multiply(about(2, yaw), multiply(about(1, pitch), about(0, roll)))
        assert roll_pitch(rotation_matrix(turn)) == pytest.approx((roll, pitch))
