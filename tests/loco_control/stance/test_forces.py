# SPDX-License-Identifier: Apache-2.0
"""Two ways to share a wrench, against the RCF's tables and against each other."""

import numpy as np
import pytest

from loco_control.legs.kinematics import foot_position, jacobian
from loco_control.stance.forces import grasp_map, minimum_forces, nullspace_forces, solve_positive

LIFT = np.array([0.0, 0.0, 75.0 * 9.81, 0.0, 0.0, 0.0])
WRENCH = np.array([20.0, -15.0, 800.0, 12.0, -25.0, 9.0])
STANDS = {"four": [0, 1, 2, 3], "three": [0, 1, 3], "pair": [0, 3], "side": [0, 2]}


@pytest.fixture
def legs(standing):
    """Function that gives feet and Jacobians of some legs on the nominal stance."""

    def make(chosen):
        return foot_position(standing)[chosen], jacobian(standing)[chosen]

    return make


def torques(forces, jacobians):
    return -np.einsum("lij,li->lj", jacobians, forces)


@pytest.mark.parametrize(
    ("stand", "mapping", "table"),
    [
        ("four", "nullspace", [1.5, 16.4, 33.6]),
        ("four", "minimum_force", [13.4, 0.3, 41.2]),
        ("pair", "nullspace", [0.1, 30.8, 68.4]),
        ("pair", "minimum_force", [26.9, 0.5, 82.4]),
    ],
)
def test_torques_of_a_pure_lift_are_those_of_the_rcf(legs, stand, mapping, table):
    feet, J = legs(STANDS[stand])
    forces = (
        nullspace_forces(LIFT, feet, J) if mapping == "nullspace" else minimum_forces(LIFT, feet)
    )
    np.testing.assert_allclose(np.abs(torques(forces, J)), [table] * len(feet), atol=0.06)


def test_signs_of_a_pure_lift_on_a_diagonal_pair(legs):
    feet, J = legs(STANDS["pair"])
    front, hind = torques(nullspace_forces(LIFT, feet, J), J)
    np.testing.assert_allclose(front, [0.1, -30.8, 68.4], atol=0.06)
    np.testing.assert_allclose(hind, front * [1, -1, -1], atol=1e-6)


@pytest.mark.parametrize("stand", ["four", "three"])
def test_both_mappings_make_a_wrench_in_reach(legs, stand):
    feet, J = legs(STANDS[stand])
    G = grasp_map(feet)
    np.testing.assert_allclose(G @ minimum_forces(WRENCH, feet).ravel(), WRENCH, atol=1e-4)
    # the weight of the trunk block (1000) leaves a little of the wrench to the torques
    np.testing.assert_allclose(G @ nullspace_forces(WRENCH, feet, J).ravel(), WRENCH, atol=0.3)


@pytest.mark.parametrize("stand", ["pair", "side"])
def test_two_feet_come_as_near_to_a_wrench_as_they_can(legs, stand):
    feet, J = legs(STANDS[stand])
    G = grasp_map(feet)
    nearest = G @ np.linalg.lstsq(G, WRENCH, rcond=1e-9)[0]
    assert np.linalg.norm(nearest - WRENCH) > 5.0  # the moment about the line is lost
    np.testing.assert_allclose(G @ minimum_forces(WRENCH, feet).ravel(), nearest, atol=1e-3)
    np.testing.assert_allclose(G @ nullspace_forces(WRENCH, feet, J).ravel(), nearest, atol=0.3)


@pytest.mark.parametrize("stand", sorted(STANDS))
def test_mappings_differ_only_by_forces_that_the_trunk_does_not_feel(legs, stand):
    feet, J = legs(STANDS[stand])
    difference = nullspace_forces(WRENCH, feet, J) - minimum_forces(WRENCH, feet)
    np.testing.assert_allclose(grasp_map(feet) @ difference.ravel(), np.zeros(6), atol=0.3)
    assert np.abs(difference).max() > 5.0


@pytest.mark.parametrize("stand", sorted(STANDS))
def test_mappings_agree_when_torque_norm_is_force_norm(legs, stand):
    feet, _ = legs(STANDS[stand])
    J = np.array(
        [0.01 * np.linalg.qr(m)[0] for m in np.random.default_rng(0).normal(size=(len(feet), 3, 3))]
    )
    np.testing.assert_allclose(
        nullspace_forces(WRENCH, feet, J), minimum_forces(WRENCH, feet), atol=0.05
    )


def test_one_foot_has_no_choice(legs):
    feet, J = legs([0])
    force = np.array([5.0, 3.0, 100.0])
    wrench = np.concatenate([force, np.cross(feet[0], force)])
    np.testing.assert_allclose(minimum_forces(wrench, feet)[0], force, atol=1e-4)
    np.testing.assert_allclose(nullspace_forces(wrench, feet, J)[0], force, atol=0.05)


def test_each_mapping_has_the_least_norm_of_its_kind(legs):
    feet, J = legs(STANDS["four"])
    null = minimum_forces(WRENCH, feet), nullspace_forces(WRENCH, feet, J)
    sizes = [(np.linalg.norm(f), np.linalg.norm(torques(f, J))) for f in null]
    assert sizes[0][0] < sizes[1][0] and sizes[1][1] < sizes[0][1]


def test_minimum_forces_are_those_of_the_pseudo_inverse(legs):
    for stand in STANDS.values():
        feet, _ = legs(stand)
        expected = np.linalg.pinv(grasp_map(feet), rcond=1e-6) @ WRENCH
        np.testing.assert_allclose(minimum_forces(WRENCH, feet).ravel(), expected, atol=1e-3)


def test_nullspace_forces_are_the_projection_of_the_rcf(legs):
    for stand in STANDS.values():
        feet, J = legs(stand)
        n = 3 * len(feet)
        J_h = np.zeros((n, n + 6))
        for leg, block in enumerate(J):
            J_h[3 * leg : 3 * leg + 3, 3 * leg : 3 * leg + 3] = block
        J_h[:, n:] = grasp_map(feet).T
        W = np.diag([1.0] * n + [1000.0] * 6)
        inverse = W @ J_h.T @ np.linalg.inv(J_h @ W @ J_h.T + 1e-4 * np.eye(n))
        projected = (np.eye(n + 6) - inverse @ J_h).T @ np.concatenate([np.zeros(n), WRENCH])
        ours = torques(nullspace_forces(WRENCH, feet, J), J).ravel()
        np.testing.assert_allclose(ours, projected[:n], atol=1e-6)


def test_grasp_map_sums_forces_and_moments():
    rng = np.random.default_rng(1)
    feet, forces = rng.normal(size=(2, 3, 3))
    wrench = grasp_map(feet) @ forces.ravel()
    np.testing.assert_allclose(wrench[:3], forces.sum(axis=0))
    np.testing.assert_allclose(wrench[3:], np.cross(feet, forces).sum(axis=0))


def test_solve_positive_is_solve():
    rng = np.random.default_rng(2)
    for size in (1, 6, 12):
        A = rng.normal(size=(size, size))
        A, b = A @ A.T + np.eye(size), rng.normal(size=size)
        np.testing.assert_allclose(solve_positive(A.copy(), b.copy()), np.linalg.solve(A, b))
