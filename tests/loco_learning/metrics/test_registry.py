# SPDX-License-Identifier: Apache-2.0
"""Every metric on real runs and on made-up ones whose answers are known, and the verdicts."""

import dataclasses

import numpy as np
import pytest

from loco_control.gait.oscillators import CpgParams
from loco_control.orientation import quaternion
from loco_learning.metrics import quantities
from loco_learning.metrics import registry as metrics
from loco_learning.metrics.registry import METRICS
from loco_learning.params import CriterionParams, JointLearnerParams
from loco_learning.runs.experiment import Experiment, load
from loco_learning.runs.log import REFLEX_TIME, Log, empty
from loco_learning.runs.rollout import rollout
from loco_learning.study import trial


@pytest.fixture(scope="module")
def table(short_log):
    return metrics.table(short_log)


def shifted(log, strides=0.0, scale=1.0, fall=""):
    """The run with another prediction in closing and test: late, or smaller."""
    ticks = round(strides / 1.7 / log.dt)
    wanted = quantities.outputs_wanted(log)
    late = np.roll(wanted, ticks, axis=0)
    middle = wanted.mean(axis=0)
    changed = log.changed(prediction=middle + scale * (late - middle))
    return dataclasses.replace(changed, fall=fall)


BRIEF = {"stride_frequency", "prediction_frequency"}  # want more strides than these runs have


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_is_documented_and_finite_on_a_gait(table, name):
    assert METRICS[name].doc.endswith(".")
    assert METRICS[name].unit
    assert METRICS[name].equation
    assert set(table) == {"train", "closing", "test"}
    assert (name in table["train"]) == (name != "passive_range")  # HyQ has no passive joint
    if name in table["train"] and name not in BRIEF:
        assert np.isfinite(table["train"][name])


def test_what_a_log_lacks_is_absent_and_the_rest_is_as_before(short_log, table):
    lacking = {
        "grf": {"grf_max", "grf_snr", "step_length"},
        "position": {"distance", "speed", "forward_speed", "speed_ratio", "lateral_drift",
                     "stability", "cost_of_transport", "positive_cost_of_transport",
                     "step_length", "saturated_score"},
        "reflex_time": {"step_time"},
    }  # fmt: skip
    for column, names in lacking.items():
        columns = {name: values for name, values in short_log.columns.items() if name != column}
        nothing = short_log.changed(**{column: np.full_like(short_log.columns[column], np.nan)})
        for log in (dataclasses.replace(short_log, columns=columns), nothing):
            if column == "grf" and log is not nothing:
                continue  # a robot with legs has its forces in every message
            found = METRICS.keys() - {n for n in METRICS if METRICS[n].suits(log)}
            assert found == names | {"passive_range"}
    blind = short_log.changed(position=np.full_like(short_log.position, np.nan))
    row = metrics.table(blind)["train"]
    assert {name: table["train"][name] for name in row if name not in BRIEF} == {
        name: value for name, value in row.items() if name not in BRIEF
    }


def test_the_numbers_are_those_of_a_trot(table):
    train = table["train"]
    assert train["stability"] < 0.05
    assert 0.07 < train["step_height"] < 0.14
    assert 0.05 < train["foot_travel"] < 0.12
    assert train["step_length"] == pytest.approx(train["speed"] / train["stride_frequency"])
    assert 0.4 < train["duty_factor"] < 0.65
    assert 400.0 < train["grf_max"] < 3000.0
    assert 0.0 < train["power"] < train["positive_power"] < 500.0
    assert train["cost_of_transport"] == pytest.approx(
        train["power"] / (84.76 * 9.81 * train["speed"])
    )
    assert train["positive_cost_of_transport"] == pytest.approx(
        train["positive_power"] / (84.76 * 9.81 * train["forward_speed"])
    )
    assert train["accuracy"] == pytest.approx(1.0 / train["nrmse"])
    assert train["accuracy_author"] == pytest.approx(1.0 / train["nrmse_author"])
    assert train["mawe"] <= train["mae"] + 1e-12
    assert train["limit_cycle_size"] == pytest.approx(1.0, abs=0.1)


def test_a_metric_of_the_network_makes_no_sense_without_one():
    log = rollout(load("hyq_trot_open", {"learner.train": 2.0}))
    assert list(metrics.table(log)) == ["open loop"]
    names = {name for name, each in METRICS.items() if not each.learner} - {"passive_range"}
    assert set(metrics.table(log)["open loop"]) == names
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
    start = short_log.phase_of("closing").start
    slow = np.arange(n, dtype=float)
    slow[start:] = start + 0.3 * (slow[start:] - start)
    wanted = quantities.outputs_wanted(short_log)
    late = np.stack([np.interp(slow, np.arange(n), column) for column in wanted.T], axis=1)
    verdict = trial.judge(short_log.changed(prediction=late))
    assert "phase_slip" in verdict.failed
    assert verdict.lag > 1.0


