# SPDX-License-Identifier: Apache-2.0
"""The experiment in which hypotheses differ most beyond noise and doubt comes first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from loco_learning.gap.proposals import propose

T = np.linspace(0.0, 10.0, 500)
FLOOR = np.array([0.01, 0.1])
NAMES = ["friction", "delay", "backlash"]


def prediction(size: float, form=np.sin) -> np.ndarray:
    return size * form(T)[:, None] * FLOOR


def test_the_larger_difference_wins():
    pool = {
        "still": [prediction(0.0)] * 3,
        "slow": [prediction(0.0), prediction(0.1), prediction(-0.1)],
        "fast": [prediction(0.0), prediction(1.0), prediction(-1.0)],
    }
    ranked = propose.rank(pool, NAMES, FLOOR)
    assert [p.experiment for p in ranked] == ["fast", "slow", "still"]
    assert ranked[0].odds > 10.0 > ranked[1].odds
    assert ranked[2].odds == pytest.approx(1.0)
    assert ranked[2].value == pytest.approx(0.0, abs=1e-9)


def test_the_nearest_rival_counts():
    """Telling two of three apart very well is worth less than telling all of them apart."""
    pool = {
        "two": [prediction(0.0), prediction(0.0), prediction(50.0)],
        "all": [prediction(0.0), prediction(1.0), prediction(2.0)],
    }
    ranked = propose.rank(pool, NAMES, FLOOR, [0.5, 0.4, 0.1])
    assert [p.experiment for p in ranked] == ["all", "two"]
    assert ranked[1].separates == ("friction", "delay")


def test_expected_evidence_is_what_noise_brings():
    rng = np.random.default_rng(0)
    a, b = np.zeros((500, 1)), 0.2 * np.sin(T)[:, None]
    gains = []
    for _ in range(200):
        y = a + rng.normal(size=a.shape)
        gains.append(0.5 * float(((y - b) ** 2 - (y - a) ** 2).sum()))
    wanted = propose.expected(a, b)
    assert np.mean(gains) == pytest.approx(wanted, rel=0.15)
    assert np.std(gains) == pytest.approx(math.sqrt(2.0 * wanted), rel=0.2)


def test_what_doubt_in_a_parameter_can_imitate_is_no_evidence():
    a, b = np.zeros((500, 1)), np.sin(T)[:, None]
    same, other = (100.0 * f(T)[:, None, None] for f in (np.sin, lambda t: np.sign(np.cos(9 * t))))
    sure = propose.expected(a, b)
    assert propose.expected(a, b, same) < 0.01 * sure
    assert propose.expected(a, b, other) > 0.9 * sure
    assert propose.expected(a, b, 0.0 * same) == pytest.approx(sure)
    assert propose.expected(a, b, tau=10.0) == pytest.approx(sure / 10.0)


def test_doubt_changes_the_order():
    pool = {
        "x": [prediction(0.0), prediction(1.0)],
        "y": [prediction(0.0), prediction(0.8, np.cos)],
    }
    doubt = 50.0 * prediction(1.0)[:, :, None]
    none = np.zeros((500, 2, 0))
    free = {"x": [none, doubt], "y": [none, doubt]}
    assert propose.rank(pool, NAMES[:2], FLOOR)[0].experiment == "x"
    assert propose.rank(pool, NAMES[:2], FLOOR, sensitivities=free)[0].experiment == "y"


def test_the_odds_before_count_and_gaps_do_not():
    p = prediction(0.5)
    p[100:] = np.nan
    pool = {"x": [prediction(0.0), p]}
    (even,) = propose.rank(pool, NAMES[:2], FLOOR)
    (likely,) = propose.rank(pool, NAMES[:2], FLOOR, [0.9, 0.1])
    assert likely.odds == pytest.approx(9.0 * even.odds, rel=1e-6)
    assert propose.expected(prediction(0.0), p) == pytest.approx(
        propose.expected(prediction(0.0)[:100], p[:100])
    )
