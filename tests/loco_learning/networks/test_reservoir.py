# SPDX-License-Identifier: Apache-2.0
"""A network that drives itself: sensor, mixer, and that a trained body keeps its gait."""

import numpy as np
import pytest
from scipy.signal import firwin, lfilter

from loco_learning.networks.gait import Gait, MsdTask
from loco_learning.networks.reservoir import (
    LOOPS,
    Controller,
    LoopParams,
    Sensor,
    nrmse,
    run_loop,
)
from loco_sim.msd.network import chain

TASK = MsdTask(nodes=10, frequency=1.0)
SHORT = LoopParams(train=8.0, closing=8.0, test=4.0)


@pytest.fixture(scope="module")
def gait():
    """Any periodic motion will do."""
    rng, links = np.random.default_rng(0), chain(TASK.params()).count
    phase = rng.uniform(0.0, 2.0 * np.pi, links)
    return Gait(rng.uniform(0.02, 0.2, links), phase, rng.uniform(40.0, 100.0, links), 1.0)


@pytest.fixture(scope="module")
def log(gait):
    return run_loop(TASK.params(), gait, SHORT)


def test_sensor_is_a_low_pass_filter_with_three_samples():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(300, 4, 2))
    sensor = Sensor(8, LoopParams(), 0.005)
    seen = np.array([sensor.step(row) for row in a])
    flat = np.moveaxis(a, 2, 1).reshape(300, 8)
    expected = lfilter(firwin(120, 6.0, fs=200.0), 1.0, flat, axis=0)
    np.testing.assert_allclose(seen[:, :8], expected, atol=1e-12)
    np.testing.assert_array_equal(seen[1:, 8:16], seen[:-1, :8])
    np.testing.assert_array_equal(seen[2:, 16:], seen[:-2, :8])


def test_the_authors_buffer_never_shows_the_newest_sample():
    latest, author = (
        Sensor(2, LoopParams(taps=1, buffer=kind), 0.005) for kind in ("latest", "author")
    )
    for k in range(5):
        a = np.full((1, 2), float(k))
        newest, old = latest.step(a), author.step(a)
    np.testing.assert_array_equal(newest, [4, 4, 3, 3, 2, 2])
    np.testing.assert_array_equal(old, [3, 3, 2, 2, 2, 2])


def test_a_threshold_clips_what_is_sensed():
    sensor = Sensor(2, LoopParams(taps=1, threshold=5.0), 0.005)
    np.testing.assert_array_equal(sensor.step(np.array([[9.0, -9.0]]))[:2], [5.0, -5.0])


def test_the_mixer_grows_to_beta_and_then_lets_go():
    links = chain(TASK.params()).count
    gait = Gait(np.zeros(links), np.zeros(links), np.full(links, 50.0), 1.0)
    c = Controller(gait, 10, 2, LoopParams(train=1.0, closing=2.0, test=1.0, beta=0.9), 0.005)
    assert [c.share(k) for k in (0, 199, 200, 400)] == [0.0, 0.0, 0.0, 0.45]
    assert c.share(599) == pytest.approx(0.9, abs=0.01)
    assert c.share(600) == c.share(799) == 1.0


def test_a_trained_body_keeps_its_gait_without_a_target(log):
    closing, test, end = log.starts
    assert (closing, test, end) == (8.0, 16.0, 20.0)
    assert not log.diverged
    assert nrmse(log, 7.0, 8.0) < 0.02
    assert nrmse(log, test, end) < 0.1
    swing = np.ptp(log.said[log.t > test], axis=0) / np.ptp(log.target[log.t > test], axis=0)
    assert np.median(swing) > 0.7


def test_a_loop_repeats(gait, log):
    again = run_loop(TASK.params(), gait, SHORT)
    np.testing.assert_array_equal(again.said, log.said)
    np.testing.assert_array_equal(again.distance, log.distance)


def test_weights_stay_as_they_are_in_the_test(gait):
    c = Controller(gait, 10, 2, LoopParams(train=0.1, closing=0.1, test=0.5), 0.005)
    rng = np.random.default_rng(0)
    for k in range(100):
        c.step(rng.normal(size=(10, 2)))
        if k == 39:
            trained = c.readout.weights.copy()
    np.testing.assert_array_equal(c.readout.weights, trained)
    assert trained.any()


def test_the_authors_loop_runs(gait):
    loop = LOOPS["author_code"].replace(train=1.0, closing=0.5, test=0.5)
    log = run_loop(TASK.params(), gait, loop)
    assert np.isfinite(log.said).all()
    assert (np.abs(log.said - 1.0) <= 1.0).all()  # 1 + tanh
