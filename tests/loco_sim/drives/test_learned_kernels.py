# SPDX-License-Identifier: Apache-2.0
"""The torque of a learned correction is bounded, smooth, and gone beyond what was seen."""

import numpy as np
import pytest

from loco_sim import effects
from loco_sim.drives.learned_kernels import FADE, REGION, fade, learned_torque
from loco_sim.effects.rows import CONSTANTS, FEATURES
from loco_sim.robot import robot
from loco_sim.world.world import Setting

BENCH = robot.load("linear_axis")
RNG = np.random.default_rng(0)


def row(weights, middle=0.3, travel=0.5, speed=2.0, load=1.0, half=4.0, limit=1e9):
    return np.array([middle, travel, speed, load, half, limit, 0.0, *weights])


def one(feature):
    return np.eye(FEATURES)[feature]


def test_a_row_holds_the_region_and_a_weight_per_feature():
    assert CONSTANTS == REGION + FEATURES == len(row(one(0)))


@pytest.mark.parametrize("feature", range(FEATURES))
def test_no_feature_is_above_one_anywhere(feature):
    there = row(one(feature))
    states = RNG.uniform(-1.0, 1.0, (2000, 4)) * (2.0, 6.0, 20.0, 20.0)
    said = np.array([learned_torque(*state, there) for state in states])
    assert 0.5 < np.abs(said).max() <= 1.0 + 1e-12


@pytest.mark.parametrize("axis", range(3))
def test_beyond_what_was_seen_it_fades_to_exactly_zero(axis):
    constant, middle, half = row(one(0)), (0.3, 0.0, 1.0), (0.5, 2.0, 4.0)
    for share, wanted in ((0.99, 1.0), (-0.99, 1.0), (1.01 + FADE, 0.0), (-1.01 - FADE, 0.0)):
        state = np.array(middle)
        state[axis] += share * half[axis]
        assert learned_torque(*state, 1.0, constant) == wanted
    inside = [fade(x) for x in np.linspace(1.0, 1.0 + FADE, 50)]
    assert np.all(np.diff(inside) <= 0.0) and inside[0] == 1.0 and inside[-1] == 0.0


def test_it_is_smooth_in_everything_also_at_the_edges():
    there, h = row(RNG.normal(size=FEATURES)), 1e-5
    for state in RNG.uniform(-1.0, 1.0, (500, 4)) * (2.0, 6.0, 12.0, 12.0):
        for axis in range(4):
            moved = state + h * np.eye(4)[axis]
            change = learned_torque(*moved, there) - learned_torque(*state, there)
            assert abs(change) < 2e3 * h  # no jump


def test_it_never_gives_more_than_the_limit_of_the_joint():
    made = effects.make("learned_residual", weights=(1e4,) * FEATURES, travel=9.0, load_range=99.0)
    made.configure(Setting(BENCH, BENCH.sim, 1e-3))
    made.reset(np.random.default_rng(0))
    for state in RNG.uniform(-1.0, 1.0, (200, 2)):
        tau = np.array([3.0])
        more = made.on_torque(tau, state[:1], state[1:], 1e-3, 0.0) - tau
        assert np.abs(more) <= BENCH.effort


def test_what_changes_in_the_torque_is_forgotten_in_its_time():
    weights = one(FEATURES - 1)
    made = effects.make(
        "learned_residual", weights=tuple(weights), travel=9.0, load_range=10.0, time=0.05
    )
    made.configure(Setting(BENCH, BENCH.sim, 1e-3))
    made.reset(np.random.default_rng(0))
    still = np.zeros(1)
    assert made.on_torque(still, still, still, 1e-3, 0.0) == 0.0
    jump = np.array([5.0])
    said = [made.on_torque(jump, still, still, 1e-3, 0.0)[0] - 5.0 for _ in range(200)]
    np.testing.assert_allclose(said, 0.5 * np.exp(-np.arange(200) / 50.0), rtol=1e-9)
