# SPDX-License-Identifier: Apache-2.0
"""Runs side by side: equal runs do not differ, pushed ones do; other robots are refused."""

import dataclasses

import numpy as np
import pytest

from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import compare
from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout

SINE = "servo_pendulum_sine"


@pytest.fixture(scope="module")
def log():
    return rollout(load(SINE, {"duration": 12.0}))


def test_a_run_and_itself_do_not_differ(log):
    page = compare.page({"a": log, "b": log})
    assert "no difference from a in 4 metrics" in page and "nothing differs" in page
    assert "alike to the last bit" in page and "Not shown" not in page
    assert 'id="base"' not in page  # it is bolted


def test_a_phase_too_short_to_be_judged_is_grey_and_says_what_is_enough(log):
    short = log.cut(slice(0, 500))
    page = compare.page({"a": short, "b": short})
    assert 'class="verdict grey"' in page
    assert "too short to be judged: “open loop” lasts 5 s, 12 s are enough" in page
    assert "differs from" not in page and "no difference" not in page
    assert "no difference from" in compare.page({"a": log, "b": log})  # 12 s, as it says


def test_a_run_that_is_longer_alone_does_not_differ(log):
    longer = rollout(load(SINE, {"duration": 14.0}))
    assert not any(one.differing for one in compare.compared({"a": log, "b": longer}))


def test_a_run_that_fell_differs_whatever_its_metrics_say(log):
    fell = dataclasses.replace(log, fall="roll 1 rad is beyond 0.8 rad")
    said, well = compare.verdict({"a": log, "b": fell}, compare.compared({"a": log, "b": fell}))
    assert (said, well) == ("b differs from a", False)
    assert "b fell at 11.99 s: roll 1 rad" in compare.page({"a": log, "b": fell})


def test_what_differs_is_named_at_the_top_and_in_the_terminal(log, tmp_path, capsys, monkeypatch):
    other = log.changed(tau=1.5 * log.tau)
    page = compare.page({"a": log, "b": other})
    assert "b differs from a" in page and "torque max" in page.partition("<nav")[0]
    monkeypatch.setattr(compare, "read_runs", lambda bags: {"a": log, "b": other})
    options = type("Options", (), {"bag": [], "out": tmp_path / "compare.html"})
    assert compare.show_comparison(options) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "b differs from a" in shown and "torque max" in shown and "compare.html" in shown


def test_joints_of_all_runs_lie_on_the_same_axes(log):
    short = log.cut(slice(0, 50))
    plot = compare.joints({"a": log, "b": short})
    one, other = plot.panels[0].lines
    assert (one.name, other.name) == ("a", "b") and len(plot.x) == len(log)
    np.testing.assert_array_equal(one.values[:50], other.values[:50])
    assert np.isnan(other.values[50:]).all()


def test_more_runs_than_colours_are_dashed(log):
    (panel, *_) = compare.joints({str(k): log for k in range(10)}).panels
    looks = [(line.color, line.dashed) for line in panel.lines]
    assert len(set(looks)) == 10 and looks[0][0] == looks[8][0]


def test_what_cannot_be_compared_is_refused_in_a_line(tmp_path):
    for name in (SINE, "tigrillo_hold"):
        run_rollout(load(name, {"duration": 0.5}),
                    tmp_path / name, lambda progress: None)  # fmt: skip
    one, other = tmp_path / SINE, tmp_path / "tigrillo_hold"
    with pytest.raises(ParameterError, match="compare runs of one robot"):
        compare.read_runs([one, other])
    with pytest.raises(ParameterError, match="2 to 16 bags"):
        compare.read_runs([one])
    with pytest.raises(ParameterError, match="one name"):
        compare.read_runs([one, one])
