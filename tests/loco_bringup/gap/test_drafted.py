# SPDX-License-Identifier: Apache-2.0
"""`loco gap my.csv --robot my.urdf`: mapping and robot are drafted, said, and may be corrected."""

from __future__ import annotations

import json
import os
import re
import shutil
import time
from pathlib import Path

import numpy as np
import pybullet_data
import pytest

from loco_bringup.cli import main as cli
from loco_bringup.gap import page
from loco_control.reading import read_yaml
from loco_learning.gap import contents, workflow
from loco_sim.bolted.loop import needs_engine
from loco_sim.robot import robot as robots

from .gap_result import curves, result

T = np.arange(400) / 100.0


def test_a_page_about_a_drafted_robot_is_named_by_the_recording():
    model = {**result()["model"], "robot": "results/gap_steps/drafts/robot"}
    assert "<title>Gap of steps</title>" in page.page(result(model=model), curves())
    assert "<title>Gap of servo_pendulum</title>" in page.page(result(), curves())


@pytest.fixture
def search(monkeypatch, tmp_path, capsys):
    """A command line whose search answers at once; returns its exit code, text and model."""
    asked = {}

    def find(model, fit, held, params, progress, workers, keep, memory):
        asked.update(model=model, fit=fit)
        known = result(reading=contents.reading_warnings(fit))
        keep(known, curves())
        return known

    monkeypatch.setattr(workflow, "find", find)
    monkeypatch.chdir(tmp_path)
    shutil.copy(robots.load("servo_pendulum").folder / "servo_pendulum.urdf", "my.urdf")

    def call(*words):
        robot = [] if "--robot" in words else ["--robot", "my.urdf"]
        with pytest.raises(SystemExit) as end:
            cli.main(["gap", *map(str, words), *robot, "--out", "out"])
        said = capsys.readouterr()
        return end.value.code, " ".join((said.out + said.err).split()), asked

    return call


def table(path, **columns):
    rows = np.column_stack([T, *columns.values()])
    header = ",".join(["t", *columns])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6f")


def test_a_recording_that_its_draft_does_not_describe_names_the_draft(search):
    table("a.csv", time=T, pivot_speed=np.sin(T), pivot_cmd=np.sin(T))
    code, said, _ = search("a.csv")
    assert code == 2
    assert "q (measured positions) is missing" in said
    assert "drafts/mapping.yaml is a draft: correct it" in said


def test_a_table_and_a_urdf_alone_get_an_answer_that_says_what_was_guessed(search, tmp_path):
    wave = 40.0 * np.sin(3.0 * T)
    table("my.csv", pivot_pos=wave, pivot_cmd=wave)
    code, said, asked = search("my.csv")
    assert code == 0, said
    assert "out/drafts/mapping.yaml is a draft, to be corrected: pivot_pos is q of pivot [d" in said
    assert "out/drafts/robot/robot.yaml is a draft, to be corrected; guessed: fixed_base, " in said
    assert said.index("is a draft") < said.index("Named")
    (record,) = asked["fit"]
    assert record.signals["q"][:, 0] == pytest.approx(np.radians(wave), abs=1e-6)
    robot = asked["model"].make_robot()
    assert type(robot.drives["pivot"]).__name__.startswith("Impedance")

    # What the user corrects in the drafts holds in the next search, and with more recordings.
    for file, old, new in (("robot/robot.yaml", "control_rate: 250", "control_rate: 100"),
                           ("mapping.yaml", "unit: deg", "unit: rad")):  # fmt: skip
        path = tmp_path / "out/drafts" / file
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
    code, said, asked = search("my.csv")
    assert (code, asked["model"].make_robot().control_rate) == (0, 100)
    assert asked["fit"][0].signals["q"][:, 0] == pytest.approx(wave, abs=1e-5)
    job = json.loads((tmp_path / "out/job.json").read_text())
    assert (job["robot"], job["mapping"]) == ("out/drafts/robot", "out/drafts/mapping.yaml")


def test_a_log_without_commands_is_moved_by_its_torques(search, tmp_path):
    table("my.csv", pivot_pos=0.4 * np.sin(3.0 * T), pivot_torque=np.cos(3.0 * T))
    code, said, asked = search("my.csv")
    assert code == 0 and "pivot_torque is command_torque of pivot" in said
    values = read_yaml(tmp_path / "out/drafts/robot/robot.yaml")
    assert values["drives"] == {"pivot": {"kind": "torque"}} and values["guessed"] == [
        "control_rate"
    ]
    assert asked["fit"][0].command["torque"][:, 0] == pytest.approx(np.cos(3.0 * T), abs=1e-6)


