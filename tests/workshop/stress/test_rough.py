# SPDX-License-Identifier: Apache-2.0
"""Rough circumstances: what a visitor says is judged, and a wall clock can be set."""

import json
import os
import subprocess
import sys

import pytest

from loco_control.exceptions import GraphError
from loco_workshop.stress.rough import LATE, doctor_said, wall_clock


def told(*faults, grave=True):
    return json.dumps([{"fault": f, "text": "", "remedy": "", "grave": grave} for f in faults])


def test_nothing_grave_is_a_graph_that_goes_on():
    assert doctor_said(0, told()) == "ridden"
    assert doctor_said(0, told("warning", "node silent", grave=False)) == "ridden"


@pytest.mark.parametrize("faults", [*([fault] for fault in sorted(LATE)), sorted(LATE)])
def test_a_late_machine_is_told_apart(faults):
    assert doctor_said(1, told(*faults)) == "late"


@pytest.mark.parametrize("fault", ["node silent", "domain clash", "error", "fall", "ticks"])
def test_any_other_fault_is_a_false_alarm(fault):
    assert doctor_said(1, told(fault)) == ""
    assert doctor_said(1, told(fault, *sorted(LATE))) == ""


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (0, told(*sorted(LATE))),
        (1, told()),
        (-11, told()),
        (2, "usage"),
        (0, ""),
        (0, "3"),
        (1, "[{}]"),
    ],
)
def test_an_exit_code_that_does_not_fit_or_no_answer_is_a_fault(code, text):
    assert doctor_said(code, text) == ""


CLOCK = """
import queue, sys, threading, time
from loco_workshop.stress.rough import _set_clock
for jump in (0.0, 3600.25, -3600.75, -0.5):
    wall, steady = time.time(), time.monotonic()
    _set_clock(jump)
    jumped = time.time() - wall
    time.sleep(0.05)
    threading.Event().wait(0.05)
    try:
        queue.Queue().get(timeout=0.05)
    except queue.Empty:
        pass
    print(jump, jumped, time.time() - wall - jumped, time.monotonic() - steady)
    _set_clock(0.0)
"""


def test_a_wall_clock_jumps_for_all_who_share_it_and_the_steady_one_goes_on(tmp_path):
    both = {**os.environ, **wall_clock(tmp_path / "clock")}
    done = subprocess.run([sys.executable, "-c", CLOCK], env=both, capture_output=True, text=True)
    rows = [[float(x) for x in line.split()] for line in done.stdout.splitlines()]
    assert len(rows) == 4, done.stderr
    for jump, jumped, wall, steady in rows:
        assert jumped == pytest.approx(jump, abs=0.2)
        assert 0.14 < wall < 10.0 and 0.14 < steady < 10.0  # nobody waits for the jump


def test_no_compiler_is_one_clear_line(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", str(tmp_path / "nowhere"))
    with pytest.raises(GraphError, match="CC names one"):
        wall_clock(tmp_path / "clock")
