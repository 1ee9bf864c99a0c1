# SPDX-License-Identifier: Apache-2.0
"""Metrics of joint robots on made-up runs whose answers are known."""

import numpy as np
import pytest

from loco_control.orientation import quaternion
from loco_control.oscillators import CpgParams
from loco_learning import joint_metrics as metrics
from loco_learning.joint_experiment import JointExperiment
from loco_learning.joint_log import JointLog, empty
from loco_learning.joint_metrics import METRICS
from loco_learning.joint_reflex import JointLearnerParams

TIMES = {"stand": 1.0, "train": 5.0, "closing": 5.0, "test": 9.0}


def made(enabled=True, heading=0.0, lag=0.0, scale=1.0, fall=""):
    """20 s at 0.1 m/s along a heading; hips at 1 Hz, the prediction late and of another size."""
    learner = JointLearnerParams(enabled=enabled, **TIMES)
    experiment = JointExperiment(target=CpgParams(frequency=1.0), learner=learner, duration=20.0)
    columns = empty(experiment, 2000)
    t = columns["t"] = np.arange(2000) * 0.01
    columns["position"][:, :2] = np.outer(0.1 * t, (np.cos(heading), np.sin(heading)))
    columns["position"][:, 2] = 0.14 + 0.01 * np.sin(2.0 * np.pi * t)
    columns["orientation"][:] = quaternion(0.0, 0.1, heading)
    wave = np.sin(2.0 * np.pi * t[:, None] + np.array([0.0, 0.0, np.pi, np.pi]))
    late = scale * np.sin(2.0 * np.pi * (t[:, None] - lag) + np.array([0.0, 0.0, np.pi, np.pi]))
    columns["target"], columns["prediction"] = 0.4 * wave, 0.4 * late
    columns["phase"] = np.searchsorted([1.0, 6.0, 11.0], t, side="right")
    closing = columns["phase"] >= 2
    columns["command"] = np.where(closing[:, None], columns["prediction"], columns["target"])
    driven = experiment.plant.driven
    columns["q"][:, driven] = columns["command"]
    columns["dq"][:, driven], columns["tau"][:, driven] = 2.0, 0.5
    columns["q"][:, driven + 1] = 1.0 + 0.3 * wave
    return JointLog(columns, experiment, 0, fall)


def test_phases_are_those_of_the_learner_or_one():
    assert metrics.phases(made()) == {
        "stand": slice(0, 100), "train": slice(100, 600),
        "closing": slice(600, 1100), "test": slice(1100, 2000),
    }  # fmt: skip
    assert metrics.phases(made(enabled=False)) == {"open loop": slice(0, 2000)}
    assert list(metrics.phases(made().cut(slice(0, 700)))) == ["stand", "train", "closing"]


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_is_documented_and_finite(name):
    table = metrics.table(made())
    assert METRICS[name].doc.endswith(".")
    assert METRICS[name].unit
    assert list(table) == ["train", "closing", "test"]
    assert np.isfinite(table["test"][name])
    if METRICS[name].learner:
        assert np.isnan(metrics.table(made(enabled=False))["open loop"][name])


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.1])
def test_distance_counts_along_the_heading(heading):
    row = metrics.table(made(heading=heading))["test"]
    assert row["distance"] == pytest.approx(0.8990, abs=1e-3)
    assert row["speed"] == pytest.approx(0.1, rel=1e-6)
    assert row["forward_speed"] == pytest.approx(0.1, rel=1e-6)
    assert row["lateral_drift"] == pytest.approx(0.0, abs=1e-9)
    assert row["heading_drift"] == pytest.approx(0.0, abs=1e-9)


def test_forward_speed_is_that_of_a_robot_in_a_circle():
    log = made()
    angle = 0.2 * log.t
    log.columns["position"][:, :2] = 0.5 * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)
    log.columns["orientation"] = np.array([quaternion(0.0, 0.0, a) for a in angle])
    row = metrics.table(log)["test"]
    assert row["forward_speed"] == pytest.approx(0.1, rel=1e-3)
    assert row["speed"] < 0.06
    assert row["heading_drift"] == pytest.approx(0.2 * 8.99, rel=1e-3)


def test_the_numbers_follow_their_equations():
    row = metrics.table(made())["test"]
    assert row["stability"] == pytest.approx(0.02, rel=1e-3)
    assert row["power"] == pytest.approx(4 * 2.0 * 0.5)
    assert row["cost_of_transport"] == pytest.approx(4.0 / (0.95 * 9.81 * 0.1), rel=0.01)
    assert row["passive_range"] == pytest.approx(0.6, rel=1e-3)
    assert row["stride_frequency"] == pytest.approx(1.0, rel=1e-3)
    assert row["tracking_error"] == 0.0
    assert row["nrmse"] == 0.0


def test_a_late_prediction_is_an_error_of_the_clock_not_of_the_shape():
    row = metrics.table(made(lag=0.2))["test"]
    assert row["phase_lag"] == pytest.approx(0.2, abs=0.01)
    assert row["nrmse"] == pytest.approx(np.sin(0.2 * np.pi) / np.sqrt(2.0), rel=0.01)
    assert row["shape_error"] < 0.01
    small = metrics.table(made(lag=0.2, scale=0.5))["test"]
    assert small["shape_error"] == pytest.approx(0.5 / np.sqrt(8.0), rel=0.02)


def test_the_verdict_names_what_failed():
    assert metrics.judge(made()).survived
    assert metrics.judge(made(fall="roll")).failed == ["fall"]
    assert "freeze" in metrics.judge(made(scale=0.1)).failed
    assert metrics.judge(made(lag=0.25)).failed == ["nrmse"]
    open_loop = metrics.judge(made(enabled=False))
    assert open_loop.survived
    assert np.isnan(open_loop.nrmse)
    assert metrics.judge(made().cut(slice(0, 0))).end == 0.0
