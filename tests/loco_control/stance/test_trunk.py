# SPDX-License-Identifier: Apache-2.0
"""Trunk controller: what it carries, and how it pushes back."""

import numpy as np
import pytest
from tests.quadrupeds import joint_velocity

from loco_control.exceptions import NameUnknownError
from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.legs.kinematics import foot_position, jacobian, joint_position
from loco_control.orientation import rotation_base_to_horizontal
from loco_control.stance.trunk import MAPPINGS, TrunkController, TrunkParams

ALL = np.ones(4, dtype=bool)
PAIR = np.array([True, False, False, True])
WEIGHT = 84.76 * 9.81


@pytest.fixture
def target(state_at):
    return TargetGenerator(GaitParams(), 0.004).step(state_at())


def ground_forces(tau, q):
    """Forces on the feet that the torques answer, from tau = -J^T f, (4, 3)."""
    return -np.linalg.solve(jacobian(q).transpose(0, 2, 1), tau.reshape(4, 3, 1))[..., 0]


@pytest.mark.parametrize("mapping", MAPPINGS)
@pytest.mark.parametrize("stance", [ALL, PAIR], ids=["all", "pair"])
def test_level_robot_at_its_height_is_just_carried(state_at, target, mapping, stance):
    state = state_at()
    out = TrunkController(TrunkParams(mapping=mapping)).step(state, target, stance)
    np.testing.assert_allclose(out.wrench, [0, 0, WEIGHT, 0, 0, 0], atol=1e-9)
    forces = ground_forces(out.tau, state.q)
    np.testing.assert_allclose(forces.sum(axis=0), [0, 0, WEIGHT], atol=0.1)
    np.testing.assert_allclose(forces[stance, 2], WEIGHT / stance.sum(), rtol=1e-3)


def test_swing_legs_get_no_torque_and_flags_are_passed_on(state_at, target):
    stance = PAIR.copy()
    out = TrunkController(TrunkParams()).step(state_at(7), target, stance)
    np.testing.assert_array_equal(out.tau.reshape(4, 3)[~PAIR], np.zeros((2, 3)))
    stance[:] = False
    np.testing.assert_array_equal(out.stance, PAIR)
    assert out.tick == 7


@pytest.mark.parametrize(("mass", "weight"), [(84.76, WEIGHT), (75.0, 735.75)])
def test_weight_is_a_parameter(state_at, target, mass, weight):
    out = TrunkController(TrunkParams(mass=mass)).step(state_at(), target, ALL)
    assert out.wrench[2] == pytest.approx(weight)


@pytest.mark.parametrize(
    ("change", "axis", "moment"),
    [
        ({"roll": 0.02}, 3, -20.0),
        ({"pitch": -0.02}, 4, 20.0),
        ({"angular_velocity": np.array([0.1, 0.0, 0.0])}, 3, -15.0),
        ({"angular_velocity": np.array([0.0, 0.1, 0.0])}, 4, -15.0),
        ({"angular_velocity": np.array([0.0, 0.0, 0.1])}, 5, -10.0),
    ],
)
def test_springs_and_dampers_push_back(state_at, target, change, axis, moment):
    out = TrunkController(TrunkParams()).step(state_at(**change), target, ALL)
    assert out.wrench[axis] == pytest.approx(moment)


def test_heading_of_the_first_tick_is_held_around_the_turn(state_at, target):
    controller = TrunkController(TrunkParams())
    moments = [
        controller.step(state_at(yaw=yaw), target, ALL).wrench[5]
        for yaw in (3.1, 3.1 + 0.1, 3.1 - 0.1, 3.1 + 1.5)
    ]
    np.testing.assert_allclose(moments, [0.0, -10.0, 10.0, -100.0 * np.pi / 4.0], atol=1e-9)
    controller.reset()
    assert controller.step(state_at(yaw=1.0), target, ALL).wrench[5] == 0.0


def test_heading_is_free_without_heading_hold(state_at, target):
    controller = TrunkController(TrunkParams(heading_hold=False))
    controller.step(state_at(), target, ALL)
    assert controller.step(state_at(yaw=0.5), target, ALL).wrench[5] == 0.0


def test_low_trunk_is_lifted_and_a_rising_one_is_braked(state_at, target, standing):
    controller = TrunkController(TrunkParams())
    feet = foot_position(standing)
    low = joint_position(feet + [0.0, 0.0, 0.01])
    assert controller.step(state_at(q=low), target, ALL).wrench[2] == pytest.approx(WEIGHT + 50.0)
    rising = joint_velocity(standing, np.tile([0.0, 0.0, -0.1], (4, 1)))
    out = controller.step(state_at(dq=rising), target, ALL)
    assert out.wrench[2] == pytest.approx(WEIGHT - 80.0)


def test_height_is_measured_along_gravity(state_at, target, standing):
    state = state_at(roll=0.1, pitch=-0.2)
    out = TrunkController(TrunkParams()).step(state, target, PAIR)
    feet = foot_position(standing) @ rotation_base_to_horizontal(0.1, -0.2).T
    lift = WEIGHT + 5000.0 * (0.6 + feet[PAIR, 2].mean())
    assert out.wrench[2] == pytest.approx(lift)


def test_feet_only_push(state_at, target):
    hard = {"roll_kp": 1e5, "height_kp": 0.0, "mapping": "minimum_force"}
    state = state_at(roll=0.05)
    forces = [
        ground_forces(
            TrunkController(TrunkParams(push_only=only, **hard)).step(state, target, ALL).tau,
            state.q,
        )
        @ rotation_base_to_horizontal(0.05, 0.0).T
        for only in (False, True)
    ]
    assert forces[0][:, 2].min() < -100.0
    assert forces[1][:, 2].min() > -1e-9


@pytest.mark.parametrize("legs", [0, 1])
def test_too_few_legs_get_no_torque(state_at, target, legs):
    stance = np.arange(4) < legs
    out = TrunkController(TrunkParams()).step(state_at(), target, stance)
    assert not out.tau.any() and not out.wrench.any()


def test_one_leg_pushes_when_it_may(state_at, target):
    out = TrunkController(TrunkParams(min_stance_legs=1)).step(state_at(), target, np.arange(4) < 1)
    assert np.abs(out.tau[:3]).max() > 10.0


def test_disabled_controller_is_silent(state_at, target):
    assert not TrunkController(TrunkParams(enabled=False)).step(state_at(), target, ALL).tau.any()


def test_unknown_mapping_is_refused():
    with pytest.raises(NameUnknownError, match="did you mean 'nullspace'"):
        TrunkParams(mapping="nulspace")
