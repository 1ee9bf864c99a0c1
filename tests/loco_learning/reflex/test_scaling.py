# SPDX-License-Identifier: Apache-2.0
"""Laws of the two scaling schemes."""

import numpy as np
import pytest

from loco_learning.params import SCALINGS, LearnerParams
from loco_learning.reflex.scaling import OUTPUTS, SCALING, RunningScaler


def scheme(name, **changes):
    return SCALING[name](LearnerParams(scaling=name, memory=6, neurons=4, **changes))


def test_every_choice_has_a_scheme():
    assert tuple(SCALING) == SCALINGS


def test_running_scaler_maps_its_extremes_to_the_ends():
    scaler, rng = RunningScaler(3, -0.5, 1.5), np.random.default_rng(0)
    samples = rng.normal(size=(50, 3)) * [1.0, 10.0, 100.0]
    for sample in samples:
        scaler.fit(sample)
    scaled = np.array([scaler.scale(sample) for sample in samples])
    np.testing.assert_allclose(scaled.min(axis=0), -0.5, atol=1e-12)
    np.testing.assert_allclose(scaled.max(axis=0), 1.5, atol=1e-12)


def test_running_scaler_undoes_itself_and_survives_constants():
    scaler = RunningScaler(2, -1.5, 1.5)
    for value in (0.2, 0.7, 0.4):
        scaler.fit(np.array([value, 0.5]))
    sample = np.array([0.33, 0.5])
    np.testing.assert_allclose(scaler.unscale(scaler.scale(sample)), sample, atol=1e-12)
    assert scaler.scale(sample)[1] == -1.5  # no range: the low end


def test_plateau_reads_one_under_half_the_weight_and_clips_peaks():
    plateau = scheme("plateau")
    sample = plateau.sample(np.array([0.0, 415.7, 1e4, -5.0]), True)
    np.testing.assert_allclose(sample, [0.0, 1.0, 1.5, 0.0, 1.0])


@pytest.mark.parametrize("name", SCALINGS)
def test_output_undoes_fit_target(name):
    made, rng = scheme(name), np.random.default_rng(1)
    for target in rng.normal(size=(20, OUTPUTS)):
        value = made.fit_target(target)
    np.testing.assert_allclose(made.output(value), target, atol=1e-12)


def test_author_ranges_rest_while_not_learning():
    author = scheme("author")
    np.testing.assert_array_equal(author.sample(np.full(4, 300.0), False), np.zeros(5))
    author.sample(np.zeros(4), True)
    author.sample(np.full(4, 800.0), True)
    beyond = author.sample(np.full(4, 1600.0), False)
    np.testing.assert_allclose(beyond, [3.5, 3.5, 3.5, 3.5, -0.5])
    line = np.zeros((6, 5))
    author.hidden(line, True)
    author.hidden(line + 2.0, True)
    np.testing.assert_allclose(author.hidden(line + 1.0, False), np.zeros(30), atol=1e-12)


@pytest.mark.parametrize("name", SCALINGS)
def test_reset_forgets(name):
    made, rng = scheme(name), np.random.default_rng(2)

    def run():
        rows = [made.sample(force, True).copy() for force in rng_forces]
        return np.array(rows)

    rng_forces = rng.uniform(0.0, 900.0, (10, 4))
    first = run()
    made.reset()
    np.testing.assert_array_equal(run(), first)