def with_a_passive_pole(effort: float) -> str:
    """URDF of a cart on a rail with a pole, whose joint has an effort limit."""

    def link(name: str, z: float) -> str:
        return (f'<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="1"/>'
                '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
                "</link>")  # fmt: skip

    def joint(name: str, kind: str, parent: str, child: str, axis: str, effort: float) -> str:
        return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
                f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-1" upper="1" '
                f'effort="{effort}" velocity="9"/></joint>')  # fmt: skip

    return "".join([
        '<robot name="cart"><link name="rail"/>', link("cart", 0.0), link("pole", -0.3),
        joint("slide", "prismatic", "rail", "cart", "1 0 0", 40.0),
        joint("hinge", "revolute", "cart", "pole", "0 1 0", effort), "</robot>",
    ])  # fmt: skip


@pytest.mark.parametrize("pole", [0.3, 0.001])
def test_a_joint_that_moves_without_a_command_has_no_drive(search, tmp_path, pole):
    """One that hardly moves may be held by a drive, whose command is asked for."""
    Path("my.urdf").write_text(with_a_passive_pole(effort=5.0))
    table("my.csv", slide_pos=0.2 * np.sin(3.0 * T), slide_force_cmd=np.cos(3.0 * T),
          hinge_pos=pole * np.sin(5.0 * T))  # fmt: skip
    code, said, asked = search("my.csv")
    if pole < 0.01:
        assert code == 2 and "command_torque of joint hinge is missing" in said
        return
    assert code == 0, said
    assert list(asked["model"].make_robot().drives) == ["slide"]
    assert (
        "# no drive, as they move without a command: hinge"
        in (tmp_path / "out/drafts/robot/robot.yaml").read_text()
    )


@pytest.mark.parametrize("order", [1, -1])
def test_a_joint_that_moves_in_any_recording_has_no_drive(search, order):
    """A slow motion of the cart leaves the pole at rest; the verdict hangs on no order of files."""
    Path("my.urdf").write_text(with_a_passive_pole(effort=5.0))
    for name, pole in ("slow.csv", 0.001), ("fast.csv", 0.3):
        table(name, slide_pos=0.2 * np.sin(3.0 * T), slide_force_cmd=np.cos(3.0 * T),
              hinge_pos=pole * np.sin(5.0 * T))  # fmt: skip
    code, said, asked = search(*["slow.csv", "fast.csv"][::order])
    assert code == 0, said
    assert list(asked["model"].make_robot().drives) == ["slide"]


def test_a_joint_moves_however_far_a_wheel_turns(search):
    """A pendulum of 0.3 rad under a wheel of 50 rad had a drive, and its command was asked for."""
    Path("my.urdf").write_text(with_a_passive_pole(effort=5.0).replace("prismatic", "continuous"))
    table("my.csv", slide_pos=8.0 * T, slide_torque_cmd=np.cos(3.0 * T),
          hinge_pos=0.3 * np.sin(5.0 * T))  # fmt: skip
    code, said, asked = search("my.csv")
    assert code == 0, said
    assert list(asked["model"].make_robot().drives) == ["slide"]


@pytest.mark.parametrize(("effort", "code"), [(0.0, 0), (5.0, 2)])
def test_a_command_without_a_name_is_of_the_only_joint_with_an_effort_limit(search, effort, code):
    Path("my.urdf").write_text(with_a_passive_pole(effort))
    table("my.csv", slide_pos=0.2 * np.sin(3.0 * T), force_cmd=np.cos(3.0 * T),
          hinge_pos=0.3 * np.sin(5.0 * T))  # fmt: skip
    result, said, _ = search("my.csv")
    assert result == code, said
    assert ("force_cmd is command_torque of slide" in said) is (code == 0)


def test_a_drafted_robot_fits_the_mapping_beside_the_log(search, tmp_path):
    table("my.csv", a=0.4 * np.sin(3.0 * T), b=np.cos(3.0 * T))
    columns = (
        "[{column: a, role: q, joint: pivot}, {column: b, role: command_torque, joint: pivot}]"
    )
    (tmp_path / "mapping.yaml").write_text(f"time: {{column: t}}\ncolumns: {columns}\n")
    code, said, asked = search("my.csv")
    assert code == 0, said
    assert asked["fit"][0].command["torque"][:, 0] == pytest.approx(np.cos(3.0 * T), abs=1e-6)


def test_a_draft_that_failed_leaves_no_robot_for_the_next_one(search, tmp_path):
    table("my.csv", a=T, b=T)
    assert search("my.csv")[0] == 2
    assert not list((tmp_path / "out").rglob("robot.yaml"))
    table("my.csv", pivot_pos=0.4 * np.sin(3.0 * T), pivot_torque=np.cos(3.0 * T))
    code, said, asked = search("my.csv")
    assert code == 0, said
    assert type(asked["model"].make_robot().drives["pivot"]).__name__ == "TorqueDrive"


def test_units_of_a_description_are_told_before_all_else(search, tmp_path):
    table("my.csv", pivot_pos=0.4 * np.sin(3.0 * T), pivot_torque=np.cos(3.0 * T))
    heavy = re.sub(r'<mass value="([^"]+)"', r'<mass value="\g<1>e6"', Path("my.urdf").read_text())
    Path("my.urdf").write_text(heavy)
    for _ in "once", "again":
        code, said, _ = search("my.csv")
        assert code == 0 and said.index("masses in g?") < said.index("is a draft")


