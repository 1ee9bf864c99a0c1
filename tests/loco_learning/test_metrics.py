# SPDX-License-Identifier: Apache-2.0
"""Every metric on a real run, and the verdict on runs whose failure is known."""

import dataclasses

import numpy as np
import pytest

from loco_learning import metrics, trial
from loco_learning.experiment import load
from loco_learning.metrics import METRICS
from loco_learning.params import CriterionParams
from loco_learning.rollout import rollout


@pytest.fixture(scope="module")
def table(short_log):
    return metrics.table(short_log)


def shifted(log, strides=0.0, scale=1.0, fall=""):
    """The run with another prediction in closing and test: late, or smaller."""
    ticks = round(strides / 1.7 / log.dt)
    wanted = metrics.outputs_wanted(log)
    late = np.roll(wanted, ticks, axis=0)
    middle = wanted.mean(axis=0)
    learning = dataclasses.replace(log.learning, prediction=middle + scale * (late - middle))
    return dataclasses.replace(log, learning=learning, fall=fall)


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_is_documented_and_finite_on_a_gait(table, name):
    assert METRICS[name].doc.endswith(".")
    assert METRICS[name].unit
    assert METRICS[name].equation
    assert set(table) == {"train", "closing", "test"}
    if name not in ("stride_frequency", "prediction_frequency"):
        assert np.isfinite(table["train"][name])


def test_the_numbers_are_those_of_a_trot(table):
    train = table["train"]
    assert train["stability"] < 0.05
    assert 0.07 < train["step_height"] < 0.14
    assert 0.05 < train["step_length"] < 0.12
    assert 0.4 < train["duty_factor"] < 0.65
    assert 400.0 < train["grf_max"] < 3000.0
    assert 0.0 < train["power"] < train["positive_power"] < 500.0
    assert train["cost_of_transport"] == pytest.approx(
        train["power"] / (84.76 * 9.81 * train["speed"])
    )
    assert train["accuracy"] == pytest.approx(1.0 / train["nrmse"])
    assert train["mawe"] <= train["mae"] + 1e-12
    assert train["limit_cycle_size"] == pytest.approx(1.0, abs=0.1)


def test_a_metric_of_the_network_makes_no_sense_without_one():
    log = rollout(load("hyq_trot_open", {"learner.train": 2.0}))
    train = metrics.table(log)["train"]
    for name, metric in METRICS.items():
        assert np.isnan(train[name]) == (metric.learner or name == "stride_frequency"), name
    assert trial.judge(log).survived
    assert np.isnan(trial.judge(log).nrmse)


def test_too_short_an_interval_is_not_a_number(short_log):
    assert np.isnan(METRICS["speed"](short_log, slice(0, 100)))
    assert np.isnan(METRICS["speed"](short_log, slice(0, 0)))


def test_a_good_run_survives(short_log):
    verdict = trial.judge(short_log)
    assert verdict.survived
    assert verdict.failed == []
    assert verdict.end == pytest.approx(5.996)
    assert verdict.nrmse < 0.15
    assert abs(verdict.lag) < 0.05
    assert verdict.amplitude == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize(
    ("change", "failed"),
    [
        ({"strides": 0.05}, []),
        ({"strides": 0.25}, ["nrmse"]),
        ({"scale": 0.8}, []),
        ({"scale": 0.1}, ["freeze", "nrmse"]),
        ({"fall": "height 0.3 m"}, ["fall"]),
    ],
)
def test_each_failure_is_named(short_log, change, failed):
    assert trial.judge(shifted(short_log, **change)).failed == failed


def test_a_slow_rhythm_slips_a_stride(short_log):
    n = len(short_log)
    start = short_log.phase("closing").start
    slow = np.arange(n, dtype=float)
    slow[start:] = start + 0.3 * (slow[start:] - start)
    wanted = metrics.outputs_wanted(short_log)
    late = np.stack([np.interp(slow, np.arange(n), column) for column in wanted.T], axis=1)
    learning = dataclasses.replace(short_log.learning, prediction=late)
    verdict = trial.judge(dataclasses.replace(short_log, learning=learning))
    assert "phase_slip" in verdict.failed
    assert verdict.lag > 1.0


def test_the_bounds_are_those_of_the_criterion(short_log):
    strict = CriterionParams(nrmse=1e-6, phase_slip=1e-6, freeze=1.0)
    assert {"nrmse", "phase_slip"} <= set(trial.judge(short_log, strict).failed)
    lenient = CriterionParams(fall=False, nrmse=10.0, phase_slip=10.0, freeze=0.0)
    assert trial.judge(shifted(short_log, 0.5, 0.01, "fell"), lenient).survived
