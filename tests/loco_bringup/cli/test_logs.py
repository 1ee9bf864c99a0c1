# SPDX-License-Identifier: Apache-2.0
"""The commands about logs, as they are typed and as the page on logs prints them."""

import json
import os
import pty
import re
import shlex

import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.cli import main as cli
from loco_bringup.cli.table import parse
from loco_bringup.record import pace as replay_pace
from loco_bringup.record.pace import Keys, Pace
from loco_workshop.bench.damage import sample


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return sample(tmp_path_factory.mktemp("logs") / "bag", ticks=100)


def loco(*arguments):
    """Exit code of a command."""
    with pytest.raises(SystemExit) as exit_:
        cli.main([str(a) for a in arguments])
    return exit_.value.code


def test_every_command_of_the_page_is_one(repository):
    text = (repository / "docs" / "logs.md").read_text()
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.S))
    lines = [line for line in blocks.splitlines() if line.startswith("./loco ")]
    assert len(lines) > 12
    for line in lines:
        parse(shlex.split(line, comments=True)[1:])


def test_info_checks_every_sum(bag, tmp_path, capfd):
    assert loco("info", bag, "--check") == 0
    out = capfd.readouterr().out
    assert "every chunk and file is whole" in out and "/robot_state" in out
    assert loco("info", bag, "--json") == 0
    about = json.loads(capfd.readouterr().out)
    assert {t["name"]: t["count"] for t in about["topics"]} == {
        "/robot_state": 100,
        "/trunk_torque": 100,
    }
    file = Bag(bag).file
    data = bytearray(file.data)
    chunk = file.chunks[1]
    data[(chunk.start + chunk.stop) // 2] ^= 1
    (tmp_path / "hit.mcap").write_bytes(data)
    assert loco("info", tmp_path / "hit.mcap", "--check") == 2
    assert "loco recover" in capfd.readouterr().err


def test_recover_and_export_print_what_they_made(bag, tmp_path, capfd):
    assert loco("recover", bag) == 0
    assert "whole: 200 messages" in capfd.readouterr().out
    data = Bag(bag).path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    assert loco("recover", tmp_path / "cut.mcap") == 0
    out = capfd.readouterr().out.splitlines()
    assert out[0].startswith("recovered ") and "lost" in out[0]
    assert out[1].startswith("  bytes ")
    made = tmp_path / "cut_recovered"
    assert loco("export", made, "--out", tmp_path / "out", "--topics", "robot_state") == 0
    assert capfd.readouterr().out.strip() == str(tmp_path / "out" / "robot_state.jsonl")


def test_mistakes_are_one_clear_line(bag, tmp_path, capfd):
    for arguments, text in {
        ("recover", tmp_path / "none"): "no bag at",
        ("export", bag, "--format", "xls"): "csv, npz",
        ("replay", bag, "--start", "99"): "start must be within the bag",
        ("replay", bag, "--remap", "robot_state"): "FROM:=TO",
        ("replay", bag, "--verify"): "tick 0 is missing",
        ("replay", bag, "--verify", "--layout", "rollout"): "composed, processes",
        ("record", "--duration", "-1"): "duration",
    }.items():
        assert loco(*arguments) == 2, arguments
        err = capfd.readouterr().err
        assert text in err and "Traceback" not in err, arguments


class Terminal:
    """Stands for stdin: one end of a pseudo terminal."""

    def __init__(self, fd):
        self._fd = fd

    def fileno(self):
        return self._fd


def test_keys_steer_a_replay_and_the_terminal_is_put_back(monkeypatch):
    import termios

    keyboard, screen = pty.openpty()
    monkeypatch.setattr(replay_pace.sys, "stdin", Terminal(screen))
    monkeypatch.setattr(replay_pace.sys, "stderr", Terminal(screen))
    before = termios.tcgetattr(screen)
    with Keys() as keys:
        pace = Pace(1.0, paused=True, keys=keys)
        os.write(keyboard, b"s")
        pace.begin()
        assert pace.wait(0.0, lambda seconds: None)  # the step
        os.write(keyboard, b"x++ ")  # an unknown key, four times as fast, go on
        assert pace.wait(0.5, lambda seconds: None)
        os.write(keyboard, b"q")
        assert not pace.wait(50.0, lambda seconds: None)
    assert termios.tcgetattr(screen) == before
    os.close(keyboard)
    os.close(screen)


def test_without_a_terminal_there_are_no_keys():
    with Keys() as keys:
        assert keys.pressed() == ""


def test_differences_are_shown_in_full(capfd):
    from collections import Counter
    from pathlib import Path

    from loco_bringup.record.compare import Difference, Verdict
    from loco_bringup.record.verify_terminal import show_verify

    first = [Difference("a_topic", k, "field[3]", -5.219523964816731e-07, k) for k in range(9)]
    verdict = Verdict(9, Counter(a_topic=9), Counter(a_topic=9), first)
    assert show_verify(Path("some/bag"), lambda tell: verdict) is verdict
    out = capfd.readouterr().out
    assert "some/bag: different (9 ticks, 9 messages)" in out
    assert "a_topic  2     field[3]  -5.219523964816731e-07  2" in out
    assert "field[3]  -5.219523964816731e-07  3" not in out
    same = Verdict(9, Counter(a_topic=9))
    show_verify(Path("some/bag"), lambda tell: same)
    assert "identical (9 ticks, 9 messages)" in capfd.readouterr().out
