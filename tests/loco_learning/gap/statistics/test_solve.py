# SPDX-License-Identifier: Apache-2.0
"""Laws of the robust least squares."""

import numpy as np
import pytest

from loco_learning.gap.statistics.solve import differences, guided, lowest, minimise, soft

OPEN = (np.full(2, -np.inf), np.full(2, np.inf))


def test_small_residuals_stay_and_large_ones_shrink():
    r = np.array([0.0, 0.01, -0.01, 100.0, -100.0])
    out = soft(r, 1.0)
    assert out[:3] == pytest.approx(r[:3], rel=1e-3)
    assert np.all(np.abs(out[3:]) < 20.0)
    assert np.array_equal(np.sign(out), np.sign(r))


@pytest.mark.parametrize("factor", [0.1, 7.0])
def test_residual_and_scale_in_another_unit_shrink_alike(factor):
    r = np.array([0.3, -2.0, 40.0])
    assert soft(factor * r, factor * 1.5) == pytest.approx(factor * soft(r, 1.5))


def test_a_straight_problem_is_solved_in_few_evaluations():
    rng = np.random.default_rng(3)
    a, truth = rng.normal(size=(200, 2)), np.array([0.7, -0.4])
    found = minimise(lambda z: 10.0 * a @ (z - truth), np.array([1.0, 1.0]), OPEN, 0.1, 30)
    assert found.z == pytest.approx(truth, abs=0.01)
    assert found.evaluations <= 12


def test_a_curved_problem_is_solved_with_jumps_in_it():
    t = np.linspace(0.0, 6.0, 400)

    def fun(z):
        late = np.round(z[1] * 50) / 50  # a delay in whole steps
        return 100.0 * (z[0] * np.sin(t - late) - 1.3 * np.sin(t - 0.4))

    found = minimise(fun, np.array([1.0, 0.2]), OPEN, 0.12, 60)
    assert found.z[0] == pytest.approx(1.3, abs=0.02)
    assert found.z[1] == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("wrong", [0.7, 1.0, 1.5])
def test_slopes_that_are_about_right_stand_in_for_differences(wrong):
    """Even where the first step that they make is too long."""
    rng = np.random.default_rng(4)
    a, truth = rng.normal(size=(300, 12)), rng.normal(size=12)
    bounds = np.full(12, -5.0), np.full(12, 5.0)
    slopes = 10.0 * wrong * a
    found = minimise(lambda z: 10.0 * a @ (z - truth), np.zeros(12), bounds, 0.1, 11, slopes)
    assert found.z == pytest.approx(truth, abs=0.05)
    assert found.evaluations <= 11  # fewer than differences alone would take


def test_a_quick_residual_is_used_for_differences_alone():
    """It is off by a constant and a tenth of the slope; the minimum is that of the exact one."""
    rng = np.random.default_rng(5)
    a, truth = rng.normal(size=(100, 4)), rng.normal(size=4)
    calls = {"exact": 0, "quick": 0}

    def exact(z):
        calls["exact"] += 1
        return 10.0 * a @ (z - truth)

    def quick(z):
        calls["quick"] += 1
        return 11.0 * a @ (z - truth) + 3.0

    found = minimise(exact, np.zeros(4), (np.full(4, -5.0), np.full(4, 5.0)), 0.1, 60, None, quick)
    assert found.z == pytest.approx(truth, abs=0.02)
    assert calls["quick"] >= 5  # a reference and a change of each coordinate
    assert calls["exact"] <= 6 and sum(calls.values()) >= found.evaluations


def test_bounds_hold_and_the_rest_is_still_fitted():
    target = np.array([-1.0, 0.5])
    bounds = (np.zeros(2), np.ones(2))
    found = minimise(lambda z: 30.0 * (z - target), np.array([0.5, 0.9]), bounds, 0.1, 40)
    assert found.z == pytest.approx([0.0, 0.5], abs=0.02)


def test_a_coordinate_that_does_nothing_harms_nobody():
    found = minimise(
        lambda z: np.array([50.0 * (z[0] - 2.0), 1.0]), np.array([1.0, 1.0]), OPEN, 0.1, 30
    )
    assert found.z[0] == pytest.approx(2.0, abs=0.02)
    assert np.isfinite(found.z).all()


def test_the_budget_is_kept():
    count = 0

    def fun(z):
        nonlocal count
        count += 1
        return 100.0 * np.array([np.sin(7.0 * z[0]), z[1] ** 3 - 2.0])

    minimise(fun, np.array([0.3, 5.0]), OPEN, 0.1, 15)
    assert count <= 15 + 2


def test_a_difference_is_as_wide_as_the_residual_bears():
    """Of the place of a stop an eighth is millimetres, where the encoder tells micrometres."""
    r, steps = np.full(100, 1.0), np.array([0.12, 0.12])
    slopes = differences(
        lambda z: r + np.outer(np.ones(100), [1e3, 1.0]) @ z, np.zeros(2), r, steps, OPEN[1]
    )
    assert slopes[0] == pytest.approx([1e3, 1.0])
    assert steps == pytest.approx([3e-4, 0.12])


