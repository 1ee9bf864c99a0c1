# SPDX-License-Identifier: Apache-2.0
"""The command line: exit codes, one clear line per mistake, help that names every command."""

import re
import subprocess
import sys

import pytest
import yaml

from loco_bringup import cli


def loco(*arguments, capsys=None):
    """Exit code of the command, and what it printed."""
    with pytest.raises(SystemExit) as end:
        cli.main([str(a) for a in arguments])
    printed = capsys.readouterr()
    return end.value.code or 0, printed.out, printed.err


@pytest.fixture
def run(capsys):
    return lambda *arguments: loco(*arguments, capsys=capsys)


def test_help_names_every_command_and_exit_code(run):
    code, out, _ = run("--help")
    assert code == 0
    for word in ("run", "demo", "list", "info", "report", "replay", "study", "bench", "test"):
        assert re.search(rf"^\s+{word}\s", out, re.M), word
    assert "exit codes" in out


@pytest.mark.parametrize(
    "command", ["run", "demo", "list", "info", "report", "replay", "study", "bench", "docs"]
)
def test_every_command_has_help(run, command):
    code, out, _ = run(command, "--help")
    assert code == 0
    assert len(out) > 80


def test_help_is_light():
    # Heavy imports would make every start slow.
    code = (
        "import sys, loco_bringup.cli as c; c.parser(); "
        "bad = {'numpy', 'rclpy', 'pybullet', 'matplotlib', 'numba'} & set(sys.modules); "
        "assert not bad, bad"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


MISTAKES = [
    (("run", "hyq_trott"), "hyq_trot_open"),
    (("run", "nowhere.yaml"), "nowhere.yaml"),
    (("run", "hyq_short", "--set", "gait.speed"), "KEY=VALUE"),
    (("run", "hyq_short", "--set", "gait.sped=0.3"), "did you mean 'speed'"),
    (("run", "hyq_short", "--set", "gait.speed=fast"), "must be a number"),
    (("run", "hyq_short", "--set", "gait.speed=9.0"), r"\[-1, 1\] m/s, got 9.0"),
    (("run", "hyq_short", "--set", "learner.memory=1.5"), "whole number"),
    (("run", "hyq_short", "--seed", "-4"), "seed"),
    (("run", "hyq_short", "--layout", "threads"), "composed, processes"),
    (("run", "hyq_short", "--set", "effects=[{name: pussh}]"), "push"),
    (("run", "hyq_short", "--clock", "sundial"), "lockstep"),
    (("run", "hyq_short", "--tick", "late=never"), "hold, safe-stop"),
    (("run", "hyq_short", "--tick", "clock=asap"), "take --clock"),
    (("run", "hyq_short", "--realtime", "fifo=100"), r"\[0, 99\]"),
    (("run", "hyq_short", "--realtime", "cpu=1"), "did you mean 'cpus'"),
    (("run", "hyq_short", "--realtime", "cpus=first"), "numbers such as"),
    (("soak", "--ticks", "10"), "at least 1000, got 10"),
    (("bench", "rls", "--rate", "100"), "no options rate"),
    (("bench", "realtime", "--seconds", "0.5"), "at least 2"),
    (("info", "nowhere"), "no bag at nowhere"),
    (("report", "nowhere"), "no bag at nowhere"),
    (("replay", "nowhere"), "no bag at nowhere"),
    (("study", "no_study"), "available"),
    (("bench", "lightness"), "rls"),
    (("list", "lists"), "experiments"),
]


@pytest.mark.parametrize(("arguments", "message"), MISTAKES, ids=lambda v: str(v)[:40])
def test_a_mistake_is_one_line_and_code_2(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert code == 2
    assert re.search(message, err), err
    assert err.startswith("loco: ")
    assert "Traceback" not in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())  # nothing half-written


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gait: {speed: 0.2", "line"),
        ("- a\n- b", "mapping"),
        ("gait: fast", "mapping"),
        ("robot: dog", "hyq"),
        ("effects: [{delay: 0.1}]", "name"),
    ],
)
def test_broken_experiment_files_are_named(run, text, message, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    code, _, err = run("run", path)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_lists_show_what_there_is(run):
    code, out, _ = run("list")
    assert code == 0
    for word in ("hyq_trot_open", "chapter8", "command_delay", "robot_state"):
        assert word in out


@pytest.mark.ros
def test_run_info_and_replay_from_the_command_line(run, tmp_path):
    folder = tmp_path / "a bag"  # a path with a space
    code, out, _ = run(
        "run", "hyq_short", "--layout", "rollout", "--set", "duration=0.5", "--out", folder
    )
    assert code == 0
    assert "0.5 s simulated" in out
    code, out, _ = run("info", folder)
    assert code == 0
    assert "/robot_state" in out and "hyq_short" in out
    code, out, _ = run("replay", folder, "--speed", "0", "--topics", "robot_state")
    assert code == 0
    assert "125 messages of 1 topics" in out
    code, _, err = run("replay", folder, "--speed", "-1")
    assert code == 2 and "speed must be 0 or more" in err
    code, _, err = run("replay", folder, "--topics", "nothing")
    assert code == 2 and "robot_state" in err
    code, _, err = run("run", "hyq_short", "--out", folder)
    assert code == 2 and "holds a bag already" in err
    saved = yaml.safe_load((folder / "experiment.yaml").read_text())
    assert saved["duration"] == 0.5


def test_test_command_passes_arguments_to_pytest(run, monkeypatch):
    calls = []

    class Done:
        returncode = 5

    monkeypatch.setattr(cli.subprocess, "run", lambda c, **k: calls.append(c) or Done())
    code, _, _ = run("test", "-k", "nothing", "-x")
    assert code == 5
    assert calls[0][-3:] == ["-k", "nothing", "-x"]
