# SPDX-License-Identifier: Apache-2.0
"""Results of a calibration: saved whole, read back, drawn and put into tables."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, ParameterError
from loco_learning.calibration import figures, results
from loco_learning.calibration.parameters import parameter_set
from loco_learning.drawing import png

from .made import made_result


@pytest.fixture(params=["seven", "ten"])
def result(request):
    return made_result(request.param)


def test_a_result_is_read_back_as_it_was_saved(result, tmp_path):
    again = results.load(result.save(tmp_path))
    for row, old in zip(again.comparisons, result.comparisons, strict=True):
        for key, curve in old.curves.items():
            np.testing.assert_allclose(row.curves[key], curve)
    bare = [replace(r, comparisons=()) for r in (again, result)]
    assert bare[0] == bare[1]
    assert results.load(tmp_path).best.seed == 0
    assert not list(tmp_path.glob("*.part"))


def test_a_result_that_is_not_one_is_refused(result, tmp_path):
    with pytest.raises(MissingFileError):
        results.load(tmp_path)
    path = result.save(tmp_path)
    values = json.loads(path.read_text())
    path.write_text(json.dumps({**values, "format": 99}))
    with pytest.raises(ParameterError, match="format 99; this version reads 2"):
        results.load(tmp_path)
    path.write_text(json.dumps({"format": 2, "fits": []}))
    with pytest.raises(ParameterError, match="calibration.json: it lacks the key 'robot'"):
        results.load(tmp_path)
    path.write_text("[1, 2")
    with pytest.raises(ParameterError, match="line 1, is not JSON"):
        results.load(tmp_path)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("joints",), "a", "joints must be a list"), (("fits",), [], "one entry or more"),
        (("options", "loss"), 3, "options.loss must be a text"),
        (("fits", 0, "values"), [1], r"fits\[0\].values must be a mapping"),
        (("comparisons", 0, "count"), "a", r"comparisons\[0\].count must be a whole number"),
        (("comparisons", 0, "before"), {"a": "b"}, r"comparisons\[0\].before.a must be a number"),
        (("comparisons", 0, "curves", "robot"), [[1.0], ["a"]], r"curves.robot\[1\]\[0\] must be"),
    ],
)  # fmt: skip
def test_a_result_of_others_is_read_key_by_key(tmp_path, place, value, words):
    path = made_result("seven").save(tmp_path)
    values = json.loads(path.read_text())
    inside = values
    for key in place[:-1]:
        inside = inside[key]
    inside[place[-1]] = value
    path.write_text(json.dumps(values))
    with pytest.raises(ParameterError, match=f"calibration.json: .*{words}"):
        results.load(tmp_path)


@pytest.mark.parametrize("count", [200, 201])
def test_a_spectrum_has_the_amplitudes_that_a_signal_is_made_of(count):
    t = np.arange(count) / count
    curve = 0.3 + 0.7 * np.sin(2 * np.pi * t) + 0.05 * np.cos(6 * np.pi * t + 1.0)
    found = results.spectrum(np.column_stack([curve, np.roll(curve, 17)]))
    np.testing.assert_allclose(found[:4].T, [[0.3, 0.7, 0.0, 0.05]] * 2, atol=1e-12)
    assert np.max(found[4:]) < 1e-12


def test_each_joint_has_its_spectra(result):
    chart = figures.spectra(result.comparisons[0], result)
    assert [len(frame.layers) for frame in chart.frames] == [3] * len(result.joints)


def test_table_5_1_has_a_row_per_parameter_and_per_loss(result):
    head, rows = results.body_table(result)
    assert len(rows) == len(parameter_set(result.options["parameters"]).names) + 2
    assert all(len(row) == len(head) for row in rows)
    stiffness = next(row for row in rows if row[0] == "hind knee spring stiffness")
    assert stiffness[2:4] == ["181.6", "181.6"]
    assert stiffness[5] == "440.6"
    author = next(row for row in rows if "author" in row[0])
    assert author[5] == "0.483, before 3.231"


def test_recordings_and_seeds_are_listed(result):
    head, rows = results.recording_table(result)
    assert len(rows) == 4
    assert rows[0][0] == "sine (fitted)"
    assert rows[2][0] == "walk (not fitted)"
    assert rows[0][head.index("Ratio")] == "8.00"
    assert rows[0][head.index("Default model")].startswith("roll")
    head, rows = results.seed_table(result)
    assert [row[0] for row in rows] == ["0", "1", "2", "mean ± std"]
    text = results.markdown(head, rows)
    assert text.count("\n") == len(rows) + 2


@pytest.mark.parametrize("name", figures.FIGURES)
def test_every_figure_is_drawn(result, name, tmp_path):
    chart = figures.FIGURES[name](result)
    assert png.write(chart, tmp_path / f"{name}.png").stat().st_size > 1000