def test_the_bounds_are_those_of_the_criterion(short_log):
    strict = CriterionParams(nrmse=1e-6, phase_slip=1e-6, freeze=1.0)
    assert {"nrmse", "phase_slip"} <= set(trial.judge(short_log, strict).failed)
    lenient = CriterionParams(fall=False, nrmse=10.0, phase_slip=10.0, freeze=0.0)
    assert trial.judge(shifted(short_log, 0.5, 0.01, "fell"), lenient).survived


# ---- a robot of joints, made up

TIMES = {"stand": 1.0, "train": 5.0, "closing": 5.0, "test": 9.0}


def made(enabled=True, heading=0.0, lag=0.0, scale=1.0, fall=""):
    """20 s at 0.1 m/s along a heading; hips at 1 Hz, the prediction late and of another size."""
    learner = JointLearnerParams(enabled=enabled, **TIMES)
    experiment = Experiment(
        robot="tigrillo", target=CpgParams(frequency=1.0), learner=learner, duration=20.0
    )
    columns = empty(experiment, 2000)
    t = columns["t"] = np.arange(2000) * 0.01
    columns["position"][:, :2] = np.outer(0.1 * t, (np.cos(heading), np.sin(heading)))
    columns["position"][:, 2] = 0.14 + 0.01 * np.sin(2.0 * np.pi * t)
    columns["orientation"][:] = quaternion(0.0, 0.1, heading)
    wave = np.sin(2.0 * np.pi * t[:, None] + np.array([0.0, 0.0, np.pi, np.pi]))
    late = scale * np.sin(2.0 * np.pi * (t[:, None] - lag) + np.array([0.0, 0.0, np.pi, np.pi]))
    columns["target"], columns["prediction"][:, :4] = 0.4 * wave, 0.4 * late
    columns["target_dq"] = np.gradient(columns["target"], 0.01, axis=0)
    columns["prediction"][:, 4:] = np.gradient(0.4 * late, 0.01, axis=0)
    columns["phase"] = np.searchsorted([1.0, 6.0, 11.0], t, side="right")
    closing = columns["phase"] >= 2
    columns["command"] = np.where(closing[:, None], 0.4 * late, 0.4 * wave)
    driven = experiment.plant.driven
    columns["q"][:, driven] = columns["command"]
    columns["dq"][:, driven], columns["tau"][:, driven] = 2.0, 0.5
    columns["q"][:, driven + 1] = 1.0 + 0.3 * wave
    columns["grf"][:, :, 2], columns["contact"][:, :] = 2.0 + np.sin(6.0 * t)[:, None], True
    columns[REFLEX_TIME] = np.full(2000, 1e-5)
    if not enabled:
        columns["phase"][:] = 1
    return Log(columns, experiment, 0, fall)


def test_phases_are_those_of_the_learner_or_one():
    assert made().phases() == {
        "stand": slice(0, 100), "train": slice(100, 600),
        "closing": slice(600, 1100), "test": slice(1100, 2000),
    }  # fmt: skip
    assert made(enabled=False).phases() == {"open loop": slice(0, 2000)}
    assert list(made().cut(slice(0, 700)).phases()) == ["stand", "train", "closing"]


def test_a_robot_of_joints_has_every_metric_but_the_speed_that_nobody_asked_for():
    table = metrics.table(made(lag=0.01))
    assert list(table) == ["train", "closing", "test"]
    assert set(table["test"]) == METRICS.keys() - {"speed_ratio"}
    assert all(np.isfinite(value) for value in table["test"].values())
    open_loop = metrics.table(made(enabled=False))["open loop"]
    assert set(open_loop) == {n for n in table["test"] if not METRICS[n].learner}


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
    for name in ("cost_of_transport", "positive_cost_of_transport"):
        assert row[name] == pytest.approx(4.0 / (0.95 * 9.81 * 0.1), rel=0.01)
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
    assert trial.judge(made()).survived
    assert trial.judge(made(fall="roll")).failed == ["fall"]
    assert "freeze" in trial.judge(made(scale=0.1)).failed
    assert trial.judge(made(lag=0.25)).failed == ["nrmse"]
    open_loop = trial.judge(made(enabled=False))
    assert open_loop.survived
    assert np.isnan(open_loop.nrmse)
    assert trial.judge(made().cut(slice(0, 0))).end == 0.0
