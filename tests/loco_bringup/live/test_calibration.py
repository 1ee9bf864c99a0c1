# SPDX-License-Identifier: Apache-2.0
"""Two robots over topics, one fitted to the other while both run, in one bag."""

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.calibrate.bag import read_recording
from loco_bringup.cli.main import main
from loco_bringup.live import run as live
from loco_bringup.report.live_log import is_live, read_live
from loco_bringup.report.report import write_report
from loco_control.exceptions import BagError, ParameterError
from loco_learning.calibration.params import CalibrationParams
from loco_learning.runs.experiment import load
from loco_sim.plant import model as models

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

# Fast enough to see ten periods in ten seconds; the hind springs of the "real" robot are stiffer.
MEASURED = {
    "target.frequency": 1.0,
    "target.offset": [0.0],
    "target.amplitude": [0.35],
    "overrides": {"springs.[lr]h_kfe_joint.stiffness": 440.0},
}
SMALL = CalibrationParams(generations=2, population=8, periods=1, sigma=0.2)
SHORT = live.LiveParams(listen=3.0, after=2, speed=1.5)


def calibrate(folder, options=SMALL, tell=lambda progress: None):
    measured = load("tigrillo_sine", MEASURED)
    return live.run_live(live.Calibration, measured, "tigrillo", folder, options, SHORT, tell)


@pytest.fixture(scope="module")
def told():
    """Progress as it was told during the run of `outcome`."""
    return []


@pytest.fixture(scope="module")
def outcome(told, tmp_path_factory):
    def tell(progress):
        told.append((progress.phase, progress.generation, len(progress.gaps)))

    return calibrate(tmp_path_factory.mktemp("live") / "bag", tell=tell)


@pytest.fixture(scope="module")
def run(outcome):
    return read_live(Bag(outcome.folder))


def test_it_ends_cleanly_and_tells_how_far_it_is(outcome, told):
    assert outcome.status == "done"
    assert outcome.exit_code == 0
    assert set(outcome.run.exit_codes) == {
        "measured/nodes",
        "model/nodes",
        "calibrator",
        "recorder",
    }
    assert set(outcome.run.exit_codes.values()) == {0}
    phases = list(dict.fromkeys(phase for phase, _, _ in told))
    assert phases == ["starting", "listening", "fitting", "done"]
    assert max(generation for _, generation, _ in told) == 2


def test_the_bag_holds_both_robots_and_lost_no_tick(outcome):
    bag = Bag(outcome.folder)
    for robot in ("measured", "model"):
        states = bag.records(f"/{robot}/joint_states")
        t = states["header.stamp.sec"] + states["header.stamp.nanosec"] / 1e9
        np.testing.assert_allclose(np.diff(t), 0.01, atol=1e-9)
        assert bag.topics[f"/{robot}/joint_command"].count > 500
    assert bag.metadata["dropped"] == "0"


def test_the_model_robot_changes_while_it_runs_and_the_gap_shrinks(run):
    number, gap, mixed = run.gap[:, 2], run.gap[:, 1], run.gap[:, 3]
    assert len(run.swaps) >= 1
    before, after = gap[number == 0], gap[(number == len(run.swaps)) & (mixed == 0.0)]
    assert len(before) >= 2
    assert len(after) >= 1
    assert after.mean() < 0.8 * before[mixed[number == 0] == 0.0].mean()


def test_the_result_is_the_model_that_ran_last(outcome, run):
    result = outcome.result
    assert result.loss_after < result.loss_before
    model = models.load(outcome.folder / live.RESULT)
    assert model == models.loads(result.model_yaml)
    sent = run.bag.messages("/model/model")[-1].data
    assert models.loads(sent) == model
    assert dict(zip(result.names, result.values, strict=True)) == {
        p.name: value for p, value in run.parameters()
    }


def test_the_gap_told_live_is_that_of_the_bag(run):
    whole = (run.gap[:, 2] == 0) & (run.gap[:, 3] == 0)
    assert np.median(run.gap[whole, 1]) == pytest.approx(run.error(run.before), rel=0.2)


def test_the_page_shows_before_and_after_and_says_what_is_a_surrogate(outcome, tmp_path):
    text = write_report(outcome.folder, tmp_path / "page.html").read_text()
    assert "SURROGATE" in text
    assert "Not shown" not in text
    for title in ("Gap over time", "Knees before and after", "Parameters", "Search"):
        assert title in text
    assert text.count('<figure class="plot"') == 3
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_a_robot_of_the_bag_can_be_read_by_itself(outcome):
    for robot in ("measured", "model"):
        recording = read_recording(outcome.folder, 100.0, models.Model("tigrillo").make_robot(), robot)
        assert recording.q.shape[1] == 8


def test_cancel_ends_the_search_and_keeps_the_bag(tmp_path):
    endless = SMALL.replace(generations=10_000, patience=10_000)
    outcome = calibrate(tmp_path / "bag", endless, lambda progress: progress.generation >= 1)
    assert outcome.status == "cancelled"
    assert outcome.exit_code == 0
    assert "cancelled after" in outcome.result.message
    assert set(outcome.run.exit_codes.values()) == {0}
    states = Bag(outcome.folder).messages("/calibration")
    assert states[-1].phase == "cancelled"


def test_a_bag_of_something_else_is_no_live_run(tmp_path):
    BagWriter(tmp_path / "other").close()
    bag = Bag(tmp_path / "other")
    assert not is_live(bag)
    with pytest.raises(BagError, match="/gap, /measured/joint_states"):
        read_live(bag)


def test_an_experiment_of_hyq_cannot_stand_for_the_measured_robot():
    with pytest.raises(ParameterError, match="target of oscillators"):
        live.measured_robot("hyq_short")


def test_the_command_tells_of_the_gap_and_writes_the_page(outcome, monkeypatch, capsys):
    def replayed(kind, measured, robot, folder, options, params, tell):
        assert kind is live.Calibration
        assert (measured.robot, robot, options.generations) == ("tigrillo", "tigrillo", 3)
        tell(live.LiveProgress("fitting", 3.0, 1, 0.5, 2.0, [live.GapRow(2.0, 0.7, 0, False)]))
        return outcome

    monkeypatch.setattr(live, "run_live", replayed)
    with pytest.raises(SystemExit, match="0"):
        main(["calibrate", "--live", "--generations", "3", "--out", str(outcome.folder)])
    out = capsys.readouterr().out
    assert "live calibration: done" in out
    assert "gap over topics" in out
    assert (outcome.folder / "report.html").is_file()


@pytest.mark.parametrize("arguments", [[], ["bag", "--live"]])
def test_the_command_wants_a_bag_or_live(arguments, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["calibrate", *arguments])
    assert "either a bag or --live" in capsys.readouterr().err