def test_a_jump_is_not_taken_for_a_slope():
    def jump(z):
        return np.array([1.0 + 100.0 * (z[0] > 0.0)])

    steps = np.array([0.12])
    slopes = differences(jump, np.zeros(1), np.ones(1), steps, np.ones(1))
    assert slopes[0, 0] == pytest.approx(100.0 / 0.12) and steps[0] == 0.12


def test_a_lower_minimum_a_stride_away_is_found():
    bounds = np.full(1, -3.0), np.full(1, 3.0)

    def fun(z):
        return np.array([12.0 * (z[0] ** 2 - 1.0), 4.0 * (z[0] - 1.0)])

    near = minimise(fun, np.array([-1.1]), bounds, 0.1, 30)
    far = lowest(fun, np.array([-1.1]), bounds, 0.1, [(0, 1.9)], (100, 30))
    assert near.z[0] < 0.0 < 30.0 < near.cost
    assert far.z[0] == pytest.approx(1.0, abs=0.01) and far.cost < 0.5


@pytest.mark.parametrize("turn", [1, -1])
def test_of_several_strides_that_lead_lower_the_lowest_counts_whatever_their_order(turn):
    """Each of two coordinates has a lower valley; the strides are tried once."""

    def fun(z):
        bends = 12.0 * (np.square(z) - 1.0)
        return np.concatenate([bends, [3.0, 6.0] * (z - 1.0)])

    start, bounds = np.full(2, -1.0), (np.full(2, -3.0), np.full(2, 3.0))
    once = minimise(fun, start, bounds, 0.1, 30).evaluations + 1
    strides = [(0, 1.9), (1, 1.9)][::turn]
    found = lowest(fun, start, bounds, 0.1, strides, (once, 30))
    assert found.z[0] < -0.5 < 0.5 < found.z[1]


@pytest.mark.parametrize("turn", [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
@pytest.mark.parametrize("unit", [0.3, 1.0])
def test_a_fit_on_a_bound_is_as_quick_on_either_side_and_leaves_the_others_their_best(turn, unit):
    """A coordinate that would leave its range takes part no more, and the others go on alone."""
    rng, turn = np.random.default_rng(6), np.array(turn)
    a = 30.0 * (rng.normal(size=(200, 1)) + 0.3 * rng.normal(size=(200, 2)))
    low, high = np.array([0.0, -5.0]), np.array([1.0, 5.0])
    truth = np.array([1.0 + 0.6 * unit, -0.4])
    bounds = tuple(np.sort([turn * low, turn * high], axis=0))
    start, free = turn * [1.0, 0.0], (np.full(1, -5.0), np.full(1, 5.0))
    found = minimise(lambda z: a @ (turn * z - truth), start, bounds, 0.1, 30)
    alone = minimise(lambda z: a @ ([1.0, *z] - truth), np.zeros(1), free, 0.1, 30)
    assert turn * found.z == pytest.approx([1.0, *alone.z], abs=1e-6)
    assert found.evaluations <= alone.evaluations + 2  # two differences


@pytest.mark.parametrize(("sign", "alone"), [(1.0, True), (-1.0, False)])
def test_differences_are_taken_only_where_slopes_lead_nowhere(sign, alone):
    rng, asked = np.random.default_rng(5), []
    a, truth = rng.normal(size=(300, 12)), rng.normal(size=12)
    bounds = np.full(12, -5.0), np.full(12, 5.0)

    def fun(z):
        asked.append(z)
        return 10.0 * a @ (z - truth)

    found = guided(fun, np.zeros(12), bounds, 0.1, (11, 60), sign * 10.0 * a, 1.0)
    assert found.z == pytest.approx(truth, abs=0.05)
    assert (len(asked) <= 11) is alone


@pytest.mark.parametrize("stiffness", [0.8, 1.0, 1.2, 1.6, 2.0, 3.0])
def test_a_step_to_where_nothing_happens_is_not_the_end(stiffness):
    """A cable pulls where it is taut, and one that is too long not at all: that says nothing."""
    x = 1.04 + 0.15 * np.sin(np.linspace(0.0, 30.0, 400))

    def pull(k, length):
        return 30.0 * k * np.maximum(0.0, x - length)

    def fun(z):
        return pull(z[0], 0.8 * np.exp(0.7 * z[1])) - pull(5.0, 0.98)

    found = minimise(fun, np.array([stiffness, 0.0]), OPEN, 0.12, 40)
    assert found.cost < 1.0
    assert found.z == pytest.approx([5.0, np.log(0.98 / 0.8) / 0.7], rel=0.01)


def test_a_gain_of_a_thousandth_of_the_cost_is_the_end():
    """After a difference of each coordinate and one step, however many more would gain a little."""

    def fun(z):
        return np.array([1000.0, *(10.0 * z + 3.0 * z**2)])

    found = minimise(fun, np.array([1.0, 1.0]), OPEN, 0.1, 40)
    assert found.evaluations == 1 + 2 + 1
    without = minimise(lambda z: fun(z)[1:], np.array([1.0, 1.0]), OPEN, 0.1, 40)
    assert without.evaluations > 4 and without.cost < 0.5
