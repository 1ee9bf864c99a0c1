# SPDX-License-Identifier: Apache-2.0
"""Plots of a gap show the record that was held out, also with gaps and a model that runs away."""

import base64
import dataclasses
import io
import re

import numpy as np
from PIL import Image

import loco
from loco_bringup.gap import plots
from loco_bringup.page.plot import data_of

from .gap_result import curves, result


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


def test_a_notebook_shows_the_curves_of_a_slow_log_as_a_picture(tmp_path):
    """The channel is measured at every tenth of the model's ticks."""
    found = curves()
    found.save(tmp_path / "gap.npz")
    whole = drawn(loco.Gap(tmp_path, result()))
    for r in found.records:
        r.measured[np.arange(400) % 10 != 3] = np.nan
    found.save(tmp_path / "gap.npz")
    assert 0.5 * len(whole) < len(drawn(loco.Gap(tmp_path, result()))) < 2 * len(whole)
    (tmp_path / "gap.npz").unlink()  # as after a wrong set-up
    assert loco.Gap(tmp_path, result())._repr_html_().startswith("<pre>Named: coulomb friction in")


def drawn(gap):
    """Pixels of the two colours of models in the picture of a result."""
    found = re.search(r'<img alt="[^"]+" src="data:image/png;base64,([^"]+)">', gap._repr_html_())
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(found[1]))).convert("RGB"))
    colors = [[0xD5, 0x5E, 0x00], [0x00, 0x72, 0xB2]]
    return np.argwhere((picture[:, :, None] == colors).all(axis=-1).any(axis=-1))
