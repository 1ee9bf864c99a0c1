# SPDX-License-Identifier: Apache-2.0
"""Curves beside gap.json, their figures and their errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import BagError
from loco_learning.drawing.chart import limits
from loco_learning.gap.localisation import curves as gap_curves
from loco_learning.gap.localisation import errors, figures
from loco_learning.gap.localisation.curves import FIT, HELD_OUT, Curve, Curves
from loco_learning.gap.statistics import evidence

CHANNELS = (("q", "lf_kfe_joint", "rad"), ("gyro", "x", "rad/s"), ("q", "rh_kfe_joint", "rad"))


def curve(name="bag", role=HELD_OUT, late=0.0, noise=0.0, count=600):
    rng = np.random.default_rng(5)
    t = np.arange(count) / 100.0
    rates, sizes = np.array([0.7, 1.1, 0.4]), np.array([1.0, 0.2, 2.0])

    def motion(lag):
        return sizes * np.sin(2.0 * np.pi * rates * (t[:, None] - lag))

    measured = motion(0.0) + noise * rng.normal(size=(count, 3))
    floor, judged = np.full((count, 3), 0.01), np.full(count, role == HELD_OUT)
    return Curve(name, role, t, measured, motion(late), motion(0.0), floor, judged, np.zeros(0))


def made(**more):
    return Curves(CHANNELS, (curve("fit", FIT), curve(**more)))


def test_what_was_saved_is_read_again(tmp_path):
    found = made(late=0.1, noise=0.01)
    found.save(tmp_path / "gap.npz")
    again = gap_curves.load(tmp_path / "gap.npz")
    assert again.channels == found.channels
    assert [(r.name, r.role) for r in again.records] == [("fit", FIT), ("bag", HELD_OUT)]
    np.testing.assert_allclose(again.records[1].measured, found.records[1].measured, atol=1e-6)
    assert not list(tmp_path.glob("*.part*"))


def test_the_same_curves_make_the_same_bytes(tmp_path):
    for name in ("one.npz", "two.npz"):
        made(late=0.1).save(tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_another_file_is_refused_in_one_line(tmp_path):
    (tmp_path / "gap.npz").write_text("nothing")
    with pytest.raises(BagError, match="does not hold the curves"):
        gap_curves.load(tmp_path / "gap.npz")


def test_rms_is_of_what_judges_and_knows_gaps():
    found = made(late=0.1)
    assert np.all(found.floors("before") > 1.0)
    np.testing.assert_allclose(found.floors("after"), 0.0)
    found.records[0].before[:] = 99.0  # fitted: no number is about it
    assert found.rms("before") < 100.0 and found.closed == 1.0
    found.records[1].measured[:, 1] = np.nan
    assert np.isnan(found.floors("before")[1])


def test_a_model_that_diverged_misses_as_much_as_can_be():
    found = made()
    found.records[1].after[300:] = np.nan
    assert found.floors("after") == pytest.approx(evidence.LIMIT / np.sqrt(2.0))


def test_rows_of_which_none_was_compared_are_left_out_where_they_are_even():
    measured = np.full((100, 2), np.nan)
    measured[7::5, 1] = 0.0
    assert range(100)[gap_curves._compared(measured)] == range(2, 100, 5)
    measured[50, 0] = 0.0
    assert range(100)[gap_curves._compared(measured)] == range(0, 100, 1)


def test_in_the_air_and_on_the_ground_share_channels_and_the_ground_judges():
    ground = made(late=0.1)
    air = Curves(tuple(reversed(CHANNELS[1:])), tuple(
        dataclasses.replace(r, **{k: getattr(r, k)[:, :2] for k in gap_curves._KEYS})
        for r in made(late=0.2).records
    ))  # fmt: skip
    both = gap_curves.merge(air, ground)
    assert both.channels == CHANNELS and len(both.records) == 4
    assert both.rms("before") == ground.rms("before") and both.closed == ground.closed
    np.testing.assert_array_equal(both.records[0].measured[:, [2, 1]], air.records[0].measured)
    assert np.isnan(both.records[0].measured[:, 0]).all()


def test_the_worst_channels_come_first_and_in_order():
    assert made(late=0.1).worst(2) == [0, 2]
    assert made(late=0.1).label(2) == "q rh kfe"


def test_an_instant_is_no_gap_to_look_at():
    found = made(late=0.01)
    assert found.worst(1) == [2]
    found.records[1].before[:4, 1] += 100.0
    assert found.worst(1) == [2]
    found.records[1].before[:40, 1] += 100.0
    assert found.worst(1) == [1]
    found.records[1].measured[:, 1] = np.nan
    assert found.worst(1) == [2]


def test_nrmse_is_zero_for_the_truth_and_one_for_the_mean():
    true = curve(late=0.2)
    assert errors.nrmse(true, 0, "after").value == 0.0
    still = dataclasses.replace(true, before=0 * true.before)
    found = errors.nrmse(still, 0, "before")
    assert found.value == pytest.approx(1.0, abs=0.03)
    assert found.low <= found.value <= found.high


def test_a_windowed_error_forgives_a_small_shift_that_nrmse_does_not():
    late = curve(late=0.03)
    assert errors.mawe(late, 0, "before").value < 1e-9
    assert errors.nrmse(late, 0, "before").value > 0.1
    assert errors.mawe(curve(late=0.3), 0, "before").value > 0.1


def test_an_interval_is_the_same_each_time_and_shrinks_with_more_data():
    short, long = curve(noise=0.1, count=300), curve(noise=0.1, count=6000)
    assert errors.nrmse(short, 1, "after") == errors.nrmse(short, 1, "after")
    width = [e.high - e.low for e in (errors.nrmse(c, 1, "after") for c in (short, long))]
    assert width[1] < 0.5 * width[0]


def test_nothing_measured_is_a_dash():
    empty = curve()
    empty.measured[:, 1] = np.nan
    assert str(errors.nrmse(empty, 1, "after")) == "–"
    assert len(errors.error_rows(Curves(CHANNELS, (empty,)))) == 2


def test_a_channel_that_misses_nothing_does_not_stretch_the_axis_of_the_others():
    (frame,) = figures.channels(made(late=0.0, noise=0.0)).frames
    assert limits(frame, True)[0] > 0.1 * figures.FAINT


def test_the_window_holds_the_largest_gap():
    found = curve()
    found.before[430:450] += 1.0
    part = figures.window(found, [0, 1, 2], 1.0)
    assert part.start <= 430 and part.stop >= 450
    assert part.stop - part.start == 100


def test_a_spectrum_shows_amplitude_and_place_of_a_line():
    t = np.arange(4000) / 200.0
    f, a = figures.spectrum(t, 0.3 * np.sin(2 * np.pi * 5.0 * t) + 7.0, bins=400)
    assert f[np.argmax(a)] == pytest.approx(5.0, rel=0.03)
    assert a.max() == pytest.approx(0.3, rel=0.3)
    assert figures.spectrum(t, np.full(4000, np.nan))[0].size == 0
