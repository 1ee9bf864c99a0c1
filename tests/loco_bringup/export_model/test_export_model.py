# SPDX-License-Identifier: Apache-2.0
"""`loco export-model`: its files, the replay in MuJoCo alone, and one line for every mistake."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import loco
from loco_bringup.cli import main as cli
from loco_bringup.export_model.replay import compare
from loco_bringup.gap import run as runner
from loco_learning.gap.localisation.curves import load as load_curves
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.proposals import pool
from loco_learning.gap.recordings.record import Record
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from ..gap.gap_result import result

MEASURED = Path(__file__).parents[3] / "bags" / "measured"
AIR = {"fixed_base": True, "height": 2.0}


def call(*arguments):
    with pytest.raises(SystemExit) as end:
        cli.main([str(a) for a in arguments])
    return end.value.code


RECORDS = {
    "silverbox": "{name: multisine 1, rows: [40580, 44877]}",
    "bam_xl330": "{name: lift and drop, where: {kp: 100, trajectory: lift_and_drop}}",
}


@pytest.mark.parametrize("robot", RECORDS)
def test_a_measured_robot_is_met_as_closely_in_mujoco_alone(robot, tmp_path):
    set_, short = MEASURED / robot, tmp_path / "mapping.yaml"
    text = (set_ / "mapping.yaml").read_text().partition("records:")[0]
    short.write_text(f"{text}records: [{RECORDS[robot]}]\n")
    done = loco.export_model(set_, "mjcf", tmp_path / "out", replay=[set_], mapping=short)
    (judged,) = done.compared
    assert judged.theirs == pytest.approx(judged.ours, rel=0.1) and judged.ours > 0.001
    assert {"model.xml", "replay.py", "replay_1.npz"} <= set(done.files)


HIDDEN = {  # overrides, joints that rub, friction [N·m] and delay [s]
    "hyq": (AIR, "*_hfe_joint", 4.0, 0.012),
    "tigrillo": (AIR, "*_hfe_joint", 0.06, 0.02),
    "servo_pendulum": ({}, "pivot", 0.05, 0.02),
}


def hidden(robot, by):
    """A robot with friction, a delay, an offset and a torque constant, so much of each."""
    overrides, joint, friction, delay = HIDDEN[robot]
    effects = [
        {"name": "coulomb_friction", "joint": joint, "torque": by * friction},
        {"name": "command_delay", "delay": by * delay},
        {"name": "joint_offset", "joint": joint, "offset": by * 0.02},
        {"name": "torque_constant_error", "error": by * -0.1},
    ]
    return Model(robot, overrides, effects)


@pytest.mark.parametrize("experiment", ["chirp_large", "steps"])
@pytest.mark.parametrize("robot", HIDDEN)
def test_a_simulated_robot_is_met_as_closely(robot, experiment, tmp_path):
    chosen = pool.choose(pool.pool(Model(robot, HIDDEN[robot][0])), experiment)
    chosen = chosen.replace(duration=0.4 * chosen.duration)
    recorded = list(pool.records(hidden(robot, 1.0), [chosen]))
    (one,), notes = compare(hidden(robot, 0.9), recorded, tmp_path)
    assert notes == [] and one.ours > 1e-4
    assert one.theirs == pytest.approx(one.ours, rel=0.1)


def test_results_of_a_search_bring_ranges(tmp_path, capsys):
    folder = tmp_path / "gap"
    folder.mkdir()
    found = result()
    (folder / "gap.json").write_text(json.dumps(found))
    loco.Model(**found["model"]).save(folder / "model.yaml")
    for to in ("mjcf", "isaac", "pace", "urdf"):
        assert call("export-model", folder, "--to", to, "--out", tmp_path / to) == 0
    assert (0.047, 0.056) == next(
        (low, high) for low, high, _ in ranges(tmp_path / "mjcf" / "randomize.py")
    )
    assert "(0.047, 0.056)" in (tmp_path / "isaac" / "isaac_lab.py").read_text()
    assert "not in it: pivot" in capsys.readouterr().out


def ranges(path):
    import ast

    tree = ast.parse(path.read_text())
    return ast.literal_eval(next(n.value for n in tree.body if isinstance(n, ast.Assign)))


def test_what_the_model_has_not_got_is_not_randomised(tmp_path):
    (tmp_path / "gap.json").write_text(json.dumps(result()))
    loco.Model("servo_pendulum").save(tmp_path / "model.yaml")
    done = loco.export_model(tmp_path, "mjcf", tmp_path / "out")
    assert "randomize.py" not in done.files and any("has not got it" in t for t in done.lost)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("hyq", "--to", "gazebo"), "no choice of --to named 'gazebo'"),
        (("nowhere.yaml", "--to", "mjcf"), "nowhere.yaml"),
        (("hyq", "--to", "urdf", "--replay", "bag"), "take --to mjcf"),
        (("hyq", "--to", "urdf", "--gear", "rigid"), "urdf has rigid gears"),
        (("hyq", "--to", "mjcf", "--gear", "soft"), "no choice of --gear named 'soft'"),
        (("hyq", "--to", "urdf", "--out", "OTHER"), "holds other files (mine.txt)"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(arguments, words, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    arguments = [tmp_path if a == "OTHER" else a for a in arguments]
    assert call("export-model", *arguments) == 2
    assert words in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def swung(speed):
    """A servo pendulum that swings at the start of its log, faster than its readings say."""
    t = np.arange(300) / 100.0
    told = {"position": 0.4 * np.sin(4.0 * t)[:, None]}, ("pivot",)
    empty = Record("judge", t, *told, {"q": 0.4 * np.sin(4.0 * t - 0.5)[:, None]}, ("pivot",))
    forward = Forward(Model("servo_pendulum", EXACT), [empty])
    (q,) = forward.begun_at([np.array([0.004, speed])])(step=1 / 8)
    noise = 0.004 * np.random.default_rng(2).standard_normal(q.shape)
    return replace(empty, signals={"q": q + noise})


EXACT = {"drives.pivot.resolution": 0.0}


def test_the_replay_of_a_search_begins_where_the_verdict_began(tmp_path, monkeypatch):
    """Starts that the search refitted are those of the exported replay, and so is the error."""
    model, record = Model("servo_pendulum", EXACT), swung(0.4)
    few = {"effects": ["joint_offset"], "most_terms": 1}
    monkeypatch.setattr(runner, "read_records", lambda job: (model, [swung(0.3)], [record]))
    runner.run(runner.Job("servo_pendulum", ("a", "b"), options=few, workers=1), tmp_path / "gap")
    drawn = load_curves(tmp_path / "gap/gap.npz").records[1]
    judged = np.sqrt(np.nanmean(drawn.residual("after") ** 2))
    (one,) = loco.export_model(tmp_path / "gap", "mjcf", tmp_path / "out").compared
    (bare,), _ = compare(models.load(tmp_path / "gap/model.yaml"), [record], tmp_path)
    assert len(drawn.start) == 2 and bare.ours > 1.5 * judged
    assert one.ours == pytest.approx(judged, rel=0.02)
    assert one.theirs == pytest.approx(judged, rel=0.02)
