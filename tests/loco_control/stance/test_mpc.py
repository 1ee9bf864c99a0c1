# SPDX-License-Identifier: Apache-2.0
"""Model predictive control of the trunk: laws of its forces, and a rigid body that they hold."""

import sys

import numpy as np
import pytest

from loco_control.exceptions import MissingPackageError
from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.legs.kinematics import jacobian
from loco_control.stance.mpc import Mpc, MpcParams
from loco_control.stance.trunk import TrunkController, TrunkParams

PARAMS, G = MpcParams(), 9.81
N, HEIGHT = PARAMS.horizon, 0.55
ALL, PAIR = np.ones(4, dtype=bool), np.array([True, False, False, True])
FEET = np.array([[x, y, -HEIGHT] for x in (0.375, -0.375) for y in (0.28, -0.28)])
MIRROR = np.array([1.0, -1.0, 1.0])  # of a vector, left to right
TURNED = np.concatenate([-MIRROR, MIRROR, -MIRROR, MIRROR])  # of a state
OTHER = [1, 0, 3, 2]  # the leg on the other side


def planned(mpc, state, stance=ALL, speed=0.0):
    """Forces over the weight, (4, 3), of a robot at its height whose stance does not change."""
    wanted = np.zeros((N, 12))
    wanted[:, 5], wanted[:, 9] = HEIGHT, speed
    return mpc.forces(state, wanted, np.tile(FEET, (N, 1, 1)), np.tile(stance, (N, 1)))


def at(**errors):
    """A state at the desired height, upright and at rest but for some values by their index."""
    state = np.zeros(12)
    state[5] = HEIGHT
    for name, value in errors.items():
        state[int(name[1:])] = value
    return state


@pytest.fixture(scope="module")
def mpc():
    return Mpc(PARAMS, G)


@pytest.mark.parametrize("stance", [ALL, PAIR], ids=["all", "pair"])
def test_forces_of_a_standing_robot_sum_to_its_weight(mpc, stance):
    forces = planned(mpc, at(), stance)
    np.testing.assert_allclose(forces.sum(axis=0), [0.0, 0.0, 1.0], atol=2e-3)
    np.testing.assert_allclose(forces[stance, 2], 1.0 / stance.sum(), atol=2e-3)


def test_no_force_leaves_its_cone_and_a_foot_in_the_air_has_none(mpc):
    draws = np.random.default_rng(0)
    pushed = 0
    for _ in range(50):
        stance = draws.random(4) < 0.7
        forces = planned(mpc, at() + draws.normal(0.0, 0.5, 12), stance)
        sideways = np.linalg.norm(forces[:, :2], axis=1)
        assert (forces[:, 2] >= 0.0).all() and (forces[:, 2] <= PARAMS.limit).all()
        assert (sideways <= PARAMS.friction * forces[:, 2] + 1e-12).all()
        assert not forces[~stance].any()
        pushed += (sideways > 0.6 * PARAMS.friction * forces[:, 2]).any()
    assert pushed > 25  # the law is tested on the boundary


def test_a_mirrored_robot_has_mirrored_forces():
    state = at(_0=0.05, _1=-0.03, _2=0.1, _6=0.2, _8=-0.1, _9=0.3, _10=-0.4)
    own = planned(Mpc(PARAMS, G), state, PAIR)
    mirrored = planned(Mpc(PARAMS, G), state * TURNED, PAIR[OTHER])
    np.testing.assert_allclose(mirrored[OTHER] * MIRROR, own, atol=1e-3)


@pytest.mark.parametrize(
    "pushed", [{"_10": 0.5}, {"_9": -0.5}, {"_0": 0.1}, {"_7": 0.8}, {"_2": 0.2}]
)
def test_a_pushed_body_on_four_feet_comes_to_rest_upright(mpc, pushed):
    state, dt, moved = at(**pushed), 0.004, np.zeros(3)
    wanted = np.zeros((N, 12))
    wanted[:, 5] = HEIGHT
    stance = np.ones((N, 4), dtype=bool)
    for _ in range(500):
        feet = FEET - moved
        forces = mpc.forces(state, wanted, np.tile(feet, (N, 1, 1)), stance)
        spin = G * np.cross(feet, forces).sum(axis=0) / np.square(PARAMS.gyration)
        state[6:] += dt * np.concatenate([spin, G * forces.sum(axis=0) - [0.0, 0.0, G]])
        state[:6] += dt * state[6:]
        moved += dt * state[9:]
    assert np.abs(state[[0, 1, 2]]).max() < 0.03 and np.abs(state[6:]).max() < 0.05
    assert state[5] == pytest.approx(HEIGHT, abs=0.01)


def test_joint_torques_are_those_of_the_forces_on_stance_legs(state_at):
    state, params = state_at(), TrunkParams(mapping="mpc")
    target = TargetGenerator(GaitParams(), 0.004).step(state)
    out = TrunkController(params).step(state, target, PAIR)
    forces = -np.linalg.solve(jacobian(state.q).transpose(0, 2, 1), out.tau.reshape(4, 3, 1))[
        ..., 0
    ]
    weight = params.mass * params.gravity
    np.testing.assert_allclose(forces[PAIR].sum(axis=0)[2], weight, rtol=0.02)
    assert not out.tau.reshape(4, 3)[~PAIR].any()
    np.testing.assert_allclose(out.wrench[:3], forces.sum(axis=0), atol=1e-6)


def test_plans_after_a_reset_are_those_of_a_new_controller(state_at):
    generator = TargetGenerator(GaitParams(start_time=0.0), 0.004)
    states = [state_at(k, roll=0.01 * np.sin(0.3 * k)) for k in range(30)]
    targets = [generator.step(state) for state in states]
    controller = TrunkController(TrunkParams(mapping="mpc"))

    def torques():
        steps = zip(states, targets, strict=True)
        return [controller.step(state, each, each.stance).tau for state, each in steps]

    first = torques()
    controller.reset()
    np.testing.assert_array_equal(torques(), first)


@pytest.mark.parametrize(("hold", "turned"), [(True, True), (False, False)])
def test_a_heading_is_held_or_not(state_at, hold, turned):
    target = TargetGenerator(GaitParams(), 0.004).step(state_at())
    controller = TrunkController(TrunkParams(mapping="mpc", heading_hold=hold))
    controller.step(state_at(), target, ALL)
    moment = controller.step(state_at(4, yaw=0.2), target, ALL).wrench[5]
    assert (moment < -1.0) if turned else abs(moment) < 1.0


@pytest.mark.parametrize("change", [{"enabled": False}, {"min_stance_legs": 3}])
def test_without_enough_legs_it_has_no_torque(state_at, change):
    target = TargetGenerator(GaitParams(), 0.004).step(state_at())
    out = TrunkController(TrunkParams(mapping="mpc", **change)).step(state_at(), target, PAIR)
    assert not out.tau.any()


def test_without_osqp_the_message_says_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    with pytest.raises(MissingPackageError, match=r"osqp is not installed.*\./loco install mpc"):
        TrunkController(TrunkParams(mapping="mpc"))
    TrunkController(TrunkParams())  # nothing else needs it
