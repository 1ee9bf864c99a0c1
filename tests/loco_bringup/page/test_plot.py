# SPDX-License-Identifier: Apache-2.0
"""What a plot carries is what was given, to the width of a line."""

import base64
import zlib

import numpy as np
import pytest

from loco_bringup.page.plot import BUDGET, STEPS, UNKNOWN, Line, Panel, Plot, data_of, seen, thinned


def unpacked(data, kind):
    return np.frombuffer(zlib.decompress(base64.b64decode(data)), kind)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_values_come_back_and_unknown_ones_stay_unknown(logarithmic):
    y = np.random.default_rng(2).lognormal(size=500)
    y[[0, 7, 499]] = np.nan
    plot = Plot(np.arange(500) * 0.004, [Panel("y [m]", [Line("y", y, "#000000")], logarithmic)])
    data = data_of("One", plot)
    steps = np.cumsum(unpacked(data["steps"], "<i2"), dtype="<i2")
    np.testing.assert_array_equal(steps == UNKNOWN, np.isnan(y))
    low, high = data["panels"][0]["lines"][0]["ends"]
    again = low + (steps.astype(float) + STEPS // 2) * (high - low) / STEPS
    known = np.isfinite(y)
    wanted = np.log10(y[known]) if logarithmic else y[known]
    np.testing.assert_allclose(again[known], wanted, atol=(high - low) / STEPS)


def test_an_axis_is_even_or_told_in_full():
    line = [Panel("y", [Line("y", np.zeros(9), "#000000")])]
    even = unpacked(data_of("Even", Plot(1.0 + 0.5 * np.arange(9), line))["x"], "<f8")
    np.testing.assert_array_equal(even, [1.0, 0.5])
    uneven = np.geomspace(1.0, 100.0, 9)
    np.testing.assert_array_equal(unpacked(data_of("Not", Plot(uneven, line))["x"], "<f8"), uneven)


def test_a_long_plot_is_thinned_to_its_budget():
    count = 3 * BUDGET + 1
    data = data_of("Long", Plot(np.arange(count), [Panel("y", [Line("y", np.zeros(count), "#0")])]))
    assert BUDGET // 2 < data["count"] <= BUDGET and data["every"] == 4


def test_a_signal_slower_than_the_axis_keeps_its_values_when_it_is_thinned():
    y = np.full(20, np.nan)
    y[3::10] = [1.0, 2.0]
    for every in (1, 2, 3, 4, 7):
        kept = thinned(y, every)
        assert len(kept) == -(-20 // every) and kept[np.isfinite(kept)].tolist() == [1.0, 2.0]


def test_words_tell_the_range_of_every_line():
    lines = [
        Line("up", np.array([np.nan, -1.0, 2.5]), "#0"),
        Line("gone", np.full(3, np.nan), "#0"),
    ]
    text = seen("Joint", Plot(np.arange(3.0), [Panel("q [rad]", lines)]))
    assert text == "Joint over time [s] from 0 to 2. q [rad]: up −1 to 2.5, gone unknown."
