# SPDX-License-Identifier: Apache-2.0
"""The correction predicts what follows from the states, nothing else, and says what it is."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from loco_learning.gap.localisation import correction
from loco_learning.gap.recordings.record import Record

Channel = namedtuple("Channel", "signal name unit")
T = np.arange(2000) / 200.0
CHANNELS = [Channel("q", "a", "rad"), Channel("q", "b", "rad"), Channel("gyro", "x", "rad/s")]
FLOOR = np.array([0.01, 0.01, 0.01])


def record(speed: float = 1.0) -> Record:
    q = np.stack([np.sin(2 * np.pi * f * speed * T + f) for f in (0.7, 1.1)], axis=1)
    return Record("r", T, {"position": q}, ("a", "b"), {"q": q}, ("a", "b"))


def residual(r: Record, law, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    values = 0.01 * rng.normal(size=(len(T), 3))
    values[:, 0] += law(r.signals["q"][:, 0])
    return values


def test_what_follows_from_the_state_is_predicted_elsewhere():
    records = [record(), record(1.3)]
    law = lambda q: 0.1 * q**3 - 0.05 * q  # noqa: E731
    found = correction.fit(records, CHANNELS, [residual(r, law) for r in records], FLOOR)
    assert found.kind == correction.KIND == "correction: not an explanation"
    assert [(c.signal, c.name) for c in found.channels] == [("q", "a")]
    other = record(0.8)
    np.testing.assert_allclose(
        found.predict(other, "q", "a"), law(other.signals["q"][:, 0]), atol=0.005
    )
    assert (found.predict(other, "q", "b") == 0.0).all()


def test_noise_is_not_corrected():
    r = record()
    hits = [
        correction.fit([r], CHANNELS, [residual(r, np.zeros_like, s)], FLOOR) for s in range(10)
    ]
    assert hits == [None] * 10


def test_share_is_that_of_the_whole_gap():
    r = record()
    y = residual(r, lambda q: 0.1 * q)
    found = correction.fit([r], CHANNELS, [y], FLOOR)
    left = y[:, 0] - found.predict(r, "q", "a")
    share = 1.0 - (np.sum(left**2) + np.sum(y[:, 1:] ** 2)) / np.sum(y**2)
    assert found.explained == pytest.approx(share, abs=0.03)


def test_gaps_are_left_out_and_too_little_data_gives_nothing():
    r = record()
    y = residual(r, lambda q: 0.1 * q)
    y[500:900] = np.nan
    assert correction.fit([r], CHANNELS, [y], FLOOR).channels[0].explained > 0.9
    y[50:] = np.nan
    assert correction.fit([r], CHANNELS, [y], FLOOR) is None


def test_the_body_is_corrected_from_all_joints():
    r = record()
    y = residual(r, np.zeros_like)
    y[:, 2] += 0.1 * r.signals["q"][:, 1]
    (channel,) = correction.fit([r], CHANNELS, [y], FLOOR).channels
    assert channel.name == "x"
    assert {name.split()[0] for name in channel.weights} == {"1", "a", "b"}
