# SPDX-License-Identifier: Apache-2.0
"""The chaos matrix: what it plans, how it judges, and two of its cells."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from loco_bringup.graph.processes import _environment
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.faults import FAULTS
from loco_control.ros.messages.topics import TOPICS
from loco_workshop.stress import (
    chaos,
)
from loco_workshop.stress import (
    chaos_terminal as console_chaos,
)
from loco_workshop.stress import (
    faults as chaos_faults,
)
from loco_workshop.stress.signals import Hits

ALL = {"numbers", "stamp"}


def test_every_process_and_every_topic_has_a_cell():
    found = chaos.cells()
    signals = {(c.how, c.what) for c in found if c.how.startswith("SIG")}
    for process in ("robot_sim", "target_generator", "reflex_network", "stance_controller"):
        assert {("SIGSTOP", process), ("SIGKILL", process)} <= signals
    assert {("SIGSTOP", "recorder"), ("SIGKILL", "recorder"), ("SIGKILL", "supervisor")} <= signals
    assert {("SIGKILL", "guard"), ("SIGKILL", "supervisor and guard")} <= signals
    assert {c.what for c in found if c.how == "faults"} == set(TOPICS)
    assert len({c.name for c in found}) == len(found)


def test_every_fault_comes_as_often_and_never_two_at_once():
    plan = chaos_faults.schedule("motion_command", ALL, True, 7, seed=3)
    kinds = [at.kind for at in plan]
    assert {kinds.count(kind) for kind in (*FAULTS, "composed")} == {7}
    assert all(a.stop < b.start for a, b in zip(plan, plan[1:], strict=False))
    assert plan == chaos_faults.schedule("motion_command", ALL, True, 7, seed=3)
    assert plan != chaos_faults.schedule("motion_command", ALL, True, 7, seed=4)


def test_topics_without_numbers_have_no_faults_of_numbers():
    plan = chaos_faults.schedule("estop", set(), False, 2, seed=0)
    used = {kind for at in plan for kind in at.faults}
    assert used == {kind for kind, fault in FAULTS.items() if not fault.needs}


def event(kind, tick, text):
    return SimpleNamespace(kind=kind, tick=tick, text=text)


@pytest.mark.parametrize(
    ("age", "takes", "safe", "ridden"),
    [
        (16, True, 1, 0),
        (21, True, 0, 0),
        (None, True, 0, 0),
        (None, False, 0, 1),
        (16, False, 0, 0),
    ],
)
def test_a_signal_is_judged_by_the_age_of_the_last_command(age, takes, safe, ridden):
    hits = Hits("SIGSTOP", "recorder", 1, np.random.default_rng(0))
    hits.times = [10.0]
    if age:
        hits.events = [(10.2, event("timeout", 100 + age, "no command since tick 100"))]
    row = dict.fromkeys(("repeats", "safe", "ridden", "worst", "stalls"), 0)
    hits.count(row, takes)
    assert (row["repeats"], row["safe"], row["ridden"], row["worst"]) == (1, safe, ridden, age or 0)


def test_a_robot_that_was_stopped_for_good_gets_no_more_signals():
    hits = Hits("SIGSTOP", "recorder", 3, np.random.default_rng(0))
    events = []
    progress = SimpleNamespace(sim_time=4.0, events=events, pids={"recorder": 0})
    assert not hits(progress) and hits.left == 3
    events.append((1.0, event("estop", 200, "lh_kfe_joint moves at 34.4 rad/s, more than 30")))
    assert hits(progress) and hits.left == 3


def test_a_cell_that_has_run_is_not_run_again_and_an_error_is_a_row(tmp_path, monkeypatch):
    ran = []

    def child(command, **options):
        how, what, *_ = json.loads(command[-1])
        ran.append(what)
        if what == "stance":
            options["stderr"].write("Traceback\nit broke\n")
            return SimpleNamespace(returncode=1, stdout="")
        row = {"what": what, "how": "drop", "ok": True, "notes": [], "repeats": 1}
        return SimpleNamespace(returncode=0, stdout=json.dumps([row]) + "\n")

    monkeypatch.setattr(chaos.subprocess, "run", child)
    wanted = chaos.cells("faults_stance") + chaos.cells("faults_estop")
    first = chaos.run(wanted, 1, 0, tmp_path)
    assert first["faults_stance"][0]["notes"] == ["it broke"]
    assert first == chaos.run(wanted, 1, 0, tmp_path)
    assert ran.count("estop") == 1 and ran.count("stance") == 2  # what failed is tried again
    chaos.run(chaos.cells("faults_estop"), 2, 0, tmp_path)
    assert ran.count("estop") == 2  # other numbers
    text = console_chaos.page([row for rows in first.values() for row in rows])
    assert "| NO |" in text and "| yes |" in text


def test_a_mistake_is_one_line(tmp_path):
    with pytest.raises(NameUnknownError, match="no cell named 'elbow'.*SIGKILL_recorder"):
        chaos.cells("elbow")
    with pytest.raises(ParameterError, match="repeats must be at least 1, got 0"):
        chaos.run(chaos.cells("SIGSTOP"), 0, 0, tmp_path)


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
@pytest.mark.parametrize(
    "cell", ["faults_trunk_torque", "SIGKILL_target_generator", "SIGKILL_supervisor_and_guard"]
)
def test_a_cell_does_what_it_has_to(tmp_path, cell):
    command = ["chaos", "--repeats", "1", "--only", cell, "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "loco_bringup.cli.main", *command],
        capture_output=True, text=True, env=_environment(), timeout=280,
    )  # fmt: skip
    rows = json.loads((tmp_path / "chaos.json").read_text())
    assert done.returncode == 0, done.stdout
    assert all(row["ok"] for row in rows)
    assert max(row.get("worst", 0) for row in rows) <= chaos_faults.SAFE_TICKS
    assert {row["orphans"] + row["segments"] for row in rows} == {0}
