# SPDX-License-Identifier: Apache-2.0
"""A node that runs is listened to for longer before it is called silent."""

import os
import subprocess
import sys

import pytest

from loco_bringup.doctor import terminal
from loco_bringup.doctor.graph import MUTE
from loco_bringup.graph.view import SILENCE_TIMEOUT, Report, View


class Listener:
    """Hears of a node of a process at certain ages, one each time it is asked."""

    def __init__(self, pid, ages):
        self.pid, self.ages, self.asked = pid, list(ages), []

    def __call__(self):
        return self

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def listen(self, seconds, silent=SILENCE_TIMEOUT):
        self.asked.append(seconds)
        report = Report(0, "running", {"pid": str(self.pid)}, self.ages.pop(0))
        return View(reports={"stance_controller": report}, silent=silent)


def examine(monkeypatch, pid, *ages):
    listener = Listener(pid, ages)
    monkeypatch.setattr(terminal, "GraphObserver", listener)
    for check in ("check_environment", "check_messages", "check_shared_memory"):
        monkeypatch.setattr(terminal.environment, check, lambda *_: [])
    found = terminal.examine(2.0)
    return [f.text for f in found if f.fault == "node silent"], listener.asked


def test_who_speaks_is_asked_once(monkeypatch):
    assert examine(monkeypatch, os.getpid(), 1.0) == ([], [2.0])


def test_who_was_late_is_no_fault(monkeypatch):
    assert examine(monkeypatch, os.getpid(), 4.0, 6.0) == ([], [2.0, terminal.LISTEN_TIMEOUT])


def test_who_says_nothing_all_the_while_is_named(monkeypatch):
    found, asked = examine(monkeypatch, os.getpid(), 4.0, 4.0 + terminal.LISTEN_TIMEOUT)
    assert asked == [2.0, terminal.LISTEN_TIMEOUT]
    assert len(found) == 1 and MUTE in found[0] and "for 14 s" in found[0]


@pytest.mark.parametrize("age", [SILENCE_TIMEOUT, 60.0])
def test_of_a_process_that_is_gone_nothing_more_is_hoped(monkeypatch, age):
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"],
                          capture_output=True, text=True)  # fmt: skip
    found, asked = examine(monkeypatch, int(gone.stdout), age)
    assert asked == [2.0] and "is gone" in found[0]
