# SPDX-License-Identifier: Apache-2.0
"""Faults in a running graph: in lockstep the same each time, and the plant knows what to do."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.graph.processes import _environment
from loco_learning.runs.experiment import load
from loco_workshop.stress.faults import time_outs

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

SHORT = {"duration": 4.0}


def run(folder, faults, changes=SHORT, **options):
    """Bag of a run of the servo pendulum."""
    outcome = runner.run(load("servo_pendulum_sine", changes), folder, faults=faults, **options)
    assert set(outcome.exit_codes.values()) == {0}
    return Bag(folder)


@pytest.fixture(scope="module")
def twice(tmp_path_factory):
    """The same faults in two runs, in one process and in one each."""
    faults = [
        "joint_command:drop:start=1:stop=1.5",
        "joint_target:drop:probability=0.3:start=2:seed=5",
        "joint_states:stuck:start=3:stop=3.2",
    ]
    folder = tmp_path_factory.mktemp("faults")
    layouts = ("composed", "processes")
    return [run(folder / layout, faults, layout=layout) for layout in layouts]


def test_equal_seeds_give_equal_bytes_in_lockstep(twice):
    for name in ("/joint_states", "/joint_command", "/faulty/joint_target", "/joint_target"):
        first, second = (bag.raw(name)[1] for bag in twice)
        assert first == second, name


def test_begin_and_end_are_events(twice):
    said = [(e.tick, e.kind, e.text) for e in twice[0].messages("events") if "fault" in e.kind]
    text = "joint_command:drop:start=1:stop=1.5"
    rate = load("servo_pendulum_sine").control_rate
    assert (rate, "fault", text) in said
    assert (1.5 * rate, "fault over", text) in said
    assert len(said) == 5  # one never ends


def test_a_command_that_is_taken_away_means_the_safe_state(twice):
    rate = load("servo_pendulum_sine").control_rate
    late, back = time_outs(twice[0])
    (begun,) = (told for told, last in late if last == rate - 1)  # the last command before it
    assert 0 < begun - (rate - 1) <= 0.06 * rate + 1
    over = 1.5 * rate
    assert over in back  # a busy machine may have time-outs of its own
    states = twice[0].records("/joint_states")
    held = states["position"][begun + 10 : round(over)]
    assert np.abs(np.diff(held, axis=0)).max() < 0.02  # damped: nothing swings any more
    assert len(states) == 4.0 * rate  # time went on


def test_what_was_said_stays_and_what_was_heard_is_beside_it(twice):
    names = ("/joint_states", "/faulty/joint_states")
    said, heard = (twice[0].records(name)["position"] for name in names)
    rate = round(load("servo_pendulum_sine").control_rate)
    span = slice(3 * rate, round(3.2 * rate))
    assert (heard[span] == heard[3 * rate]).all()
    assert len(np.unique(said[span], axis=0)) > 1
    assert np.array_equal(np.delete(said, np.r_[span], 0), np.delete(heard, np.r_[span], 0))


def test_a_controller_that_fell_behind_lost_ticks_catches_up(tmp_path):
    """No target, so nobody waits for the controller; it stands still until somebody does."""
    stopped = []

    def stop_a_while(progress):
        pid = progress.pids["reflex_network"]
        if not stopped and progress.sim_time > 1.0:
            os.kill(pid, signal.SIGSTOP)
            stopped.append(pid)
        elif stopped and progress.sim_time > 12.0 - 1e-6:  # the plant stands still, too
            os.kill(pid, signal.SIGCONT)

    lost = ["joint_target:drop:start=1:stop=12", "joint_states:stuck:start=100"]
    options = {"layout": "processes", "speed": 4.0, "on_progress": stop_a_while}
    bag = run(tmp_path / "bag", lost, {"duration": 13.0}, **options)
    assert stopped
    rate = load("servo_pendulum_sine").control_rate
    assert len(bag.records("/joint_states")) == 13.0 * rate
    assert 12.0 * rate in time_outs(bag)[1]  # its command is back at once


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("joint_comand:drop", "did you mean 'joint_command'"),
        ("joint_command:drop:p=1", "no parameter in fault drop named 'p'"),
        ("events:nan", "fault nan changes numbers, and messages of events have none"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, fault, message):
    command = ["run", "servo_pendulum_sine", "--out", str(tmp_path / "bag"), "--fault", fault]
    done = subprocess.run(
        [sys.executable, "-m", "loco_bringup.cli.main", *command],
        capture_output=True, text=True, env=_environment(), timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "bag").exists()
