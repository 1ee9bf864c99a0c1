# SPDX-License-Identifier: Apache-2.0
"""RLS in place against its equations, and against ridge regression, which it must equal."""

import numpy as np
import pytest

from loco_learning.reflex.readout import Readout
from loco_workshop.bench.rls import bench_rls, textbook_step


def data(n, ticks, outputs=16, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.0, 1.0, (ticks, n)), rng.normal(size=(ticks, outputs))


@pytest.mark.parametrize("n", [1, 2, 7, 80])
def test_learn_follows_the_textbook_equations(n):
    hidden, targets = data(n, 60)
    readout = Readout(n, 16, regularisation=0.5)
    p, w = np.eye(n) / 0.5, np.zeros((n, 16))
    for u, target in zip(hidden, targets, strict=True):
        output = readout.learn(u, target)
        expected = textbook_step(p, w, u, target)
        np.testing.assert_allclose(output, expected, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(readout.weights, w, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(readout.covariance, p, rtol=1e-7, atol=1e-10)


@pytest.mark.parametrize("alpha", [1e-3, 1.0, 100.0])
def test_learned_weights_are_the_ridge_regression_of_all_samples(alpha):
    hidden, targets = data(12, 300)
    readout = Readout(12, 16, alpha)
    for u, target in zip(hidden, targets, strict=True):
        readout.learn(u, target)
    ridge = np.linalg.solve(hidden.T @ hidden + alpha * np.eye(12), hidden.T @ targets)
    np.testing.assert_allclose(readout.weights, ridge, rtol=1e-6, atol=1e-9)


def test_learn_returns_what_predict_says_with_the_new_weights():
    hidden, targets = data(20, 30)
    readout = Readout(20, 16)
    for u, target in zip(hidden, targets, strict=True):
        np.testing.assert_allclose(readout.learn(u, target), readout.predict(u), atol=1e-9)


def test_predict_changes_nothing():
    hidden, targets = data(20, 30)
    readout, twin = Readout(20, 16), Readout(20, 16)
    for u, target in zip(hidden, targets, strict=True):
        readout.predict(u)
        np.testing.assert_array_equal(readout.learn(u, target), twin.learn(u, target))


def test_reset_goes_back_to_the_first_weights():
    first = np.full((5, 16), 0.25)
    readout = Readout(5, 16, 1e-3, first)
    (hidden, targets) = data(5, 3)
    before = readout.predict(hidden[0])
    readout.learn(hidden[0], targets[0])
    assert not np.array_equal(readout.predict(hidden[0]), before)
    readout.reset()
    np.testing.assert_array_equal(readout.predict(hidden[0]), before)
    np.testing.assert_array_equal(first, 0.25)


def test_bench_measures_four_ways_at_each_size():
    rows = bench_rls(sizes=(40, 80), repeats=3)
    assert [row.neurons for row in rows] == [40, 80]
    for row in rows:
        assert min(row.ours, row.numpy, row.blas, row.limit) > 0.0
        assert row.ours < row.numpy  # even on a busy machine: measured 10 times less
        assert row.ratio == row.ours / row.limit
