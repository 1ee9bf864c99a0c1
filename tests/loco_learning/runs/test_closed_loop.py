# SPDX-License-Identifier: Apache-2.0
"""Step two on Tigrillo itself: the readout takes over, and it is the body that keeps the beat."""

import numpy as np
import pytest

from loco_learning.metrics import registry as metrics
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import build, rollout
from loco_learning.study import figures, study
from loco_learning.study.case import reduce

SHORT = {"learner.train": 8.0, "learner.closing": 4.0, "learner.test": 4.0}


@pytest.fixture(scope="module")
def log():
    return rollout(load("tigrillo_bound_reflex", SHORT))


def test_tigrillo_bounds_on_by_its_readout_alone(log):
    assert not log.fall
    assert log.complete
    test = metrics.table(log)["test"]
    assert test["shape_error"] < 0.1
    assert abs(test["phase_lag"]) < 0.3  # stride, in four strides
    assert test["passive_range"] > 0.7 * metrics.table(log)["train"]["passive_range"] > 0.1
    ticks = log.phases()["test"]
    assert np.all(log.command[ticks] == log.prediction[ticks, :4])
    assert np.all(np.any(log.command[ticks] != log.target[ticks], axis=1))


def test_without_the_body_the_beat_dies(log):
    loop = build(load("tigrillo_bound_reflex", SHORT))
    feel = loop.feel
    start = log.phases()["test"].start
    loop.feel = lambda state: feel(state) if state.tick < start else np.zeros(9)
    commands = [loop.step()["command"].q for _ in range(start + 300)]
    loop.close()
    assert np.ptp(commands[start - 200 : start], axis=0).min() > 0.3
    assert np.ptp(commands[-200:], axis=0).max() < 1e-9


def test_same_seed_same_run_another_seed_another_network(log):
    again = rollout(load("tigrillo_bound_reflex", SHORT), until=10.0)
    np.testing.assert_array_equal(again.command, log.command[:1000])
    other = rollout(load("tigrillo_bound_reflex", SHORT), seed=1, until=2.0)
    assert not np.array_equal(other.prediction, log.prediction[:200])


def test_a_study_keeps_verdict_metrics_and_curves(log, tmp_path):
    result = reduce(log, "bound_0", "bound")
    result.save(tmp_path / "bound_0.npz")
    assert result.verdict["survived"]
    assert result.metrics["test"]["speed"] == metrics.table(log)["test"]["speed"]
    assert result.curves["test_trace_passive"].shape == (300, 4)
    assert result.curves["cycle"].shape == (400, 2)
    for name in ("joint_traces", "nrmse_over_time", "limit_cycles", "trunk"):
        frames = figures.FIGURES[name](None, [result]).frames
        assert any(len(layer.x) > 10 for frame in frames for layer in frame.layers)


def test_the_shipped_study_compares_robots_of_joints():
    loaded = study.load("tigrillo_closed_loop")
    assert len(loaded.seeds) >= 5
    assert set(loaded.metrics) <= set(metrics.METRICS)
    assert {e.node_set for e in loaded.variants.values()} == {"joint"}
