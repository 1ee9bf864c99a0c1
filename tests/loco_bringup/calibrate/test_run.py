# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate`: bags in, results out, and one clear message per mistake."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from loco_bringup.bag.copy import extract
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.calibrate import run as runner
from loco_bringup.calibrate import terminal
from loco_bringup.calibrate.bag import read_recording
from loco_bringup.cli.main import main
from loco_control.exceptions import BagError, MissingFileError, NameUnknownError, ParameterError
from loco_control.ros.messages.definitions import definition, type_hash
from loco_learning.calibration import results
from loco_learning.calibration.objective import replay
from loco_learning.calibration.params import CalibrationParams
from loco_sim.plant import model as models

HIPS = [f"{leg}_hfe_joint" for leg in ("lf", "rf", "lh", "rh")]
JOINTS = [f"{leg}_{joint}_joint" for leg in ("lf", "rf", "lh", "rh") for joint in ("hfe", "kfe")]
TYPE = "sensor_msgs/msg/JointState"
GOLDEN = Path(__file__).resolve().parents[3] / "tests/golden/hyq_open"
QUICK = CalibrationParams(skip=0.8, population=2, generations=1)


def message(t, names, position):
    made = JointState(name=list(names), position=[float(v) for v in position])
    made.header.stamp.sec, made.header.stamp.nanosec = int(t), round(t % 1 * 1e9)
    return made


def write_bag(folder, seconds=4.5, topics=("/joint_states", "/joint_command"), joints=JOINTS):
    """A robot whose hips follow 1 Hz and whose knees follow a little later."""
    writer = BagWriter(folder)
    for topic in topics:
        writer.add_topic(topic, TYPE, definition(TYPE), type_hash(TYPE), [])
    for k in range(round(seconds * 100)):
        t = k * 0.01
        angle = 2.0 * np.pi * t
        states = [1.0 + 0.1 * np.sin(angle - 0.3 - i) for i in range(len(joints))]
        hips = [0.2 + 0.6 * np.sin(angle)] * len(HIPS)
        for topic, names, q in zip(topics, (joints, HIPS), (states, hips), strict=False):
            writer.write(topic, serialize_message(message(t, names, q)), round(t * 1e9))
    writer.close()
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "known")


def test_a_bag_becomes_a_recording(bag):
    made = read_recording(bag, 100.0, models.Model("tigrillo").make_robot())
    assert made.joints == tuple(JOINTS)
    assert made.driven == tuple(HIPS)
    assert (made.name, len(made.t)) == ("known", 450)
    np.testing.assert_allclose(made.command[:, 2], 0.2 + 0.6 * np.sin(2.0 * np.pi * made.t))


@pytest.mark.pybullet
def test_a_bag_of_hyq_replays_to_what_it_recorded():
    """Its trunk controller's torque, velocities and stances are commands as well."""
    hyq = models.Model("hyq")
    robot = hyq.make_robot()
    made = read_recording(GOLDEN, robot.control_rate, robot)
    told = made.commands_of(robot)
    np.testing.assert_allclose(replay(hyq, told).q, made.q, rtol=0.0, atol=1e-6)
    alone = replay(hyq, replace(told, torque=None)).q
    assert np.abs(alone - made.q).max() > 1e-3


def test_a_bag_of_hyq_is_of_no_other_robot():
    robot = models.Model("tigrillo").make_robot()
    with pytest.raises(BagError, match="/robot_state has 12 values of q, the robot has 8 "):
        read_recording(GOLDEN, robot.control_rate, robot)


