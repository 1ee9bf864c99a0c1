# SPDX-License-Identifier: Apache-2.0
"""A tree of bodies by Jacobians, beside the recursive equations that robots move by."""

from __future__ import annotations

import numpy as np
import pytest

from loco_sim.multibody import dynamics, tree
from loco_sim.new_robot.body import BASE, Body
from loco_sim.robot.description import Description
from loco_sim.robot.equipment import GRAVITY

from ..trees import random_urdf

SEEDS = range(4)
DOWN = np.array([0.0, 0.0, -GRAVITY])


def bodies(seed: int) -> tuple[Body, Description, np.ndarray]:
    description = Description(random_urdf(seed)[0])
    body = Body(description)
    q = np.random.default_rng([seed, 2]).uniform(-0.8, 0.8, len(body.joints))
    return body, description, q


def equations(description: Description, free: bool, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and torques at rest; joints of a free base first, at 0."""
    made, _, _ = tree.build(description, tuple(description.joint_types()), free)
    n = len(made.kin)
    at, bias, room = np.append(np.zeros(n - len(q)), q), np.zeros(n), dynamics.workshop(n)
    dynamics.dynamics(made, DOWN, at, np.zeros(n), *room[:2], bias)
    return room[1], bias


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bolted_robot_feels_the_inertia_and_the_weight_of_the_equations(seed):
    body, description, q = bodies(seed)
    matrix, bias = equations(description, False, q)
    assert body.inertia(q, bolted=True) == pytest.approx(matrix)
    assert body.weight_torque(q, [], np.zeros((0, 3))) == pytest.approx(bias)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_free_base_yields(seed):
    """What joints feel is the block of the whole matrix, less what the base gives way by."""
    body, description, q = bodies(seed)
    matrix, _ = equations(description, True, q)
    base, cross = matrix[:6, :6], matrix[6:, :6]
    felt = matrix[6:, 6:] - cross @ np.linalg.solve(base, cross.T)
    found = body.inertia(q, bolted=False)
    assert found == pytest.approx(felt)
    assert np.all(np.diag(found) <= np.diag(body.inertia(q, bolted=True)) + 1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_jacobian_is_the_derivative_of_the_place(seed):
    body, _, q = bodies(seed)
    offset, small = np.array([0.03, -0.02, 0.05]), 1e-6
    for k in range(len(body.joints)):

        def place(at: np.ndarray, k: int = k) -> np.ndarray:
            turn, origin = body.forward(at)
            return origin[k] + turn[k] @ offset

        steps = small * np.eye(len(q))
        wanted = [(place(q + step) - place(q - step)) / (2.0 * small) for step in steps]
        found = body.jacobian(k, place(q), body.forward(q))
        assert found == pytest.approx(np.transpose(wanted), abs=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
def test_torques_of_the_weight_are_the_slope_of_its_energy(seed):
    body, _, q = bodies(seed)

    def energy(at: np.ndarray) -> float:
        return body.mass.sum() * GRAVITY * body.centre(at)[2]

    small = 1e-6 * np.eye(len(q))
    slope = [(energy(q + step) - energy(q - step)) / 2e-6 for step in small]
    assert body.weight_torque(q, [], np.zeros((0, 3))) == pytest.approx(slope, abs=1e-6)


def test_legs_that_carry_a_robot_need_what_its_weight_does_through_them():
    """A table of two legs that slide: each carries half of what lies above it."""
    body = Body(Description(TABLE))
    feet, points = [0, 1], np.array([[0.5, 0.0, -1.0], [-0.5, 0.0, -1.0]])
    torque = body.weight_torque(np.zeros(2), feet, points)
    assert torque == pytest.approx([-0.5 * 8.0 * GRAVITY] * 2)  # a slide upwards is pushed down
    hung = body.weight_torque(np.zeros(2), [], np.zeros((0, 3)))
    assert hung == pytest.approx([GRAVITY] * 2)  # each leg weighs 1 kg


def test_a_position_to_begin_with_is_within_the_range_of_each_joint():
    body = Body(Description(TABLE))
    body.low, body.high = np.array([-0.1, 0.2]), np.array([0.3, 1.2])
    assert body.nominal() == pytest.approx([0.0, 0.3])
    body.low, body.high = np.array([-1.2, -np.inf]), np.array([-0.2, np.inf])
    assert body.nominal() == pytest.approx([-0.3, 0.0])


@pytest.mark.parametrize("seed", SEEDS)
def test_every_link_is_part_of_one_body_and_paths_lead_to_the_base(seed):
    body, description, _ = bodies(seed)
    assert sorted(name for names in body.links.values() for name in names) == sorted(
        description.links()
    )
    for k, names in body.links.items():
        assert body.mass[k] == pytest.approx(sum(map(description.mass_of, names)))
        path = body.path(k)
        assert path[-1:] == ([k] if k != BASE else [])
        assert all(body.above[b] == a for a, b in zip([BASE, *path], path, strict=False))
    assert all(k not in body.path(other) for k in body.leaf_bodies() for other in range(k))


def _link(name: str, mass: float) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="0.1" iyy="0.1" '
        'izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def _leg(k: int, x: float) -> str:
    return (
        f'<joint name="leg_{k}" type="prismatic"><parent link="top"/><child link="leg_{k}"/>'
        f'<origin xyz="{x} 0 -0.5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" '
        'velocity="9"/></joint>'
    )


TABLE = (
    f'<robot name="table">{_link("top", 8.0)}{_link("leg_0", 1.0)}{_link("leg_1", 1.0)}'
    f"{_leg(0, 0.5)}{_leg(1, -0.5)}</robot>"
)
