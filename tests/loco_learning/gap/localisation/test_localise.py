# SPDX-License-Identifier: Apache-2.0
"""A gap that was put somewhere is found there: joint, signal, phase, band, region, states."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from loco_learning.gap.localisation import localise, regions
from loco_learning.gap.prediction import phases
from loco_learning.gap.recordings.record import Record

Channel = namedtuple("Channel", "signal name unit")
RATE = 200.0
T = np.arange(1600) / RATE
JOINTS = ("lf_hip", "lf_knee", "rf_hip")
CHANNELS = [*(Channel("q", j, "rad") for j in JOINTS), Channel("gyro", "x", "rad/s")]


def record(feet: bool = False) -> Record:
    q = np.stack([0.5 * np.sin(2 * np.pi * f * T) for f in (0.5, 1.0, 0.7)], axis=1)
    grf = 50.0 * np.stack([np.sin(2 * np.pi * T) > 0, np.sin(2 * np.pi * T) < 0], axis=1)
    signals = {"q": q, **({"grf": grf} if feet else {})}
    command = {"position": q + 0.01}
    names = ("lf_foot", "rf_foot") if feet else ()
    return Record("r", T, command, JOINTS, signals, JOINTS, names)


def noise(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(T), len(CHANNELS)))


def found(residual: np.ndarray, r: Record | None = None) -> localise.GapMap:
    rng = np.random.default_rng(1)
    return localise.localise([r or record()], CHANNELS, [residual], rng)


@pytest.mark.parametrize(
    ("hertz", "band"), [(0.4, "below 1 Hz"), (3.0, "1 to 5 Hz"), (50.0, "above 20 Hz")]
)
@pytest.mark.parametrize("column", [0, 3])
def test_joint_signal_and_band(hertz, band, column):
    r = noise()
    r[:, column] += 8.0 * np.sin(2 * np.pi * hertz * T)
    gap = found(r)
    assert next(iter(gap.by("signal", "joint"))) == CHANNELS[column][:2]
    assert gap.by("signal", "joint")[CHANNELS[column][:2]] > 0.9
    assert gap.by("band")[band,] > 0.9
    assert 1 <= gap.main < len(gap.cells)


def test_shares_add_up_and_intervals_hold_them():
    r = noise()
    r[:, 1] += 5.0
    gap = found(r)
    assert sum(c.share for c in gap.cells) == pytest.approx(1.0)
    assert all(c.low <= c.share <= c.high for c in gap.cells)
    assert sum(c.share for c in gap.cells[: gap.main]) >= 0.8
    assert sum(c.share for c in gap.cells[: gap.main - 1]) < 0.8
    assert gap.cells == found(r).cells


def test_bands_add_up_to_the_residual():
    r = noise()[:, 0]
    r[100:150] = np.nan
    parts = localise.split(r, 1.0 / RATE)
    np.testing.assert_allclose(sum(p for _, p, _ in parts), r, atol=1e-9)
    assert sum(share for _, _, share in parts) == pytest.approx(1.0)


def sparse(every: int) -> np.ndarray:
    """Residual of 0.7 Hz in one joint, known in one row of a few."""
    r = noise()
    r[:, 0] += 10.0 * np.sin(2 * np.pi * 0.7 * T)
    r[np.arange(len(T)) % every != 0] = np.nan
    return r


@pytest.mark.parametrize("every", [2, 5, 8])
def test_rows_that_are_unknown_say_nothing_of_the_frequency(every):
    shares = found(sparse(every)).by("band")
    assert shares["below 1 Hz",] > 0.97


@pytest.mark.parametrize("start", [300, 700])
def test_a_gap_in_the_readings_is_no_fast_residual(start):
    r = noise()
    r[:, 0] += 8.0 + 10.0 * np.sin(2 * np.pi * 0.7 * T)
    r[start : start + 400] = np.nan
    assert found(r).by("band")["below 1 Hz",] > 0.97


def test_noise_that_is_known_in_a_few_rows_is_no_gap():
    r = noise()
    r[np.arange(len(T)) % 5 != 0] = np.nan
    parts = localise.split(r[:, 0], 1.0 / RATE)
    known = np.isfinite(r[:, 0])
    for _, part, share in parts:  # as much in each band as white noise has
        assert np.mean(part[known] ** 2) == pytest.approx(share, rel=0.4)
    assert [name for name, _, _ in parts] == localise.band_names(RATE / 5)


def test_phase_with_and_without_feet():
    stance = np.sin(2 * np.pi * T) > 0
    r = noise()
    r[stance, 1] += 5.0
    by_phase = found(r, record(feet=True)).by("phase")
    assert by_phase["stance",] + by_phase["touchdown",] + by_phase["lift-off",] > 0.9
    turning = np.abs(np.cos(2 * np.pi * T)) < 0.15
    r = noise()
    r[turning, 1] += 5.0
    assert found(r).by("phase")["reversal",] > 0.7


def test_region_of_the_range():
    r = noise()
    r[record().signals["q"][:, 1] > 0.3, 1] += 5.0
    shares = found(r).by("region")
    assert next(iter(shares))[0].startswith("q > 0.1")


def test_no_data_has_no_cells():
    assert found(np.full((len(T), len(CHANNELS)), np.nan)).cells == ()


def test_foot_of_a_joint():
    assert phases.foot_of("lf_knee", ("lf_foot", "rf_foot")) == 0
    assert phases.foot_of("spine", ("lf_foot", "rf_foot")) is None
    assert phases.foot_of("anything", ("toe",)) == 0
    assert phases.foot_of("lf_knee", ()) is None


def test_a_joint_that_stands_rests():
    q = np.zeros((len(T), 1))
    q[800:] = np.sin(2 * np.pi * T[:800])[:, None]
    r = Record("r", T, {"position": q}, ("a",), {"q": q}, ("a",))
    names, index = phases.phases(r, "a")
    assert {names[i] for i in index[50:750]} == {"rest"}
    assert "moving" in {names[i] for i in index[850:]}
    assert phases.phases(r, "x")[0] == phases.ALL_ROWS


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (lambda q, dq: np.abs(dq) < 1.0, "speed <"),
        (lambda q, dq: q > 0.3, "position >"),
        (lambda q, dq: dq < -1.0, "velocity <"),
    ],
)
def test_a_region_is_told_in_words(where, words):
    rec = record()
    q, dq = phases.position(rec, "lf_knee"), phases.speed(rec, "lf_knee")
    r = noise()
    r[where(q, dq), 1] += 5.0
    best = regions.regions([rec], CHANNELS, [r])[0]
    assert str(best).startswith(f"lf_knee, {words}")
    assert best.energy > 0.8
    assert best.time == pytest.approx(where(q, dq).mean(), abs=0.1)


@pytest.mark.parametrize("every", [2, 4])
def test_regions_are_those_of_rows_that_were_measured(every):
    rec, r = record(), noise()
    r[:, 1] *= np.where(phases.position(rec, "lf_knee") > 0.3, 6.0, 1.0)
    whole = regions.regions([rec], CHANNELS, [r])[0]
    r[np.arange(len(T)) % every != 0] = np.nan
    few = regions.regions([rec], CHANNELS, [r])[0]
    cut = 1.0 / regions.CUTS  # thresholds are this share of the samples apart
    assert few.time == pytest.approx(whole.time, abs=cut)
    assert few.energy == pytest.approx(whole.energy, abs=0.1)


def test_a_time_without_readings_is_no_time_without_a_gap():
    r = noise()
    r[:, 0] *= 5.0
    r[T > 4.0] = np.nan
    (region,) = regions.regions([record()], CHANNELS, [r])
    assert region.words == ("everywhere",)


def test_states_of_a_joint_that_slides_are_lengths():
    rec, r = record(), noise()
    r[phases.position(rec, "lf_knee") > 0.3, 1] += 5.0
    slides = [Channel("q", j, "m") for j in JOINTS] + CHANNELS[3:]
    (word,) = regions.regions([rec], slides, [r])[0].words
    assert word.startswith("position >")
    assert word.endswith(" m")


def test_a_contact_phase_is_a_region():
    rec = record(feet=True)
    names, index = phases.phases(rec, "lf_knee")
    r = noise()
    r[index == names.index("stance"), 1] += 5.0
    assert "stance" in regions.regions([rec], CHANNELS, [r])[0].words


def test_a_gap_everywhere_is_said_to_be():
    r = noise()
    r[:, 0] *= 5.0
    (region,) = regions.regions([record()], CHANNELS, [r])
    assert str(region) == "lf_hip, everywhere: no position, speed, time or phase stands out"
