# SPDX-License-Identifier: Apache-2.0
"""The whole graph over real DDS: same bytes in every layout, clean ends, clear errors."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.graph.processes import _environment
from loco_bringup.logs.rollout_bag import VIEWED, run_rollout
from loco_bringup.outcome import default_folder
from loco_control.exceptions import GraphError, NameUnknownError, ParameterError
from loco_control.ros.messages.definitions import type_hash
from loco_control.ros.messages.topics import TOPICS
from loco_learning.runs.experiment import load

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]  # one set of shared runs

LOSSY = {"/clock"}  # best effort: a recorder may miss some
COMMANDS = ("gait_target", "motion_command", "trunk_torque", "stance", "learning_state")


@pytest.mark.parametrize("name", ["processes", "rollout"])
def test_same_seed_gives_the_same_bytes_in_every_layout(outcomes, name):
    one, other = Bag(outcomes["composed"].folder), Bag(outcomes[name].folder)
    for topic in ("robot_state", "ground_truth/odom", *COMMANDS, *set(VIEWED) - LOSSY):
        assert one.raw(topic)[1] == other.raw(topic)[1], topic


def test_another_seed_gives_other_bytes(outcomes, short, tmp_path):
    other = runner.run(short.replace(seed=5), tmp_path / "seed5")
    bags = Bag(outcomes["composed"].folder), Bag(other.folder)
    assert bags[0].raw("motion_command")[1] != bags[1].raw("motion_command")[1]


@pytest.mark.parametrize("layout", ["composed", "processes"])
def test_a_run_ends_cleanly_and_loses_nothing(outcomes, short, layout):
    outcome = outcomes[layout]
    assert outcome.exit_code == 0
    assert set(outcome.exit_codes.values()) == {0}
    assert outcome.dropped == 0
    assert "simulated" in outcome.text
    bag = Bag(outcome.folder)
    for topic in ("robot_state", "ground_truth/odom", *COMMANDS):
        assert bag.topics[bag.resolve(topic)].count == short.ticks, topic
    for topic in ("joint_states", "imu/data", "/tf"):
        assert bag.topics[bag.resolve(topic)].count == -(-short.ticks // 5), topic
    kinds = [e.kind for e in bag.messages("events")]
    assert kinds.count("ready") == 5  # four nodes and the recorder
    assert [e.text for e in bag.messages("events") if e.kind == "phase"] == [
        "stand", "train", "closing", "test",
    ]  # fmt: skip
    assert kinds[-1] == "finished"


def test_a_fall_ends_the_run_with_code_3(tmp_path):
    effects = [{"name": "push", "force": [0.0, 900.0, 0.0], "start": 0.3, "stop": 1.5}]
    experiment = load("hyq_short", {"effects": effects})
    outcome = runner.run(experiment, tmp_path / "fall")
    assert outcome.fallen
    assert outcome.exit_code == 3
    assert "fell at" in outcome.text
    falls = [e for e in Bag(outcome.folder).messages("events") if e.kind == "fall"]
    assert len(falls) == 1


def test_a_node_that_dies_stops_all_others(short, tmp_path):
    long = load("hyq_short", {"learner.train": 600.0})

    def kill_once_it_moves(progress):
        if progress.sim_time > 0.0:
            os.kill(progress.pids["stance_controller"], signal.SIGKILL)

    with pytest.raises(GraphError, match="stance_controller died with exit code -9"):
        runner.run(long, tmp_path / "bag", "processes", on_progress=kill_once_it_moves)
    assert _processes_with(str(tmp_path)) == []
    Bag(tmp_path / "bag")  # the recorder closed its file


def _processes_with(text: str) -> list[int]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if text in path.read_text() and int(path.parent.name) != os.getpid():
                found.append(int(path.parent.name))
        except OSError:
            continue
    return found


def test_ctrl_c_stops_everything_and_keeps_the_bag(tmp_path):
    folder = tmp_path / "bag"
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "loco_bringup.cli.main",
            "run",
            "hyq_trot_long",
            "--out",
            str(folder),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + 60  # 100 ticks are 0.2 MB of bag
    try:
        while sum(p.stat().st_size for p in folder.glob("*.mcap")) < 5e5 and time.monotonic() < end:
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=60)
    finally:
        process.kill()  # it would keep the domain from all tests that follow
    assert process.returncode == 130, errors
    assert "interrupted" in out
    assert _processes_with(str(folder)) == []
    assert Bag(folder).topics["/robot_state"].count > 100


def test_second_run_on_a_domain_is_refused_at_once(short, tmp_path):
    with runner._domain_lock():
        with pytest.raises(GraphError, match="another loco run uses ROS domain"):
            runner.run(short, tmp_path / "second")
    assert not (tmp_path / "second").exists()


WAIT = """
import time, rclpy
rclpy.init()
node = rclpy.create_node("onlooker")
while node.count_publishers("gait_target") < 1:
    time.sleep(0.05)
