# SPDX-License-Identifier: Apache-2.0
"""The guard names processes for good, and ends those that it was told of and no others."""

import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

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


def wait_until(process, letter):
    """Wait until a process is in a state of proc(5)."""
    end, path = time.monotonic() + 20.0, Path(f"/proc/{process.pid}/stat")
    while path.read_text().rpartition(")")[2].split()[0] != letter:
        assert time.monotonic() < end, "timed out"
        time.sleep(0.01)


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


def test_a_process_is_there_until_its_last_thread_has_ended(child):
    one = child(
        "import ctypes, threading, time\n"
        "threading.Thread(target=time.sleep, args=(60,)).start()\n"
        "print(flush=True); ctypes.CDLL(None).pthread_exit(None)\n"
    )
    began = guard.start_of(one.pid)
    wait_until(one, "Z")
    assert guard.start_of(one.pid) == began != ""


def test_a_stopped_process_hears_a_signal_and_a_missing_one_is_no_error(child):
    one = child()
    one.send_signal(signal.SIGSTOP)
    wait_until(one, "T")
    guard.send(one.pid, signal.SIGTERM)
    assert one.wait(20.0) == -signal.SIGTERM
    guard.send(one.pid, signal.SIGTERM)


@pytest.mark.parametrize(("code", "end"), [(SLEEPS, signal.SIGTERM), (STUBBORN, signal.SIGKILL)])
def test_what_still_runs_is_signalled_until_it_ends(child, monkeypatch, code, end):
    monkeypatch.setattr(guard, "TIMEOUTS", ((2, 0.4), (signal.SIGTERM, 0.6), (signal.SIGKILL, 9.0)))
    one = child(code)
    began = time.monotonic()
    guard.end_all({one.pid: guard.start_of(one.pid)})
    assert one.wait(0.0) == -end
    took = time.monotonic() - began
    assert took >= (0.4 if end == signal.SIGTERM else 1.0)  # it had its time to end by itself


@pytest.mark.parametrize("share", [None, 0.5])
def test_the_kernel_has_ten_seconds_then_a_signal_two_then_the_last_five(monkeypatch, share):
    now, sent = [0.0], []
    monkeypatch.setattr(guard.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(guard.time, "sleep", lambda wait: now.append(now.pop() + wait))
    monkeypatch.setattr(guard, "start_of", lambda pid: "7")  # it never ends
    monkeypatch.setattr(guard, "send", lambda pid, number: sent.append((pid, number, now[0])))
    guard.end_all({12: "7", 13: "6", 14: "7"}, *([] if share is None else [share]))
    scale = share or 1.0
    assert [each[:2] for each in sent] == [
        (pid, number)
        for number in (signal.SIGCONT, signal.SIGTERM, signal.SIGKILL)
        for pid in (12, 14)
    ]
    times = [each[2] for each in sent[::2]] + now
    assert times == pytest.approx([0.0, 10.0 * scale, 12.0 * scale, 17.0 * scale], abs=0.1)


def test_it_does_not_wait_for_what_has_ended(child, monkeypatch):
    monkeypatch.setattr(guard, "TIMEOUTS", ((2, 30.0),) * 3)
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


def test_the_guard_as_a_process_ends_what_it_was_told_when_its_pipe_closes(child):
    one = child()
    subprocess.run(
        [sys.executable, "-m", "loco_bringup.graph.guard", "0.02"],
        input=f"{one.pid} {guard.start_of(one.pid)}\n", text=True, check=True, timeout=60,
    )  # fmt: skip
    assert one.wait(0.0) == -signal.SIGTERM
