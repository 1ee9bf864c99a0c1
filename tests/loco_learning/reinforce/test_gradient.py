# SPDX-License-Identifier: Apache-2.0
"""The rule itself, on landscapes whose gradient is known."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.reinforce.gradient import PolicyGradient, directions
from loco_learning.reinforce.params import ReinforceParams


def rule(seed=0, batch=8, step=2.0, momentum=0.0):
    rng = np.random.default_rng(5)
    activity = rng.standard_normal((400, 6)) @ rng.standard_normal((6, 20))
    basis = directions(activity, 6)
    settings = {"step": step, "momentum": momentum, "batch": batch, "seed": seed}
    return PolicyGradient(np.zeros((20, 4)), basis, ReinforceParams(exploration=0.1, **settings))


def test_a_perturbation_moves_every_output_by_sigma():
    rng = np.random.default_rng(1)
    activity = rng.standard_normal((3000, 5)) @ rng.standard_normal((5, 12)) + 0.5
    basis = directions(activity, 4)
    assert basis.shape == (12, 4)
    each = np.mean((activity @ basis) ** 2, axis=0)
    np.testing.assert_allclose(each, 0.25)  # alone
    cross = (activity @ basis).T @ (activity @ basis) / len(activity)
    np.testing.assert_allclose(cross, np.diag(each), atol=1e-9)  # and without each other


def test_directions_are_no_more_than_the_activity_has():
    line = np.outer(np.sin(np.arange(100.0)), np.arange(7.0))
    assert directions(line, 5).shape == (7, 1)
    with pytest.raises(ParameterError, match="silent"):
        directions(np.zeros((100, 7)), 3)


def test_each_perturbation_has_its_mirror_image_and_spares_velocities():
    tried = np.array(rule().perturbed())
    np.testing.assert_allclose(tried[:4], -tried[4:])
    assert np.all(tried[:, :, 2:] == 0.0) and np.all(np.any(tried[:, :, :2] != 0.0, axis=1))


def test_the_step_is_the_mean_of_advantage_times_perturbation():
    r = rule()
    draws, returns = r.perturbations(), np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0])
    half = (returns[:4] - returns[4:]) / 2.0  # over the mean of a draw and its mirror image
    advantage = np.concatenate((half, -half)) / np.sqrt(np.mean(half**2))
    wanted = 2.0 * 0.1 * np.mean([a * d for a, d in zip(advantage, draws, strict=True)], axis=0)
    r.learn(returns)
    np.testing.assert_allclose(r.weights[:, :2], r.basis @ wanted)
    assert r.updates == 1


def test_what_a_draw_and_its_mirror_image_have_in_common_teaches_nothing():
    r, hill = rule(), np.array([4.0, 1.0, 7.0, 2.0])
    r.learn(np.concatenate((hill, hill)))
    assert not r.weights.any() and r.updates == 1


def test_earlier_gradients_fade_by_the_momentum():
    r, plain = rule(momentum=0.5), rule()
    for each in (r, plain):
        each.learn(np.arange(8.0))
    first = r.weights.copy()
    np.testing.assert_array_equal(first, plain.weights)
    for each in (r, plain):
        each.learn(np.arange(8.0) ** 2)
    second = plain.weights - first
    np.testing.assert_allclose(r.weights - first, 0.5 * first + second, atol=1e-12)


def test_returns_in_other_units_or_from_another_zero_change_nothing():
    a, b = rule(), rule()
    returns = np.arange(8.0)
    a.learn(returns)
    b.learn(1000.0 * returns - 7.0)
    np.testing.assert_allclose(a.weights, b.weights, atol=1e-12)


def test_wrong_numbers_are_refused():
    r = rule()
    with pytest.raises(ParameterError, match=r"shape \(8,\), got \(7,\)"):
        r.learn(np.ones(7))


def test_it_climbs_a_hill():
    r = rule(batch=16, step=1.0)
    top = r.basis @ np.full((6, 2), 1.0)

    def height(weights):
        return -float(np.sum((weights[:, :2] - top) ** 2))

    before = height(r.weights)
    for _ in range(60):
        r.learn(np.array([height(w) for w in r.perturbed()]))
    assert height(r.weights) > 0.05 * before


def test_seeds_differ_and_repeat():
    assert np.array_equal(rule(3).perturbations(), rule(3).perturbations())
    assert not np.array_equal(rule(3).perturbations(), rule(4).perturbations())
    r = rule()
    first = r.perturbations()
    r.learn(np.arange(8.0))
    assert not np.array_equal(first, r.perturbations())
