# SPDX-License-Identifier: Apache-2.0
"""Robots without commands hold, sit down, and go limp, in this order."""

from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.legs.kinematics import foot_position
from loco_sim.plant.fallback import Fallback, FallbackParams
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots

DT = 0.004


@pytest.fixture(scope="module")
def hyq():
    return robots.load("hyq")


def stages(fallback, state, count):
    seen = []
    for _ in range(count):
        seen.append(fallback.stage)
        fallback.command(state)
    return seen


def test_stages_follow_one_another_and_begin_anew_after_a_reset(hyq):
    fallback = Fallback(hyq, FallbackParams(hold=2 * DT, sit=3 * DT), DT)
    with Simulation(robot="hyq") as sim:
        state = sim.reset()
    order = ["hold"] * 2 + ["sit"] * 3 + ["damp"] * 2
    assert stages(fallback, state, 7) == order
    fallback.reset()
    assert stages(fallback, state, 7) == order


def test_the_first_posture_is_held_on_all_legs_and_damped_joints_stay_where_they_are_now(hyq):
    fallback = Fallback(hyq, FallbackParams(hold=3 * DT, sit=2 * DT), DT)
    with Simulation(robot="hyq") as sim:
        first = sim.reset()
    for tick in range(9):
        contact = np.arange(len(first.contact)) == tick % 4  # three legs are in the air
        state = replace(first, q=first.q - 0.01 * tick, contact=contact)
        stage = fallback.stage
        command, trunk = fallback.command(state)
        if stage == "damp":
            np.testing.assert_array_equal(command.q, state.q)
            np.testing.assert_array_equal(trunk.stance, contact)
        else:
            assert trunk.stance.all()
            assert stage == "sit" or np.array_equal(command.q, first.q)
    assert stage == "damp"


def test_by_default_a_robot_is_damped_at_once(hyq):
    with Simulation(robot="hyq") as sim:
        state = sim.reset()
    command, trunk = Fallback(hyq, FallbackParams(), DT).command(state)
    assert np.array_equal(command.q, state.q)
    assert not np.any(command.dq) and not np.any(trunk.tau) and trunk.wrench.shape == (6,)
    assert np.array_equal(trunk.stance, state.contact)


def test_hyq_sits_down_softly_and_stays_upright(hyq):
    fallback = Fallback(hyq, FallbackParams(hold=0.5, sit=2.0, height=0.7), DT)
    heights, fastest = [], 0.0
    with Simulation(robot="hyq") as sim:
        state = sim.reset()
        while fallback.stage != "damp":
            state = sim.step(*fallback.command(state))
            heights.append(sim.ground_truth().position[2])
            fastest = max(fastest, np.abs(state.dq).max())
        assert sim.fallen is None or "height" in sim.fallen
        x, y, _, _ = sim.ground_truth().orientation
    held, sat = heights[int(0.5 / DT) - 1], heights[-1]
    assert held > 0.9 * heights[0]
    assert 0.55 * held < sat < 0.85 * held
    assert fastest < 5.0  # rad/s: it does not drop
    assert 1.0 - 2.0 * (x * x + y * y) > 0.9  # cosine of the tilt


def test_the_last_command_of_sitting_has_the_wanted_height_and_the_first_is_near(hyq):
    fallback = Fallback(hyq, FallbackParams(hold=DT, sit=4 * DT, height=0.7), DT)
    with Simulation(robot="hyq") as sim:
        state = sim.reset()
    posed = [fallback.command(state)[0].q for _ in range(5)]
    low = foot_position(posed[-1], hyq.legs)[:, 2]
    np.testing.assert_allclose(low, 0.7 * foot_position(hyq.standing, hyq.legs)[:, 2])
    assert np.array_equal(posed[0], state.q)
    ways = [np.abs(after - before).max() for before, after in zip(posed, posed[1:], strict=False)]
    np.testing.assert_allclose(ways, ways[::-1])  # it begins as softly as it ends
    assert 0.0 < ways[0] < 0.5 * ways[1]


def test_a_robot_that_cannot_sit_is_refused(hyq):
    with pytest.raises(ParameterError, match="tigrillo cannot sit down.*fallback.sit to 0"):
        Fallback(robots.load("tigrillo"), FallbackParams(sit=1.0), DT)
    with pytest.raises(ParameterError, match="hyq cannot sit at 0.3 .*raise fallback.height"):
        Fallback(hyq, FallbackParams(sit=1.0, height=0.3), DT)
