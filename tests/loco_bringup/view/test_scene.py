# SPDX-License-Identifier: Apache-2.0
"""What viewers show of a run: links where the kinematics puts them, forces, curves, layouts."""

import json
import subprocess
import sys
from importlib.resources import files
from importlib.util import find_spec

import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.view import gap_scene
from loco_bringup.view.scene import scene_of
from loco_control.exceptions import BagError
from loco_control.ros.messages.topics import TOPICS
from loco_learning.gap.localisation.curves import Curve, Curves
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model
from loco_sim.robot.frames import feet_in_base

LAYOUTS = files("loco_bringup.view").joinpath("layouts")


@pytest.fixture(scope="module")
def log():
    return rollout(load("hyq_short", {"learner.train": 1.0, "learner.test": 0.5}))


def test_links_are_where_the_legs_are(log):
    scene = scene_of(log)
    feet = feet_in_base(log.experiment.plant, log.q)
    for i, foot in enumerate(log.experiment.plant.feet):
        way = np.einsum("tij,tj->ti", scene.turns["base_link"], feet[:, i])
        np.testing.assert_allclose(scene.places[foot], log.position + way, atol=1e-9)
        assert scene.places[foot][:, 2].min() > -0.05  # on the ground, not in it
        np.testing.assert_array_equal(scene.forces[foot], log.grf[:, i])
    assert {"base_link", "lf_upperleg", "rh_lowerleg"} <= set(scene.shapes)
    assert list(scene.phases) == ["stand", "train", "closing", "test"]


def test_curves_have_a_group_and_a_name(log):
    curves = scene_of(log).signals
    assert {name.partition("/")[0] for name in curves} == {
        "angle", "torque", "stance", "command", "network",
    }  # fmt: skip
    assert all(len(values) == len(log) for values in curves.values())


def test_a_bolted_robot_has_no_forces():
    scene = scene_of(rollout(load("servo_pendulum_sine", {"duration": 1.0})))
    assert scene.forces == {}
    assert np.ptp(scene.places["rod"], axis=0).max() < 1e-9 or "rod" in scene.turns


def gap_results(folder, channels, values):
    """Results of a gap on the servo pendulum: a fitted and a held-out record of half a second."""
    t = np.arange(50) / 100.0
    records = [
        Curve(name, role, t, *(np.full((50, len(channels)), value) for value in (*values, 1.0)),
              np.full(50, role == "held-out"), np.zeros(0))
        for name, role in (("slow", "fit"), ("fast", "held-out"))
    ]  # fmt: skip
    Curves(channels, tuple(records)).save(folder / "gap.npz")
    Model("servo_pendulum").save(folder / "model.yaml")
    return folder


def swing(folder):
    """Table of a servo that follows its command late."""
    t = np.arange(300) / 100.0
    rows = np.stack([t, 0.8 * np.sin(6.0 * (t - 0.04)), 0.8 * np.sin(6.0 * t)], axis=1)
    np.savetxt(folder / "swing.csv", rows, "%.6f", ",", header="t,q,cmd", comments="")
    (folder / "mapping.yaml").write_text(
        "time: {column: t}\ncolumns:\n  - {column: q, role: q, joint: pivot}\n"
        "  - {column: cmd, role: command_position, joint: pivot}\n"
    )
    return folder / "swing.csv"


def test_a_recording_of_another_program_is_the_measured_robot_beside_its_model(tmp_path):
    scenes = gap_scene.recorded(swing(tmp_path), "servo_pendulum")
    assert list(scenes) == ["measured", "model"]
    angle = {name: scene.signals["q/pivot"] for name, scene in scenes.items()}
    np.testing.assert_allclose(
        angle["measured"], 0.8 * np.sin(6.0 * (scenes["measured"].t - 0.04)), atol=1e-5
    )
    assert np.corrcoef(angle["measured"][50:], angle["model"][50:])[0, 1] > 0.9
    assert any(np.ptp(turn[:, 0, 0]) > 0.1 for turn in scenes["model"].turns.values())


@pytest.mark.parametrize("words", [(), ("--robot", "servo_pendulum", "tests/golden/hyq_reflex")])
def test_a_recording_of_another_program_needs_its_robot_and_stands_alone(tmp_path, capsys, words):
    pytest.importorskip("rerun")
    with pytest.raises(SystemExit) as end:
        cli.main(["view", str(swing(tmp_path)), *words])
    says = "show it alone" if words else "name it by --robot"
    assert end.value.code == 2 and says in " ".join(capsys.readouterr().err.split())


