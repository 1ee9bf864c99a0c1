# SPDX-License-Identifier: Apache-2.0
"""Axes show all that their layers need, and bars and spreads say what they were given."""

import numpy as np
import pytest

from loco_learning.drawing.chart import Axis, Frame, bars, dots, limits, line, spread

X = np.random.default_rng(4).lognormal(size=40)


@pytest.mark.parametrize("logarithmic", [False, True])
def test_an_axis_holds_all_marks_with_room(logarithmic):
    given = np.append(X, [np.nan, np.inf])
    layer = dots("some", given, given, "#000000")
    frame = Frame(Axis("x", logarithmic), Axis("y"), [layer])
    low, high = limits(frame, True)
    assert low < X.min() and X.max() < high
    assert high - low < 1.5 * np.ptp(X) or logarithmic
    assert limits(Frame(Axis("x", limits=(2.0, 3.0)), Axis("y"), [layer]), True) == (2.0, 3.0)


def test_what_has_no_logarithm_does_not_move_a_logarithmic_axis():
    some = Frame(Axis("x", True), Axis("y"), [dots("some", X, X, "#000000")])
    more = Frame(Axis("x", True), Axis("y"), [dots("some", [*X, 0.0, -3.0], [*X, 1, 1], "#000000")])
    assert limits(some, True) == limits(more, True)


def test_an_axis_without_marks_or_with_one_value_has_a_length():
    for values in ([], [np.nan], [0.0], [7.0]):
        low, high = limits(Frame(Axis("x"), Axis("y"), [line("l", values, values, "#0")]), True)
        assert np.isfinite([low, high]).all() and low < high


def test_names_have_a_place_each():
    frame = Frame(Axis("x"), Axis("y", names=list("abc")), [])
    assert limits(frame, False) == (-0.5, 2.5)


def test_bars_cover_their_spans_and_end_an_axis():
    layer = bars("stands", [(1.0, 2.0), (4.0, 0.5)], 3, "#000000")
    np.testing.assert_allclose(layer.right - layer.x, [2.0, 0.5])
    np.testing.assert_allclose((layer.top + layer.y) / 2.0, 3.0)
    assert limits(Frame(Axis("t"), Axis("leg"), [layer]), True) == (1.0, 4.5)
    assert len(bars("never", [], 0, "#000000").x) == 0


def test_a_spread_has_means_and_one_deviation_to_both_sides():
    groups = [(float(k), np.random.default_rng(k).normal(size=9)) for k in range(4)]
    strokes, mean, marks = spread("some", groups, "#000000")
    assert mean.y.tolist() == marks.y.tolist() == [values.mean() for _, values in groups]
    ends = strokes.y.reshape(4, 3)
    assert np.isnan(ends[:, 2]).all()  # no stroke leads to the next
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], [2.0 * v.std() for _, v in groups])
