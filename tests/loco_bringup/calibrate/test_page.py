# SPDX-License-Identifier: Apache-2.0
"""Plots on the page of a calibration."""

import numpy as np
import pytest

from loco_bringup.calibrate import page
from loco_sim.plant.model import Model

from ...loco_learning.calibration.made import made_result


@pytest.fixture(scope="module")
def result():
    return made_result()


def test_each_search_goes_down_from_the_default_body_as_far_as_it_came(result):
    (panel,) = page.convergence(result).panels
    *searches, default = panel.lines
    assert panel.logarithmic and default.dashed
    assert [line.name for line in searches] == ["seed 0", "seed 1", "seed 2"]
    for line, fit in zip(searches, result.fits, strict=True):
        known = line.values[np.isfinite(line.values)]
        assert len(known) == len(fit.history) + 1
        assert known[0] == default.values[0] == fit.before
        assert (np.diff(known) <= 0.0).all() and known[-1] == fit.history[-1].best


def test_a_period_has_a_panel_for_each_joint_and_its_spread_around_each_line(result):
    row = result.comparisons[1]
    plot = page.periods(row, result)
    assert len(plot.panels) == len(result.joints)
    assert plot.x[0] == 0.0 and plot.x[-1] < row.period
    for j, panel in enumerate(plot.panels):
        robot = [line for line in panel.lines if line.name == "surrogate robot"]
        low, high, mean = (line.values for line in robot)
        np.testing.assert_allclose(np.radians(mean), row.curves["robot"][:, j])
        np.testing.assert_allclose(np.radians(high - low), 2.0 * row.curves["robot_spread"][:, j])
        assert {line.name for line in panel.lines} == {"surrogate robot", "default", "calibrated"}


def test_the_page_has_an_interactive_plot_for_each_recording_and_for_the_searches(result):
    text = page.page(result, Model("tigrillo"))
    shown = 2 + 2 * len(result.comparisons)  # searches and bodies; periods and spectra of each
    assert text.count('<script type="application/json">') == shown
    assert "SURROGATE" in text and "Ratio on walk, not fitted" in text
