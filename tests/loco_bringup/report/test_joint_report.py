# SPDX-License-Identifier: Apache-2.0
"""The report of a joint robot's run: whole, self-contained, honest about what is missing."""

import dataclasses
import re

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import parts, report, robot
from loco_bringup.report.joint_figures import CHAPTERS
from loco_control.exceptions import BagError
from loco_learning.metrics.registry import METRICS
from loco_learning.runs.experiment import load

from .test_report import Page, first_screen, section, shown

CHANGES = {
    "description": "costs $5 & is <b>not</b> bold",
    "effects": [{"name": "command_delay", "delay": 0.01, "start": 2.0}],
    "learner.stand": 0.5,
    "learner.train": 4.0,
    "learner.closing": 2.0,
    "learner.test": 2.5,
}
TABLES = ("Facts", "Who drives the joints", "Metrics", "Effects", "Configuration", "Messages")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joint") / "run"
    run_rollout(load("tigrillo_bound_reflex", CHANGES), folder, lambda progress: None)
    return Bag(folder)


@pytest.fixture(scope="module")
def log(bag):
    return read_log(bag)


@pytest.fixture(scope="module")
def text(bag):
    with pytest.MonkeyPatch.context() as patch:  # an animation as large as a stamp is faster
        patch.setattr(parts, "SIZE", (96, 64))
        patch.setattr(parts, "FPS", 5.0)
        return report.write_report(bag.folder).read_text()


def test_every_part_is_there_and_nothing_is_elsewhere(bag, text):
    page = Page(text)
    assert page.texts["h1"] == ["tigrillo_bound_reflex"]
    assert set(page.texts["h2"]) == {c.title for c in CHAPTERS} | set(TABLES)
    assert "Not shown" not in text
    assert shown(page, text) == len(CHAPTERS) + 2  # animation and readout check
    assert all(a.startswith(("data:image/", "#")) for a in page.addresses)
    assert "costs $5 & is <b>not</b> bold" in page.text("p")
    assert (bag.folder / "gait.gif").is_file()
    assert "command_delay" in section(text, "Effects")


def test_the_sentence_tells_distance_and_speed(text, log):
    told = re.search(r"tigrillo got ([\d.]+) m away in 9\.0 s", text)
    x, y = (log.position[-1] - log.position[0])[:2]
    assert float(told[1]) == pytest.approx(np.hypot(x, y), abs=0.01)
    assert "with its readout alone" in text


def test_the_readout_is_verified_from_the_bag(bag, log, text):
    assert '<span class="good">Verified:</span> the readout drives the driven joints' in text
    check = robot.checked(bag, log)
    assert check.error == 0.0
    assert len(check.t) == 249
    other = dataclasses.replace(log, columns={**log.columns, "q": log.q + 0.01})
    assert not robot.checked(bag, other).drives


def test_every_metric_has_a_row_with_the_value_of_each_phase(text, log):
    rows = re.findall(r"<tr>(.*?)</tr>", section(text, "Metrics"))
    assert "".join(re.findall(r"<th.*?>(.*?)</th>", rows[0])) == (
        "MetrictrainclosingtestUnitEquation"
    )
    # Nobody asked for a speed, and a bag of joints has no forces and no wall-clock times.
    lacking = {"speed_ratio", "grf_max", "grf_snr", "duty_factor", "step_length", "step_time"}
    assert len(rows) == 1 + len(METRICS) - len(lacking)
    assert all("<small>" in row for row in rows[1:])


def test_an_open_loop_run_says_what_it_lacks(tmp_path):
    run_rollout(load("tigrillo_bound", {"duration": 3.0}), tmp_path / "run", lambda progress: None)
    bag = Bag(tmp_path / "run")
    text = robot.page(bag, read_log(bag), None)
    assert "open loop: this run has no network" in section(text, "Prediction error")
    assert "the plant is the bare robot" in section(text, "Effects")
    assert "the animation was left out" in first_screen(text)
    assert "<figure" in section(text, "Passive joints")
    assert "open loop" in section(text, "Metrics")
    assert "carries no weights.npz" in section(text, "Who drives the joints")


def test_a_robot_that_stands_still_and_has_no_feet_has_a_report(tmp_path):
    experiment = load("servo_pendulum_sine", {"duration": 2.0})
    run_rollout(experiment, tmp_path / "run", lambda progress: None)
    bag = Bag(tmp_path / "run")
    text = robot.page(bag, read_log(bag), None)
    assert "servo_pendulum ran for 2.0 s" in text
    assert "<h2>Passive joints</h2>" not in text and "<h2>Feet</h2>" not in text
    assert "<figure" in section(text, "Driven joints")


@pytest.mark.parametrize("ticks", [1, 60])
def test_a_run_that_broke_off_has_a_report(bag, log, ticks):
    text = robot.page(bag, log.cut(slice(0, ticks)), None)
    Page(text)
    assert f"the recording ends at {ticks * log.dt:.1f} of" in text
    assert "<figure" in section(text, "Driven joints")


def test_a_fall_is_on_top_of_the_page(bag, log):
    fallen = dataclasses.replace(log, fall="roll is 0.9 rad")
    text = robot.header(bag, fallen, {}, BagError("no network"), "")
    assert '<p class="verdict bad">fell at 9.0 s: roll is 0.9 rad' in text
    assert "failed: fall" in robot.facts(bag, fallen, BagError("no network"))


def test_a_bag_without_ground_truth_says_so(bag, log):
    names = ("position", "orientation", "velocity", "spin")
    nothing = {name: np.full_like(log.columns[name], np.nan) for name in names}
    blind = dataclasses.replace(log, columns={**log.columns, **nothing})
    text = robot.page(bag, blind, bag.folder / "unused.gif")
    assert "the bag has no ground_truth/odom" in first_screen(text)
    for title in ("Path", "Base motion", "Feet"):
        assert "the bag has no ground_truth/odom" in section(text, title)
    assert "<figure" in section(text, "Torque and power")


@pytest.mark.parametrize("name", ["servo_pendulum", "linear_axis", "hyq_leg"])
def test_a_bolted_robot_gets_its_tracking_error_first_and_no_words_of_gaits(name, tmp_path):
    robot_run = load("servo_pendulum_sine", {"robot": name, "duration": 2.5})
    run_rollout(robot_run, tmp_path / "run", lambda progress: None)
    text = report.write_report(tmp_path / "run", gif=False).read_text()
    page = Page(text)
    first = first_screen(text)
    assert "2.5 s, to the end" in first and "Its drives missed their command by" in first
    assert first.index("Tracking error") < first.index("Positive power")
    visible = re.sub(r"<(script|style).*?</\1>|<!--.*?-->", "", text, flags=re.S)
    end = "Metrics" if robot_run.plant.feet else "Configuration"
    before = visible.partition(f"<h2>{end}</h2>")[0].lower()
    for word in ("stride", "gait", "without a fall", "feet", "oscillator", "limit cycle"):
        assert word not in before, word
    assert "Torque and power" in page.texts["h2"]
