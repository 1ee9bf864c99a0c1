# SPDX-License-Identifier: Apache-2.0
"""Recordings of other programs: numbers of their joints, what is guessed and what is missing."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from loco_bringup.cli import bags as commands
from loco_bringup.cli import main as cli
from loco_bringup.logs.export import export
from loco_bringup.logs.recording import read
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import recorded
from loco_bringup.report.report import write_report
from loco_control.exceptions import BagError, LocoError, ParameterError
from loco_learning.runs.experiment import load

from .. import message_bag

ROOT = Path(__file__).resolve().parents[3]
T = np.arange(200) / 100.0


def goal(t):
    return 0.5 * np.sin(5.0 * t)


def state(t, **fields):
    message = JointState(name=["knee", "hip"], **fields)
    message.header.stamp.sec, message.header.stamp.nanosec = int(t), round(t % 1 * 1e9)
    return message


def bag(folder, **topics):
    return message_bag.write(folder, **{name: (make, T) for name, make in topics.items()})


def measured(t):
    return state(t, position=[goal(t) - 0.1, 0.2], effort=[2.0, -3.0])


def commanded(t):
    return state(t, position=[goal(t), 0.2])


def csv(path, shift=0.1):
    rows = [f"{t:.2f},{goal(t) - shift:.9f},{goal(t):.9f}" for t in T]
    path.write_text("\n".join(["t,knee_pos,knee_cmd", *rows]) + "\n")
    return path


def test_numbers_of_each_joint(tmp_path):
    found = read(bag(tmp_path / "arm", joint_states=measured, joint_command=commanded))
    assert found.joints == ["knee", "hip"]
    by = {j: dict(zip(recorded.HEAD, recorded.values(found, j), strict=True)) for j in found.joints}
    assert by["knee"]["Tracking error, rms"] == pytest.approx(0.1)
    assert by["hip"]["Tracking error, rms"] == pytest.approx(0.0)
    assert by["hip"]["Largest torque"] == 3.0 and np.isnan(by["hip"]["Largest speed"])


def test_positions_alone_have_a_report_without_commands(tmp_path):
    text = write_report(bag(tmp_path / "arm", joint_states=measured)).read_text()
    assert "no commanded position of a measured joint" in text and "no speed" in text
    found = read(tmp_path / "arm")
    assert ("tau", "knee") in found.tracks and ("command_torque", "knee") not in found.tracks


def test_further_signals_of_a_joint_are_told_as_left_out(tmp_path):
    path = tmp_path / "arm.csv"
    rows = [f"{t},{goal(t)},{goal(t)},{goal(t - 0.1)}" for t in T]
    path.write_text("\n".join(["t,knee_pos,knee_angle,knee_cmd", *rows]))
    assert "1 further signals of the same joints are left out" in read(path).notes


def test_commands_that_name_no_joints_are_told_and_a_mapping_names_them(tmp_path):
    folder = bag(
        tmp_path / "arm", joint_states=measured,
        commands=lambda t: Float64MultiArray(data=[0.2, goal(t)]),
    )  # fmt: skip
    found = read(folder)
    assert any("joint_0, joint_1 belong to no measured joint" in note for note in found.notes)
    assert np.isnan(recorded.values(found, "knee")[2])
    path = tmp_path / "mapping.yaml"
    lines = [f'{{topic: /joint_states, column: "position[{j}]", role: q, joint: {j}}}'
             for j in ("knee", "hip")]  # fmt: skip
    lines += [f'{{topic: /commands, column: "data[{i}]", role: command_position, joint: {j}}}'
              for i, j in enumerate(("hip", "knee"))]  # fmt: skip
    path.write_text("columns:\n" + "".join(f"  - {line}\n" for line in lines))
    assert recorded.values(read(folder, path), "knee")[2] == pytest.approx(0.1)


def test_joints_and_fields_of_every_publisher_are_read(tmp_path):
    def parts(t):
        even = round(100 * t) % 2 == 0
        message = JointState(name=["knee"] if even else ["hip"], position=[0.1], velocity=[0.0])
        message.header.stamp.sec, message.header.stamp.nanosec = int(t), round(t % 1 * 1e9)
        return message

    assert read(bag(tmp_path / "arm", joint_states=parts)).joints == ["knee", "hip"]


def test_a_clock_that_is_set_back_ends_the_recording_and_is_told(tmp_path):
    path = tmp_path / "back.csv"
    rows = [f"{t - (1.0 if t > 1.5 else 0.0):.2f},{goal(t):.6f},{goal(t):.6f}" for t in T]
    path.write_text("\n".join(["t,knee_pos,knee_cmd", *rows]) + "\n")
    found = read(path)
    assert any("q of knee was set back at row 151" in note for note in found.notes)
    assert found.tracks["q", "knee"].t[-1] == pytest.approx(1.5)


def test_a_table_has_joints_of_the_bag_that_it_is_compared_with(tmp_path):
    folder = bag(tmp_path / "arm", joint_states=measured, joint_command=commanded)
    text, said = recorded.comparison([csv(tmp_path / "run.csv", 0.3), folder])
    assert said == ["knee: tracking error 0.3 → 0.1 rad or m (rms)"]
    assert "Comparison of run and arm" in text
    rows = "\n".join(["t,wrist_pos,wrist_cmd", *(f"{t},{t},{t}" for t in T)])
    (tmp_path / "w.csv").write_text(rows + "\n")
    with pytest.raises(LocoError):
        recorded.comparison([folder, tmp_path / "w.csv"])
    with pytest.raises(ParameterError, match="2 to 8 recordings"):
        recorded.comparison([folder])
    with pytest.raises(ParameterError, match="one name"):
        recorded.comparison([folder, folder])


def test_a_run_of_loco_is_compared_with_a_recording_of_its_joints(tmp_path):
    run = tmp_path / "run"
    run_rollout(load("servo_pendulum_sine", {"duration": 2.0}), run, lambda progress: None)
    path = tmp_path / "bench.csv"
    path.write_text((csv(path)).read_text().replace("knee", "pivot"))
    _, (sentence,) = recorded.comparison([run, path])
    assert sentence.startswith("pivot: tracking error ") and "→ 0.1 rad" in sentence


def test_a_table_is_told_and_exported(tmp_path, capsys):
    path = csv(tmp_path / "run.csv")
    commands.show_bag(path)
    assert "200 rows" in (said := capsys.readouterr().out) and "knee_cmd" in said
    (written,) = export(path)
    assert written == tmp_path / "run_export" / "run.npz"
    with np.load(written) as found:
        assert found["knee_cmd"] == pytest.approx(goal(T), abs=1e-8)
    (written,) = export(path, tmp_path / "csv", "csv")
    assert written.read_text().startswith("t,knee_pos,knee_cmd\n")
    assert write_report(path) == tmp_path / "run_report.html"


def test_the_commands_of_the_page_run_as_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    section = (ROOT / "docs/logs.md").read_text().partition("## Recordings of other programs")[2]
    lines = section.partition("```sh\n")[2].partition("```")[0].splitlines()
    assert len(lines) == 4
    for line in lines:
        words = shlex.split(line)[1:]
        if "--out" in words:
            words[words.index("--out") + 1] = str(tmp_path / words[-1])
        with pytest.raises(SystemExit) as end:
            cli.main(words)
        assert end.value.code == 0, capsys.readouterr().err
    text = (tmp_path / "results/xl330.html").read_text()
    assert "tracking error" in text.lower() and "gait" not in text.lower()


def test_a_pattern_of_a_mapping_names_the_joints_of_a_table(tmp_path):
    names = ["t", "state[knee.pos]", "state[hip.pos]", "action[knee.pos]"]
    rows = [f"{t:.2f},{np.degrees(goal(t) - 0.1):.9f},0.0,{np.degrees(goal(t)):.9f}" for t in T]
    (tmp_path / "run.csv").write_text("\n".join([",".join(names), *rows]) + "\n")
    (tmp_path / "mapping.yaml").write_text(
        "time: {column: t}\ncolumns:\n"
        '  - {column: "state[{joint}.pos]", role: q, joint: "*", unit: deg}\n'
        '  - {column: "action[{joint}.pos]", role: command_position, joint: "*", unit: deg}\n'
    )
    found = read(tmp_path / "run.csv")
    assert found.joints == ["knee", "hip"] and not found.notes
    assert recorded.values(found, "knee")[2] == pytest.approx(0.1)


def test_a_table_whose_names_are_of_no_joint_says_what_to_write(tmp_path):
    (tmp_path / "a.csv").write_text("t,position\n" + "".join(f"{t},{t}\n" for t in T))
    with pytest.raises(ParameterError, match="no joint is named in: position. Write a mapping"):
        read(tmp_path / "a.csv")


def test_what_has_no_positions_is_one_line(tmp_path):
    (tmp_path / "a.csv").write_text("t,knee_cmd\n" + "".join(f"{t},{t}\n" for t in T))
    with pytest.raises(BagError, match="a has no measured positions of joints; it has command"):
        read(tmp_path / "a.csv")