"""


def test_a_foreign_node_on_the_domain_is_named(tmp_path):
    """A controller that somebody else left running would answer our ticks."""
    command = [sys.executable, "-m", "loco_control.ros.target_node"]
    stray = subprocess.Popen(command, env=_environment())
    try:
        # One that comes when the graph runs already is told in /diagnostics and ends nothing.
        waiting = [sys.executable, "-c", WAIT]
        subprocess.run(waiting, env=_environment(), check=True, timeout=60)
        with pytest.raises(GraphError, match="gait_target has 2 writers"):
            runner.run(load("hyq_short", {"learner.train": 600.0}), tmp_path / "bag")
    finally:
        stray.kill()


def test_a_folder_with_a_bag_is_not_written_over(outcomes, short):
    for folder, start in (("composed", runner.run), ("rollout", run_rollout)):
        with pytest.raises(ParameterError, match="holds a bag already"):
            start(short, outcomes[folder].folder, on_progress=lambda progress: None)


def test_unknown_layout_clock_and_node_set_name_the_choices(short, tmp_path):
    with pytest.raises(ParameterError, match="composed, processes"):
        runner.run(short, tmp_path / "a", layout="threads")
    with pytest.raises(NameUnknownError, match="lockstep"):
        runner.run(short, tmp_path / "b", clock="sundial")
    with pytest.raises(KeyError, match="hyq"):
        runner.run(short, tmp_path / "c", nodes="hyqq")


def test_lockstep_can_be_paced(tmp_path):
    experiment = load("hyq_short", {"duration": 2.0})
    outcome = runner.run(experiment, tmp_path / "paced", speed=1.0)
    assert 0.0 < outcome.real_time_factor <= 1.01  # how far below is up to the machine


def test_realtime_is_never_ahead_of_the_clock_and_counts_late_ticks(tmp_path):
    experiment = load("hyq_short", {"duration": 2.0})
    asked = {"timer_slack": 1000}
    outcome = runner.run(experiment, tmp_path / "realtime", clock="realtime", realtime=asked)
    # On a busy machine commands come late and the robot may fall: no fault of the clock.
    assert outcome.exit_code in (0, 3)
    assert outcome.real_time_factor <= 1.02  # never ahead of the wall clock
    bag = Bag(outcome.folder)
    assert np.all(np.diff(bag.records("robot_state")["tick"].astype(int)) >= 1)
    diagnostics = bag.messages("/diagnostics")
    keys = {v.key for a in diagnostics for s in a.status if s.name == "robot_sim" for v in s.values}
    assert {"late_ticks", "lateness_p99_ms", "missed_ticks", "dropped_ticks"} <= keys
    assert outcome.granted == ["timer slack 1000 ns: granted"]
    late = outcome.timing
    assert late["lateness_p50_ms"] <= late["lateness_p99_ms"] <= late["lateness_max_ms"]
    assert late["dropped_ticks"] <= late["missed_ticks"]


def test_endpoints_of_the_running_graph_are_those_of_the_table(tmp_path):
    long = load("hyq_trot_open", {"duration": 30.0})
    seen = {}

    def look(progress):
        if progress.sim_time > 0.5 and not seen:
            seen.update(_endpoints())
            raise KeyboardInterrupt

    outcome = runner.run(long, tmp_path / "bag", speed=1.0, on_progress=look)
    assert outcome.interrupted
    for row in TOPICS.values():
        infos = seen["/" + row.name.lstrip("/")]
        assert infos or row.writer == "any", row.name
        for info in infos:
            assert info.topic_type == row.kind
            assert str(info.topic_type_hash) == type_hash(row.kind)
            profile, wanted = info.qos_profile, row.qos.writer()
            assert profile.reliability == wanted.reliability, row.name
            assert profile.durability == wanted.durability, row.name


def _endpoints():
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("looker", context=context)
    names = {"/" + t.name.lstrip("/"): t.writer for t in TOPICS.values()}
    written = [name for name, writer in names.items() if writer != "any"]
    end = time.monotonic() + 20.0
    while time.monotonic() < end and not all(map(node.get_publishers_info_by_topic, written)):
        time.sleep(0.05)
    found = {name: node.get_publishers_info_by_topic(name) for name in names}
    node.destroy_node()
    context.try_shutdown()
    return found


def test_a_foreign_quadruped_runs_as_a_graph_like_in_the_loop(quadruped, tmp_path):
    changes = {"robot": str(quadruped("a1")), "duration": 0.4, "gait.start_time": 0.1}
    experiment = load("hyq_trot_open", changes)
    assert runner.run(experiment, tmp_path / "graph").exit_code == 0
    run_rollout(experiment, tmp_path / "loop", lambda progress: None)
    bags = [Bag(tmp_path / "graph"), Bag(tmp_path / "loop")]
    for topic in ("robot_state", "ground_truth/odom", *COMMANDS):
        assert bags[0].raw(topic)[1] == bags[1].raw(topic)[1], topic
    assert bags[0].messages("robot_description")


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b", "a\0b"])
def test_the_name_of_an_experiment_never_leaves_the_folder_of_bags(name):
    with pytest.raises(ParameterError, match="name of an experiment must be a plain file name"):
        default_folder(load("hyq_short", {"name": name}))
