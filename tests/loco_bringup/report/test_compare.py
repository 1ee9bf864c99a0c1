# SPDX-License-Identifier: Apache-2.0
"""Runs side by side: equal runs do not differ, others do; other robots are refused."""

import dataclasses

import numpy as np
import pytest

from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import compare
from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout


@pytest.fixture(scope="module")
def log():
    return rollout(load("servo_pendulum_sine", {"duration": 12.0}))


def test_a_run_and_itself_do_not_differ(log):
    page = compare.page({"a": log, "b": log})
    assert "metrics differ from a beyond noise" in page and ">0 of " in page
    assert "alike to the last bit" in page and "Not shown" not in page.partition("Base</h2>")[0]


def test_a_phase_too_short_to_tell_noise_is_not_judged(log):
    short = log.cut(slice(0, 4))  # pieces of no tick
    page = compare.page({"a": short, "b": short})
    assert "not judged: the phase is too short" in page and "beyond noise</" not in page
    assert "± –" not in page


def test_a_run_that_is_longer_alone_does_not_differ(log):
    short = log.cut(slice(0, len(log) * 2 // 3))
    phase = list(log.phases())[-1]
    assert not any(row[-1] for row in compare.differences({"a": log, "b": short}, phase))


def test_a_torque_that_is_larger_is_beyond_noise(log):
    other = dataclasses.replace(log, columns={**log.columns, "tau": 1.5 * log.tau})
    rows = compare.differences({"a": log, "b": other}, list(log.phases())[-1])
    assert "torque_max" in {row[0] for row in rows if row[-1]}


def test_joints_of_all_runs_lie_on_the_same_axes(log):
    short = log.cut(slice(0, 50))
    plot = compare.joints({"a": log, "b": short})
    one, other = plot.panels[0].lines
    assert (one.name, other.name) == ("a", "b") and len(plot.x) == len(log)
    np.testing.assert_array_equal(one.values[:50], other.values[:50])
    assert np.isnan(other.values[50:]).all()


def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path):
    for name in ("servo_pendulum_sine", "tigrillo_hold"):
        run_rollout(load(name, {"duration": 0.5}),
                    tmp_path / name, lambda progress: None)  # fmt: skip
    one, other = tmp_path / "servo_pendulum_sine", tmp_path / "tigrillo_hold"
    with pytest.raises(ParameterError, match="compare runs of one robot"):
        compare.read_runs([one, other])
    with pytest.raises(ParameterError, match="2 to 8 bags"):
        compare.read_runs([one])
    with pytest.raises(ParameterError, match="one name"):
        compare.read_runs([one, one])