def test_results_of_a_gap_are_the_measured_robot_and_both_models(tmp_path):
    channels = (("q", "pivot", "rad"), ("tau", "pivot", "N·m"))
    scenes = gap_scene.scenes_of(gap_results(tmp_path, channels, (0.3, np.nan, 0.1)))
    assert list(scenes) == ["measured", "before", "after"]
    (moved,) = (link for link, turn in scenes["after"].turns.items() if turn[0, 0, 0] < 1.0)
    angles = {n: np.arccos(scene.turns[moved][:, 0, 0]) for n, scene in scenes.items()}
    np.testing.assert_allclose(angles["measured"], 0.3)
    np.testing.assert_allclose(angles["after"], 0.1)
    np.testing.assert_allclose(angles["before"], 0.0)  # nothing is known: it stands
    scene = scenes["measured"]
    assert np.all(np.diff(scene.t) > 0.0) and len(scene.t) == 100
    assert list(scene.phases) == ["fast (held-out)", "slow (fit)"]
    assert set(scene.signals) == {"q/pivot", "tau/pivot"}


def test_a_gap_that_cannot_be_shown_is_one_line(tmp_path, capsys):
    gap_results(tmp_path, (("tau", "pivot", "N·m"),), (0.3, 0.2, 0.1))
    with pytest.raises(BagError, match="no angles of joints"):
        gap_scene.scenes_of(tmp_path)
    (tmp_path / "gap.npz").write_bytes(b"nothing")
    with pytest.raises(BagError, match="does not hold the curves"):
        gap_scene.scenes_of(tmp_path)


def test_layouts_name_topics_and_frames_that_are_there():
    text = LAYOUTS.joinpath("foxglove.json").read_text()
    layout = json.loads(text)["configById"]
    shown = {p["value"].partition(".")[0].lstrip("/") for c in layout.values()
             for p in c.get("paths", ())}  # fmt: skip
    assert shown <= set(TOPICS)
    assert "robot_description" in TOPICS and '"/robot_description"' in text
    rviz = LAYOUTS.joinpath("loco.rviz").read_text()
    assert "Fixed Frame: odom" in rviz and "Value: /robot_description" in rviz
    assert '"frameId": "odom"' in text and '"followTf": "base_link"' in text


def test_layouts_are_written(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["view", "--layouts", str(tmp_path / "layouts")])
    assert end.value.code == 0
    assert {p.name for p in (tmp_path / "layouts").iterdir()} == {"foxglove.json", "loco.rviz"}


@pytest.mark.skipif(find_spec("rerun") is not None, reason="Rerun is installed")
def test_a_missing_rerun_is_one_line(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["view", "somewhere"])
    assert end.value.code == 2
    assert "./loco install view" in capsys.readouterr().err


@pytest.mark.skipif(find_spec("rerun") is None, reason="needs rerun-sdk, the extra `view`")
def test_rerun_reads_what_was_written(log, tmp_path):
    """By its own reader: a chunk per link, with a place for each tick that is shown."""
    run_rollout(log.experiment, tmp_path / "run", lambda _: None)
    with pytest.raises(SystemExit) as end:
        cli.main(["view", str(tmp_path / "run"), "--save", str(tmp_path / "run.rrd")])
    assert end.value.code == 0
    said = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "run.rrd")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    for link in log.experiment.plant.feet:
        assert f"/robots/run/{link}" in said.stdout
    assert "/signals/angle/run/lf_kfe_joint" in said.stdout
    with pytest.raises(SystemExit) as end:  # nothing is overwritten
        cli.main(["view", str(tmp_path / "run"), "--save", str(tmp_path / "run.rrd")])
    assert end.value.code == 2


@pytest.mark.skipif(find_spec("rerun") is None, reason="needs rerun-sdk, the extra `view`")
def test_rerun_reads_a_gap(tmp_path):
    (tmp_path / "gap").mkdir()
    folder = gap_results(tmp_path / "gap", (("q", "pivot", "rad"),), (0.3, 0.2, 0.1))
    with pytest.raises(SystemExit) as end:
        cli.main(["view", str(folder), "--save", str(tmp_path / "gap.rrd")])
    assert end.value.code == 0
    said = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", str(tmp_path / "gap.rrd")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert all(f"/robots/{name}/" in said.stdout for name in gap_scene.ROBOTS)
    with pytest.raises(SystemExit) as end:
        cli.main(["view", str(folder), str(folder.parent), "--save", str(tmp_path / "two.rrd")])
    assert end.value.code == 2
