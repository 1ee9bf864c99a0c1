# SPDX-License-Identifier: Apache-2.0
"""Plots on the page of a calibration."""

import numpy as np
import pytest

from loco_bringup.calibrate import page
from loco_learning.calibration import figures
from loco_learning.drawing.chart import DASHED
from loco_sim.plant.model import Model

from ...loco_learning.calibration.made import made_result

MODELS = ("default", "calibrated")


@pytest.fixture(scope="module")
def result():
    return made_result()


def test_each_search_goes_down_from_the_default_body_as_far_as_it_came(result):
    (frame,) = figures.convergence(result).frames
    *searches, default = frame.layers
    assert frame.y.logarithmic and default.shape == DASHED
    assert [layer.name for layer in searches[::2]] == ["seed 0", "seed 1", "seed 2"]
    for course, plateau, fit in zip(searches[::2], searches[1::2], result.fits, strict=True):
        assert len(course.y) == len(fit.history) + 1
        assert course.y[0] == default.y[0] == fit.before
        assert (np.diff(course.y) <= 0.0).all() and course.y[-1] == fit.history[-1].best
        assert plateau.x == fit.plateau and plateau.y == course.y[fit.plateau]


def test_a_period_has_a_frame_for_each_joint_and_its_spread_around_each_line(result):
    row = result.comparisons[1]
    chart = figures.periods(row, result)
    assert len(chart.frames) == len(result.joints)
    for j, frame in enumerate(chart.frames):
        robot = [layer for layer in frame.layers if layer.name == "surrogate robot"]
        low, high, mean = (layer.y for layer in robot)
        assert robot[0].x[0] == 0.0 and robot[0].x[-1] < row.period
        np.testing.assert_allclose(np.radians(mean), row.curves["robot"][:, j])
        np.testing.assert_allclose(np.radians(high - low), 2.0 * row.curves["robot_spread"][:, j])
        assert {layer.name for layer in frame.layers} == {"surrogate robot", *MODELS}


def test_the_page_has_an_interactive_plot_for_each_recording_and_for_the_searches(result):
    text = page.page(result, Model("tigrillo"))
    shown = 2 + 2 * len(result.comparisons)  # searches and bodies; periods and spectra of each
    assert text.count('<script type="application/json">') == shown
    assert "SURROGATE" in text and "Ratio on walk, not fitted" in text
