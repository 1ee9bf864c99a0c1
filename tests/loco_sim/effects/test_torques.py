# SPDX-License-Identifier: Apache-2.0
"""Bias, ripple, carried weight, friction by direction and of two joints: sizes by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_sim import effects
from loco_sim.bolted.loop import Bolted
from loco_sim.effects.places import outward
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.servo import TorqueDrive

AXIS, LEG = robot.load("linear_axis"), robot.load("hyq_leg")
PENDULUM = robot.load("pendulum")


def run(plant, listed, rows=500, tau=None, **more):
    still = np.tile(plant.standing, (rows, 1))
    return Bolted(plant, effects.from_list(listed)).run(still, tau_wanted=tau, **more)


def test_a_bias_bends_a_position_loop_by_torque_over_gain():
    q = run(AXIS, [{"name": "torque_bias", "torque": 6.0}], 1000).q
    assert q[-1, 0] == pytest.approx(6.0 / AXIS.drives["slide"].kp, rel=1e-3)


def test_a_drive_tells_the_force_that_it_holds_but_not_its_own_bias():
    """Both bend a position loop the same: a force was called a slope, for want of a name."""
    force, bias = (
        run(AXIS, [spec], 1000)
        for spec in ({"name": "constant_force", "force": [6.0, 2.0, 9.0]},
                     {"name": "torque_bias", "torque": 6.0})
    )  # fmt: skip
    assert force.q[-1] == pytest.approx(bias.q[-1], rel=1e-9)
    assert force.tau[-1, 0] == pytest.approx(-6.0, rel=1e-3)
    assert bias.tau[-1, 0] == pytest.approx(0.0, abs=1e-3)


def test_a_joint_comes_to_rest_where_a_ripple_is_zero_and_falling():
    """Without gravity, beside friction: sin(9 q) pushes to 2 pi / 18, wherever it begins."""
    level = robot.load("pendulum", {"sim.gravity": 0.0})
    listed = [{"name": "torque_ripple", "sine": 0.2, "count": 9.0},
              {"name": "viscous_friction", "damping": 0.1}]  # fmt: skip
    for begin in (0.1, 0.3, 0.6):
        q = run(level, listed, 2000, start=(np.array([begin]), np.zeros(1))).q[-1, 0]
        assert q == pytest.approx(np.pi / 9.0, abs=1e-3)


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_drive_that_carries_a_share_sags_by_the_rest(share):
    """Also: the weight of a limp leg that is carried whole does not move it."""
    bare = run(LEG, []).q[-1] - LEG.standing
    carried = run(LEG, [{"name": "gravity_compensation", "share": share}]).q[-1] - LEG.standing
    assert np.abs(bare).max() > 0.01
    np.testing.assert_allclose(carried, (1.0 - share) * bare, atol=0.05 * np.abs(bare).max())


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_carried_weight_is_no_weaker_gravity_to_an_accelerometer(engine):
    plant = robot.load("hyq_leg", {"sim.engine": engine})
    with Simulation(effects=[effects.make("gravity_compensation", share=0.7)], robot=plant) as sim:
        felt = sim.reset().linear_acceleration
    np.testing.assert_allclose(felt, [0.0, 0.0, 9.81], atol=1e-9)


def test_nobody_carries_a_robot_that_stands_on_the_ground():
    with pytest.raises(ParameterError, match="base that is bolted"):
        Simulation(effects=[effects.make("gravity_compensation", share=0.5)], robot="tigrillo")


HOLDS = [(3.0, False), (-3.0, True), (6.0, True), (-1.5, False)]


@pytest.mark.parametrize(("force", "moves"), HOLDS)
def test_friction_by_direction_holds_and_lets_go_as_the_drive_pushes(force, moves):
    """Of 5 N forwards and 2 N backwards, from rest."""
    plant = replace(AXIS, drives={"slide": TorqueDrive()})
    listed = [{"name": "asymmetric_friction", "forward": 5.0, "backward": 2.0}]
    q = run(plant, listed, 100, np.full((100, 1), force)).q[:, 0]
    assert (np.abs(q[-1]) > 1e-3) == moves
    assert q[-1] * force >= 0.0


def test_friction_by_direction_slows_each_way_by_its_own():
    plant = replace(AXIS, drives={"slide": TorqueDrive()})
    listed = [{"name": "asymmetric_friction", "forward": 5.0, "backward": 2.0}]
    lost = []
    for speed in (0.4, -0.4):
        start = np.zeros(1), np.array([speed])
        slowed, bare = (run(plant, e, 20, start=start).dq[5, 0] for e in (listed, []))
        lost.append(abs(slowed - bare))
    assert lost[0] / lost[1] == pytest.approx(2.5, rel=0.02)


def test_a_joint_is_followed_by_the_next_one_outwards():
    np.testing.assert_array_equal(outward(LEG), [1, 2, -1])
    hyq = robot.load("hyq")
    np.testing.assert_array_equal(outward(hyq).reshape(4, 3) % 3, [[1, 2, 2]] * 4)
    np.testing.assert_array_equal(outward(hyq)[2::3], -1)


def test_friction_of_two_joints_follows_the_sum_of_their_speeds():
    """Both turn against each other as fast: no friction. Both the same way: on both, the same."""
    made = effects.make("coupled_friction", joint="lf_hfe_joint", torque=2.0, damping=0.5)
    with Simulation(effects=[made], robot=LEG):
        zero, dt = np.zeros(3), 1e-3
        against, along = np.array([0.3, 1.0, -1.0]), np.array([0.3, 1.0, 1.0])
        np.testing.assert_allclose(made.on_torque(zero, zero, against, dt, 0.0), 0.0, atol=1e-12)
        for _ in range(200):
            tau = made.on_torque(zero, zero, along, dt, 0.0)
    np.testing.assert_allclose(tau, [0.0, -3.0, -3.0], rtol=1e-6)


def test_compensation_of_friction_cancels_it_where_the_joint_moves():
    """Friction and its compensation together: the motion without both."""
    made = [
        {"name": "viscous_friction", "damping": 3.0},
        {"name": "coulomb_friction", "torque": 2.0},
        {"name": "friction_compensation", "torque": 2.0, "damping": 3.0, "velocity": 1e-3},
    ]
    plant, start = replace(AXIS, drives={"slide": TorqueDrive()}), (np.zeros(1), np.array([0.4]))
    slowed, whole, bare = (run(plant, e, 20, start=start).dq[:, 0] for e in (made[:2], made, []))
    assert np.abs(slowed - bare).max() > 0.01
    np.testing.assert_allclose(whole, bare, rtol=1e-3)
