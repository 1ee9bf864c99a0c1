# SPDX-License-Identifier: Apache-2.0
"""Plots of a gap show the record that was held out, also with gaps and a model that runs away."""

import dataclasses

import numpy as np

from loco_bringup.gap import plots
from loco_bringup.page.plot import data_of

from .gap_result import curves


def test_measurement_and_both_models_share_axes():
    top, below = plots.signals(curves()).panels
    assert [line.name for line in top.lines] == ["measured", "model before", "model after"]
    measured, before, _ = (line.values for line in top.lines)
    np.testing.assert_array_equal(below.lines[2].values, measured - before)


def test_a_model_that_runs_away_does_not_hide_the_others():
    found = curves()
    wild = [
        dataclasses.replace(r, after=np.where(r.t[:, None] > 2.0, 1e12, np.nan))
        for r in found.records
    ]
    wild = dataclasses.replace(found, records=tuple(wild))
    for panel in plots.signals(wild).panels:
        assert panel.limits[1] < 100.0
    assert data_of("x", plots.spectra(wild))["log"]
    measured = plots.spectra(found).panels[0].lines[1].values
    assert np.argmax(measured) == np.argmin(np.abs(plots.spectra(found).x - 3.0 / (2.0 * np.pi)))
