# SPDX-License-Identifier: Apache-2.0
"""Gaits of networks: what is searched, how it is scored, and that a search repeats."""

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.networks.gait import (
    Evaluator,
    Gait,
    MsdResult,
    MsdTask,
    decode,
    driving_power,
    evaluate,
    optimise,
    score,
    task,
)
from loco_sim.msd.network import chain
from loco_sim.msd.params import PRESETS

SMALL = MsdTask(nodes=5, duration=1.0, evaluations=120)


@pytest.fixture(scope="module")
def found():
    return optimise(SMALL)


def test_twenty_nodes_have_163_parameters():
    t = task("thesis", duration=0.1, evaluations=1)
    result = optimise(t)
    assert result.parameters == 163  # thesis section 6.2.1
    assert result.population == 19


def test_a_point_of_the_unit_box_is_a_gait():
    links = chain(SMALL.params()).count
    low, high = (decode(SMALL, links, np.full((3, 3 * links + 1), v)) for v in (0.0, 1.0))
    assert low.amplitude.shape == (3, links)
    assert not low.amplitude.any()
    assert not low.frequency.any()
    np.testing.assert_allclose(high.amplitude, 0.25)
    np.testing.assert_allclose(high.phase, 2.0 * np.pi)
    np.testing.assert_allclose(high.stiffness, 100.0)
    np.testing.assert_allclose(high.frequency, 10.0)


def test_the_authors_frequency_is_not_searched():
    t = task("author_code", nodes=5)
    assert decode(t, 9, np.full(27, 0.5)).frequency == 1.0
    with pytest.raises(NameUnknownError, match="available: author_code, thesis"):
        task("author")


def test_power_formulas_are_the_ones_printed_and_coded():
    network = chain(SMALL.params())
    links = network.count
    gait = Gait(np.full(links, 0.2), np.zeros(links), np.full(links, 50.0), 2.0)
    energy = np.sum(50.0 * (0.2 * network.rest) ** 2)
    beta = SMALL.params().nonlinearity
    printed = energy * (1.0 + (0.2 * beta) ** 2) / (4.0 * np.pi)
    assert driving_power(SMALL, network, gait) == pytest.approx(printed)
    cycle = driving_power(SMALL.replace(power="cycle"), network, gait)
    assert cycle == pytest.approx(2.0 * printed)
    author = driving_power(SMALL.replace(power="author"), network, gait)
    assert author == pytest.approx(4.0 * np.pi * energy)


def test_score_is_equation_6_4_and_a_budget_counts_only_what_is_above():
    speed, power = np.array([1.0, 10.0, np.nan]), np.array([1800.0, 7200.0, 10.0])
    expected = [np.tanh(0.1) * np.tanh(2.0), np.tanh(1.0) * np.tanh(0.5), 0.0]
    np.testing.assert_allclose(score(SMALL, speed, power), expected)
    budget = score(SMALL.replace(score="budget"), speed, power)
    np.testing.assert_allclose(budget, [np.tanh(0.1), expected[1], 0.0])


def test_a_search_improves_and_repeats(found):
    assert found.course[-5:, 1].mean() > found.course[:2, 1].mean()
    assert (np.diff(found.course[:, 2]) >= 0.0).all()
    assert found.best == found.course[-1, 2]
    again = optimise(SMALL)
    np.testing.assert_array_equal(again.gait.phase, found.gait.phase)
    assert again.clean == found.clean


def test_a_result_survives_its_file(found, tmp_path):
    found.save(tmp_path / "gait.npz")
    read = MsdResult.load(tmp_path / "gait.npz")
    assert read.task == SMALL
    assert (read.best, read.clean, read.parameters) == (found.best, found.clean, 28)
    np.testing.assert_array_equal(read.gait.stiffness, found.gait.stiffness)
    np.testing.assert_allclose(read.course, found.course, rtol=1e-6)


def test_a_gait_has_the_same_score_whoever_is_beside_it(found):
    links = chain(SMALL.params()).count
    rng = np.random.default_rng(0)
    x = rng.uniform(size=(9, 3 * links + 1))
    together = Evaluator(SMALL, 9)(decode(SMALL, links, x), np.arange(9))
    alone = Evaluator(SMALL, 1)(decode(SMALL, links, x[4:5]), np.array([4]))
    for many, one in zip(together, alone, strict=True):
        assert many[4] == one[0]


def test_noise_changes_scores_and_none_does_not(found):
    noisy = evaluate(SMALL, found.gait, 4, with_noise=True)[0]
    clean = evaluate(SMALL, found.gait, 4, with_noise=False)[0]
    assert np.ptp(noisy) > 0.0
    assert np.ptp(clean) == 0.0
    assert clean[0] == found.clean


def test_the_noise_is_that_of_the_preset_unless_changed():
    """One cause at a time: the noise of the author's code on the network of the text."""
    text, code = PRESETS["thesis"], PRESETS["author_code"]
    mixed = task("thesis", noise_of="author_code")
    assert (mixed.noise(), mixed.params()) == (code.noise, task("thesis").params())
    assert task("thesis").noise() == text.noise != code.noise


def test_the_dampers_are_those_of_the_preset_unless_changed():
    """The law and the constant of the author's dampers, on the network of the text."""
    text, mixed, code = (
        t.params() for t in (task("thesis"), task("thesis", dampers_of="author_code"),
                             task("author_code", max_stiffness=100.0))
    )  # fmt: skip
    assert (mixed.damping, mixed.damper) == (code.damping, code.damper) != (10.0, text.damper)
    assert mixed == text.replace(damping=code.damping, damper=code.damper)


def test_values_out_of_range_are_refused():
    with pytest.raises(ParameterError, match=r"MsdTask.nodes must be in \[2"):
        MsdTask(nodes=1)
    with pytest.raises(NameUnknownError, match="author, cycle, thesis"):
        MsdTask(power="watts")
