# SPDX-License-Identifier: Apache-2.0
"""The guard names processes for good, and ends those that it was told of and no others."""

import io
import os
import signal
import subprocess
import sys
import time

import pytest

from loco_bringup.graph import guard

SLEEPS = "import time; print(flush=True); time.sleep(60)"
STUBBORN = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); " + SLEEPS


@pytest.fixture
def child():
    """Starts processes that sleep, and reaps them at the end."""
    children = []

    def start(code=SLEEPS):
        children.append(subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE))
        children[-1].stdout.readline()
        return children[-1]

    yield start
    for each in children:
        each.kill()
        each.wait()
        each.stdout.close()


def test_the_start_of_a_process_is_that_of_its_life(child):
    one = child()
    assert guard.start_of(one.pid) == guard.start_of(one.pid) != ""
    assert int(guard.start_of(one.pid)) >= int(guard.start_of(os.getpid()))
    with open("/proc/uptime") as file:
        age = float(file.read().split()[0]) - int(guard.start_of(one.pid)) / os.sysconf(
            "SC_CLK_TCK"
        )
    assert 0.0 <= age < 60.0
    one.kill()
    os.waitid(os.P_PID, one.pid, os.WEXITED | os.WNOWAIT)
    assert guard.start_of(one.pid) == ""  # dead, not yet reaped
    one.wait()
    assert guard.start_of(one.pid) == ""


def test_a_stopped_process_hears_a_signal_and_a_missing_one_is_no_error(child):
    one = child()
    one.send_signal(signal.SIGSTOP)
    guard.send(one.pid, signal.SIGTERM)
    assert one.wait(20.0) == -signal.SIGTERM
    guard.send(one.pid, signal.SIGTERM)


@pytest.mark.parametrize(("code", "end"), [(SLEEPS, signal.SIGTERM), (STUBBORN, signal.SIGKILL)])
def test_what_still_runs_is_signalled_until_it_ends(child, monkeypatch, code, end):
    monkeypatch.setattr(guard, "PATIENCE", ((2, 0.4), (signal.SIGTERM, 0.6), (signal.SIGKILL, 9.0)))
    one = child(code)
    began = time.monotonic()
    guard.end_all({one.pid: guard.start_of(one.pid)})
    assert one.wait(0.0) == -end
    took = time.monotonic() - began
    assert took >= (0.4 if end == signal.SIGTERM else 1.0)  # it had its time to end by itself


def test_a_share_of_the_patience_is_a_share_of_the_wait(child, monkeypatch):
    monkeypatch.setattr(guard, "PATIENCE", ((2, 20.0), (signal.SIGTERM, 20.0), (9, 20.0)))
    one = child()
    began = time.monotonic()
    guard.end_all({one.pid: guard.start_of(one.pid)}, 0.02)
    assert one.wait(0.0) == -signal.SIGTERM
    assert 0.4 <= time.monotonic() - began < 15.0


def test_it_does_not_wait_for_what_has_ended(child, monkeypatch):
    monkeypatch.setattr(guard, "PATIENCE", ((2, 30.0),) * 3)
    one = child()
    begins = {one.pid: guard.start_of(one.pid)}
    one.kill()
    one.wait()
    began = time.monotonic()
    guard.end_all(begins)
    assert time.monotonic() - began < 10.0


@pytest.fixture
def told(monkeypatch):
    """Runs the guard with a text as its standard input.

    Returns:
        The begins and the rest with which it ended processes, and how often it cleaned.
    """

    def run(text, *arguments):
        calls, cleaned = [], []
        monkeypatch.setattr(guard, "end_all", lambda *given: calls.append(given))
        monkeypatch.setattr(guard.shm, "clean", lambda: cleaned.append(1))
        monkeypatch.setattr("sys.stdin", io.StringIO(text))
        monkeypatch.setattr("sys.argv", ["guard", *arguments])
        guard.main()
        return calls, len(cleaned)

    return run


def test_a_supervisor_that_says_done_needs_no_guard(told):
    assert told("12 345\ndone\n") == ([], 0)


def test_without_it_every_process_is_ended_and_its_memory_freed(told):
    assert told("12 345\n 13 678 \n", "0.5") == ([({12: "345", 13: "678"}, 0.5)], 1)
    assert told("12 345\n12 400\n") == ([({12: "400"},)], 1)  # restarted under the same pid
