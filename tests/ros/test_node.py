# SPDX-License-Identifier: Apache-2.0
"""The one way nodes are spun."""

import os
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.experimental import EventsExecutor

from loco_control.ros.health import PeriodMeter
from loco_control.ros.messages.topics import topic


def test_period_meter_starts_anew_after_each_summary():
    meter = PeriodMeter()
    for _ in range(3):
        meter.mark()
        time.sleep(0.002)
    first, second = meter.summary(), meter.summary()
    assert first["ticks"] == 2
    assert first["period_max_ms"] >= first["period_mean_ms"] >= 2.0
    assert second["ticks"] == 0


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_waiting_node_ends_with_code_0_on_a_signal(number):
    process = subprocess.Popen(
        [sys.executable, "-m", "loco_control.ros.target_node"],
        stderr=subprocess.PIPE,
        env=fresh_environment(),
    )
    try:
        wait_for_node("target_generator")
        process.send_signal(number)
        _, errors = process.communicate(timeout=20)
        assert process.returncode == 0, errors.decode()
    finally:
        process.kill()  # a node left behind would disturb the tests that follow


@pytest.mark.ros
def test_a_signal_interrupts_no_callback():
    """A lock that is held at the signal is free again at the end, and what is said is heard."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS_A_LOCK], stderr=subprocess.PIPE, env=fresh_environment()
    )
    try:
        wait_for_node("holder")
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0, errors.decode()
    assert errors.decode() == ""


@pytest.mark.ros
def test_a_signal_while_python_ends_does_not_change_the_exit_code():
    """Python gives up its handlers before it destroys what a module holds."""
    process = subprocess.Popen(
        [sys.executable, "-c", ENDS_SLOWLY], stdout=subprocess.PIPE, env=fresh_environment()
    )
    try:
        wait_for_node("slow")
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == b"ending\n"
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0


@pytest.mark.ros
def test_what_the_kernel_grants_is_told_in_log_and_diagnostics():
    process = subprocess.Popen(
        [sys.executable, "-m", "loco_control.ros.target_node", "--ros-args"]
        + ["-p", "realtime.timer_slack:=1000"],
        stderr=subprocess.PIPE,
        env=fresh_environment(),
        text=True,
    )
    try:
        values = wait_for_node("target_generator")
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    finally:
        process.kill()
    assert values["realtime"] == "timer slack 1000 ns: granted"
    assert "timer slack 1000 ns: granted" in errors


@pytest.mark.ros
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("gait.duty_factor:=1.7", "duty_factor"),
        ("gait.pattern:=tort", "trot"),
        ("gait.speed:=fast", "gait.speed"),
    ],
)
def test_a_wrong_parameter_is_one_clear_line_and_exit_code_2(setting, message):
    done = subprocess.run(
        [sys.executable, "-m", "loco_control.ros.target_node", "--ros-args", "-p", setting],
        capture_output=True,
        text=True,
        timeout=60,
        env=fresh_environment(),
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


HOLDS_A_LOCK = """
import threading, time
from loco_control.ros.node import LocoNode
from loco_control.ros.executor import run_nodes

class Holder(LocoNode):
    def __init__(self):
        super().__init__("holder")
        self.lock = threading.Lock()
        self.create_timer(0.01, self.hold)
        self.announce_ready()

    def hold(self):
        self.lock.acquire()
        end = time.monotonic() + 0.009
        while time.monotonic() < end:
            pass
        self.event("held")
        self.lock.release()

    def close(self):
        if not self.lock.acquire(timeout=1.0):
            raise SystemExit(5)

raise SystemExit(run_nodes([Holder], []))
"""


ENDS_SLOWLY = """
import os, sys, time
from loco_control.ros.node import LocoNode
from loco_control.ros.executor import run_nodes

class Slow(LocoNode):
    def __init__(self):
        super().__init__("slow")
        self.announce_ready()

class Last:
    def __del__(self, sleep=time.sleep, write=os.write):
        write(1, b"ending\\n")
        sleep(0.5)

code = run_nodes([Slow], [])
sys.last = Last()  # goes with the interpreter, after its signal handlers
raise SystemExit(code)
"""


def wait_for_node(name):
    """Until the node speaks on /diagnostics, so it spins; what it says."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    listener = rclpy.create_node("listener", context=context)
    executor = EventsExecutor(context=context)
    executor.add_node(listener)
    heard = {}
    row = topic("/diagnostics")

    def hear(message):
        heard.update({s.name: {v.key: v.value for v in s.values} for s in message.status})

    listener.create_subscription(row.type, row.name, hear, row.qos.reader())
    end = time.monotonic() + 30.0
    while name not in heard:
        assert time.monotonic() < end, f"{name} did not speak"
        executor.spin_once(timeout_sec=0.1)
    listener.destroy_node()
    context.try_shutdown()
    return heard[name]


def fresh_environment():
    env = dict(os.environ)
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return env
