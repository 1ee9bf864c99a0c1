# SPDX-License-Identifier: Apache-2.0
"""Laws of the delay line, the force filter and the hidden layer."""

import numpy as np
import pytest

from loco_learning.params import LearnerParams
from loco_learning.reflex.reservoir import DelayLine, ElmLayer, GrfFilter


def test_delay_line_holds_the_newest_samples_newest_first():
    line, samples = DelayLine(4, 2), np.arange(22.0).reshape(11, 2)
    for k, sample in enumerate(samples):
        held = line.step(sample)
        past = samples[max(0, k - 3) : k + 1][::-1]
        np.testing.assert_array_equal(held[: len(past)], past)
        np.testing.assert_array_equal(held[len(past) :], 0.0)
    assert held.flags["C_CONTIGUOUS"]


def test_delay_line_of_one_tap_is_no_memory():
    line = DelayLine(1, 3)
    for value in (1.0, 2.0):
        np.testing.assert_array_equal(line.step(np.full(3, value)), np.full((1, 3), value))


@pytest.mark.parametrize("window", [1, 5, 15])
def test_grf_filter_is_the_mean_of_what_it_has_seen(window):
    rng = np.random.default_rng(1)
    samples, grf_filter = rng.uniform(0.0, 900.0, (40, 4)), GrfFilter(window)
    for k, sample in enumerate(samples):
        expected = samples[max(0, k + 1 - window) : k + 1].mean(axis=0)
        np.testing.assert_allclose(grf_filter.step(sample), expected, rtol=1e-12)


def test_grf_filter_silences_forces_below_its_threshold():
    grf_filter = GrfFilter(1, threshold=60.0)
    averaged = grf_filter.step(np.array([0.0, 59.0, 60.0, 400.0]))
    np.testing.assert_array_equal(averaged, [0.0, 0.0, 60.0, 400.0])


@pytest.mark.parametrize(
    ("activation", "law"), [("tanh", np.tanh), ("relu", lambda x: np.maximum(x, 0.0))]
)
def test_hidden_layer_is_activation_of_an_affine_map(activation, law):
    rng = np.random.default_rng(2)
    params = LearnerParams(neurons=7, hidden_bias=2.0, activation=activation)
    layer = ElmLayer(30, 0.5, params, rng)
    v = rng.normal(size=30)
    np.testing.assert_allclose(layer.step(v), law(layer.weights.T @ v + layer.bias), rtol=1e-12)
    assert np.abs(layer.weights).max() <= 0.5
    assert 0.5 < np.abs(layer.bias).max() <= 2.0


def test_hidden_weights_come_from_the_generator_alone():
    def drawn(seed):
        return ElmLayer(30, 0.5, LearnerParams(neurons=7), np.random.default_rng(seed)).weights

    np.testing.assert_array_equal(drawn(3), drawn(3))
    assert not np.array_equal(drawn(3), drawn(4))
