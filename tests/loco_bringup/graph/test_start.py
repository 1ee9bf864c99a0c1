# SPDX-License-Identifier: Apache-2.0
"""How long nodes may take to start: as long as they make progress."""

import math
import os
import signal
import subprocess
import sys
import time

import pytest

from loco_bringup.graph.process_info import processor_time, waiting_time
from loco_bringup.graph.start import StartLimits, StartMonitor
from loco_bringup.graph.watch import Watch
from loco_bringup.outcome import remove_bag
from loco_control.exceptions import GraphError, ParameterError

LIMITS = StartLimits(timeout=60.0)


class Machine:
    """Clock and processes of a test: a process uses a share of a core."""

    def __init__(self, *shares, waits=0.0):
        self.now, self.shares, self._used = 0.0, list(shares), [0.0] * len(shares)
        self.monitor = StartMonitor(
            LIMITS, lambda: range(len(shares)), lambda: self.now, self._used.__getitem__,
            lambda pid: waits * self.now,
        )  # fmt: skip

    def pass_time(self, seconds):
        """Reason of the failure, and when it came [s]."""
        end = self.now + seconds
        while self.now < end:
            self.now += 0.1
            self._used = [u + 0.1 * s for u, s in zip(self._used, self.shares, strict=True)]
            self.monitor.used = self._used.__getitem__
            if failure := self.monitor.failure():
                return failure
        return ""


def test_imports_on_a_slow_machine_are_progress():
    machine = Machine(0.1, 0.1)  # two processes that get a tenth of a core each
    assert machine.pass_time(300.0) == ""


def test_imports_beside_twenty_others_are_progress():
    machine = Machine(0.04, 0.001, waits=0.95)  # 40 ms a second, and else in the queue
    assert machine.pass_time(300.0) == ""


def test_idle_nodes_beside_twenty_others_are_given_up():
    machine = Machine(0.005, 0.005, 0.005, 0.005, 0.0, waits=0.5)
    assert machine.pass_time(300.0) == "not ready: no progress for 60 s"


def test_waiting_for_a_processor_is_counted():
    code = "while True: pass"
    loops = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(2)]
    try:
        for loop in loops:
            os.sched_setaffinity(loop.pid, {min(os.sched_getaffinity(0))})
        time.sleep(1.0)
        assert all(waiting_time(loop.pid) > 0.05 for loop in loops)
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
    assert waiting_time(loops[0].pid) == 0.0


def test_nodes_that_wait_for_a_silent_one_are_given_up():
    machine = Machine(0.01, 0.01, 0.01, 0.01, 0.0)
    assert machine.pass_time(300.0) == "not ready: no progress for 60 s"
    assert machine.now == pytest.approx(60.0, abs=0.5)


def test_the_time_counts_from_the_last_import_and_from_the_last_event():
    machine = Machine(1.0)
    machine.pass_time(50.0)
    machine.shares[0] = 0.0
    machine.pass_time(50.0)
    machine.monitor.advance()
    assert machine.pass_time(300.0)
    assert machine.now == pytest.approx(160.0, abs=0.5)


def test_a_node_that_computes_for_ever_is_given_up():
    machine = Machine(1.0)
    assert "though its processes are busy" in machine.pass_time(math.inf)
    assert machine.now == pytest.approx(600.0, abs=1.0)


@pytest.mark.parametrize("timeout", [0.0, -1.0, math.inf, math.nan])
def test_a_timeout_that_is_no_time_is_refused(timeout):
    with pytest.raises(ParameterError, match="start timeout must be .* got"):
        StartLimits(timeout)


def test_processor_time_is_that_of_all_threads():
    code = "import threading, time\nthreading.Thread(target=lambda: sum(range(10**8))).start()"
    process = subprocess.Popen([sys.executable, "-c", code])
    while processor_time(process.pid) < 0.1 and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGSTOP)
    try:
        assert processor_time(process.pid) >= 0.1
    finally:
        process.kill()
        process.wait()
    assert processor_time(process.pid) == 0.0


def test_waiting_for_the_same_is_no_progress_and_for_another_is(tmp_path, monkeypatch):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    watch = Watch([], tmp_path, 1.0, lambda progress: None, {"": "hyq"})
    steps = []
    monkeypatch.setattr(watch._start, "advance", lambda: steps.append(1))

    def report(**waits):
        values = [KeyValue(key=k.replace("_", " "), value=v) for k, v in waits.items()]
        status = DiagnosticStatus(name="reflex_network", values=values)
        watch.on_diagnostics(DiagnosticArray(status=[status]))

    for _ in range(3):
        report(waiting_for="robot_state", waiting_for_nodes="stance_controller")
    assert len(steps) == 1
    report(waiting_for="robot_state", waiting_for_nodes="target_generator")
    assert len(steps) == 2


def test_a_run_that_never_began_leaves_no_bag(tmp_path):
    from loco_bringup.graph import run as runner
    from loco_learning.runs.experiment import load

    experiment = load("hyq_trot_open", {"duration": 0.1})
    with pytest.raises(GraphError, match="not ready.*--start-timeout"):
        runner.run(experiment, tmp_path / "run", start_timeout=0.01)
    assert not list((tmp_path / "run").glob("*.mcap"))
    assert not (tmp_path / "run" / "metadata.yaml").exists()
    assert (tmp_path / "run" / "logs").is_dir()


def test_only_the_recording_is_removed(tmp_path):
    for name in ("a_0.mcap", "metadata.yaml", "params.yaml"):
        (tmp_path / name).write_text("x")
    remove_bag(tmp_path)
    remove_bag(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["params.yaml"]
