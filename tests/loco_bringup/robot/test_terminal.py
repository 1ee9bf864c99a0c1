# SPDX-License-Identifier: Apache-2.0
"""`loco robot new` from the command line: the page's commands, and robots of others in a graph."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.cli import main as cli
from loco_bringup.logs.bag_log import read_log
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout
from loco_sim.robot import robot as robots

from ...quadrupeds import DATA

PAGE = (Path(__file__).parents[3] / "docs" / "robots.md").read_text()


@pytest.fixture
def run(capfd, tmp_path, monkeypatch):
    """Function that runs a command line in a folder of its own: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as end:
            cli.main([str(a) for a in arguments])
        printed = capfd.readouterr()
        return end.value.code or 0, printed.out, printed.err

    return call


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
def test_the_commands_of_the_page_work(run):
    Path("door").mkdir()
    Path("door/door.urdf").write_text(re.search(r"```xml\n(.*?)```", PAGE, re.S)[1])
    block = next(b for b in re.findall(r"```sh\n(.*?)```", PAGE, re.S) if "robot new" in b)
    lines = [line.split() for line in block.splitlines()]
    assert len(lines) == 4
    for words in lines:
        assert words[0] == "./loco"
        code, out, err = run(*words[1:])
        assert (code, err) == (0, "") or (code == 0 and "loco: " not in err), err
    assert "my_door" in out  # `list robots` names folders here
    assert sorted(p.name for p in Path("my_door").iterdir()) == [
        "door.urdf", "experiment.yaml", "picture.png", "robot.yaml"
    ]  # fmt: skip


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
@pytest.mark.parametrize("name", ["a1/a1", "kuka_iiwa/model"])
def test_a_robot_of_others_stands_or_swings_in_the_graph(run, name):
    code, out, _ = run("robot", "new", DATA / f"{name}.urdf", "--out", "mine")
    assert code == 0
    assert "loco run mine/experiment.yaml" in out and "guessed" in out
    robot = robots.load("mine")
    code, _, err = run("run", "mine/experiment.yaml", "--out", "bag", "--set", "duration=2.0")
    assert code == 0, err
    log = read_log(Bag("bag"))
    base, q = log.position[:, 2], log.q
    if robot.fixed_base:
        swing = np.ptp(q, axis=0)
        assert np.all(swing > 0.1)
        assert "hyq_trot_open" not in out
    else:
        trot = out.strip().splitlines()[-1].split()
        assert trot[:2] == ["loco", "run"]
        e = load(trot[2], {"robot": trot[4].partition("=")[2], "duration": 5.0})
        walked = rollout(e)
        assert not walked.fall
        seconds = round(2.0 / e.dt)
        speed = (walked.position[-1, 0] - walked.position[-seconds, 0]) / 2.0
        assert 0.75 < speed / e.gait.speed < 1.25
        assert np.ptp(base) < 0.05 * base[0]
        assert np.abs(q - robot.standing).max() < 0.1


def test_help_teaches(run):
    code, out, _ = run("robot", "new", "--help")
    assert code == 0
    for word in ("robot.yaml", "experiment.yaml", "picture.png", "Guessed", "loco gap experiments"):
        assert word in out


def left():
    """Names in this folder, but for what measuring the coverage of a child process leaves."""
    return [p.name for p in Path().iterdir() if not p.name.startswith(".coverage")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nowhere.urdf",), "there is no URDF at nowhere.urdf"),
        (("broken.urdf",), "broken.urdf: 2 links are named 'a'"),
        ((), "required: urdf"),
        (("broken.urdf", "--out", "."), "exists already"),
    ],
)
def test_a_mistake_is_one_line_and_leaves_nothing(run, arguments, message):
    Path("broken.urdf").write_text('<robot name="r"><link name="a"/><link name="a"/></robot>')
    code, out, err = run("robot", "new", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert left() == ["broken.urdf"]


def test_an_engine_that_ends_on_a_urdf_costs_one_line_and_leaves_nothing(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import os\n"
        "from loco_bringup.robot import terminal\n"
        "def die(urdf, out):\n"
        "    (out.parent / '.out.half').mkdir()\n"
        "    os.kill(os.getpid(), 11)\n"
        "terminal.make = die\n"
    )
    paths = [str(tmp_path), os.environ.get("PYTHONPATH", "")]
    urdf, out = tmp_path / "a.urdf", tmp_path / "new" / "out"
    out.parent.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "loco_bringup.cli.main", "robot", "new", urdf, "--out", out],
        capture_output=True, text=True, timeout=100,
        env={**os.environ, "PYTHONPATH": ":".join(filter(None, paths))},
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert (
        done.stderr == f"loco: {urdf}: the process that tries the robot died with exit code -11\n"
    )
    assert list(out.parent.iterdir()) == []