def test_a_draft_of_another_or_an_older_description_is_not_used_in_silence(search, tmp_path):
    table("my.csv", pivot_pos=0.4 * np.sin(3.0 * T), pivot_torque=np.cos(3.0 * T))
    code, said, _ = search("my.csv")
    assert code == 0 and "was changed after" not in said
    now = time.time() + 10.0
    os.utime("my.urdf", (now, now))
    code, said, _ = search("my.csv")
    assert code == 0 and "my.urdf was changed after the draft out/drafts/robot/my.urdf" in said
    shutil.copy("my.urdf", "other.urdf")
    code, said, _ = search("my.csv", "--robot", "other.urdf")
    assert code == 2 and "was drafted from my.urdf, not from other.urdf" in said
    shutil.rmtree(re.search(r"remove (\S+)", said)[1])
    assert search("my.csv", "--robot", "other.urdf")[0] == 0


@pytest.mark.parametrize("word", ["torque", "cmd"])
def test_joints_without_columns_are_locked_and_said(search, tmp_path, word):
    """The log of an arm says nothing of its gripper."""
    panda = Path(pybullet_data.getDataPath(), "franka_panda")
    shutil.copytree(panda, tmp_path, dirs_exist_ok=True)
    shutil.move("panda.urdf", "my.urdf")
    waves = {f"panda_joint{i}": 0.3 * np.sin((1.0 + 0.3 * i) * T) for i in range(1, 8)}
    pairs = {f"{joint}_{kind}": x for joint, x in waves.items() for kind in ("pos", word)}
    table("my.csv", **pairs)
    code, said, asked = search("my.csv")
    assert code == 0, said
    assert "locked" in said[said.index("robot.yaml is a draft") :]
    robot = asked["model"].make_robot()
    assert robot.joints == tuple(waves) and not needs_engine(robot)
    values = read_yaml(tmp_path / "out/drafts/robot/robot.yaml")
    assert set(values["locked"]) == {"panda_finger_joint1", "panda_finger_joint2"}

    # Without that line the search says which line is missing, and goes on with it.
    path = tmp_path / "out/drafts/robot/robot.yaml"
    path.write_text(path.read_text().split("locked:")[0])
    code, said, _ = search("my.csv")
    hint = re.search(r"add to robot.yaml: (locked: \{panda_finger_joint1: 0\})", said)
    assert code == 2 and hint
    path.write_text(path.read_text() + hint[1].replace("}", ", panda_finger_joint2: 0}"))
    assert search("my.csv")[0] == 0


def test_joints_that_the_mapping_knows_are_not_locked(search, tmp_path):
    """A joint held in this recording, and one that a correction names."""
    shutil.copytree(Path(pybullet_data.getDataPath(), "franka_panda"), tmp_path, dirs_exist_ok=True)
    shutil.move("panda.urdf", "my.urdf")
    names = [f"panda_joint{i}" for i in range(1, 7)]
    table("my.csv", **{n: 0.3 * np.sin((1.0 + 0.3 * i) * T) for i, n in enumerate(names)})
    columns = "".join(
        f"  - {{column: {n}, role: {role}, joint: {n}}}\n"
        for n in names
        for role in ("q", "command_position")
    )
    held = "locked: {panda_joint7: 0.2}\n"
    (tmp_path / "map.yaml").write_text(f"time: {{column: t}}\ncolumns:\n{columns}{held}")
    code, said, asked = search("my.csv", "--mapping", "map.yaml")
    assert code == 0, said
    assert asked["model"].make_robot().joints == (*names, "panda_joint7")


def test_what_is_no_table_of_names_is_one_line_and_writes_no_mapping(search, tmp_path):
    table("my.csv", a=T, b=T)
    code, said, _ = search("my.csv")
    assert code == 2 and "no name says what is measured or commanded" in said
    assert not (tmp_path / "out/drafts/mapping.yaml").exists()


def test_a_folder_of_the_user_is_no_folder_of_drafts(search, tmp_path):
    table("my.csv", pivot_pos=T, pivot_cmd=T)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mapping.yaml").write_text("format: 1\n")
    code, said, _ = search("my.csv")
    assert code == 2 and "out holds other files" in said


@pytest.mark.parametrize("name", ["row", "sample"])
def test_without_a_time_no_rate_is_guessed(search, tmp_path, name):
    wave = np.sin(3.0 * T)
    table("my.csv", pivot_pos=wave, pivot_cmd=wave)
    text = (tmp_path / "my.csv").read_text()
    (tmp_path / "my.csv").write_text(name + text[1:])
    code, said, asked = search("my.csv")
    assert code == 2 and not asked and "time: {rate: ...} with the rate of the log in Hz" in said
    draft = next((tmp_path / "out").rglob("mapping.yaml"))
    with draft.open("a") as file:
        file.write("time: {rate: 100}\n")
    assert search("my.csv")[0] == 0