def test_everything_is_written_and_the_model_is_one(bag, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "VALIDATION_SKIP", 0.5)
    out, told = tmp_path / "out", []
    job = runner.prepare(bag, options=QUICK, validate=[bag], seeds=2, folder=out, workers=0)
    result = runner.calibrate(job, lambda seed, generation: told.append(seed))
    assert told == [0, 1]
    names = {path.name for path in out.iterdir()}
    figures = {"convergence.png", "periods.png", "bodies.png"}
    assert names >= figures | {"model.yaml", "calibration.json", "calibration.html", "tables.md"}
    assert not [name for name in names if name.endswith(".part")]
    page = (out / "calibration.html").read_text()
    assert "http" not in page.replace("http://www.w3.org", "")  # names no address
    assert "<img" not in page  # all figures are plots
    assert results.load(out).best.error == result.best.error
    model = models.load(out / "model.yaml")
    stiffness = model.overrides["springs.[lr]h_kfe_joint.stiffness"]
    assert stiffness == pytest.approx(result.best.values["stiffness_hind"])
    fitted, other = result.comparisons
    assert (fitted.fitted, other.fitted) == (True, False)
    again = runner.calibrate(job)  # nothing is evaluated twice
    assert again.best.values == result.best.values
    with pytest.raises(ParameterError, match="another options"):
        runner.prepare(bag, options=QUICK.replace(loss="author"), folder=out)
    settings = out / "settings.json"
    settings.write_text(json.dumps({"format": 99}))
    with pytest.raises(ParameterError, match="format 99, this version reads 1"):
        runner.prepare(bag, options=QUICK, folder=out)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"robot": "tigrilo"}, NameUnknownError, "did you mean 'tigrillo'"),
        ({"robot": "hyq"}, ParameterError, "lf_haa_joint"),
        ({"bag": "nowhere"}, MissingFileError, "nowhere"),
        ({"validate": ["nowhere"]}, MissingFileError, "nowhere"),
        ({"seeds": 0}, ParameterError, "seeds must be at least 1"),
        ({"workers": -1}, ParameterError, "workers must be at least 0"),
    ],
)
def test_a_mistake_is_one_clear_message_and_writes_nothing(bag, tmp_path, arguments, error, text):
    out = tmp_path / "out"
    with pytest.raises(error, match=text):
        runner.prepare(**{"bag": bag, "options": QUICK, "folder": out, **arguments})
    assert not out.exists()


def test_a_bag_without_what_is_needed_is_refused(tmp_path):
    lacking = write_bag(tmp_path / "lacking", topics=("/joint_states",))
    with pytest.raises(BagError, match="no messages on /joint_command, .* it has /joint_states"):
        runner.prepare(lacking, options=QUICK)
    short = write_bag(tmp_path / "short", seconds=2.2)
    with pytest.raises(ParameterError, match="at least 2 are needed"):
        runner.prepare(short, options=QUICK)
    strange = write_bag(tmp_path / "strange", joints=JOINTS[:3])
    with pytest.raises(ParameterError, match="no sensors of rf_kfe_joint"):
        runner.prepare(strange, options=QUICK)


def test_the_command_says_it_in_one_line(bag, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words, text in (
        (["--parameters", "eight"], "choice of --parameters named 'eight'"),
        (["--loss", "rms"], "available: author, thesis"),
        (["--generations", "0"], "generations must be in [1, 100000]"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["calibrate", str(bag), *words])
        assert ended.value.code == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        assert text in lines[0]
    assert not list(tmp_path.iterdir())


def test_the_command_shows_bodies_errors_and_where_the_page_is(bag, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(terminal, "options", lambda _: QUICK)
    out, words = tmp_path / "out", ["--seeds", "1"]
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(bag), *words, "--workers", "1", "--out", str(out)])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    result = results.load(out)
    for text, _, default, calibrated, *_ in results.body_table(result)[1]:
        (line,) = [line for line in told.splitlines() if text in line]
        assert default in line and calibrated in line
    assert "known" in told and f"{result.best.error:.4g}" in told
    assert str(out / "calibration.html") in told.replace("\n", "")


def test_a_small_bag_keeps_bytes_stamps_and_description(bag, tmp_path):
    small = extract(bag, tmp_path / "small", ["joint_command", "joint_states:10"])
    old, new = Bag(bag), Bag(small)
    for topic, every in (("/joint_command", 1), ("/joint_states", 10)):
        (times, data), (few, kept) = old.raw(topic), new.raw(topic)
        np.testing.assert_array_equal(few, times[::every])
        assert kept == data[::every]
    assert new.metadata == old.metadata
    with pytest.raises(NameUnknownError, match="nothing"):
        extract(bag, tmp_path / "none", ["nothing"])
    with pytest.raises(ParameterError, match="NAME:N"):
        extract(bag, tmp_path / "none", ["joint_states:0"])
    assert not (tmp_path / "none").exists()
