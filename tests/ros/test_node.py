# SPDX-License-Identifier: Apache-2.0
"""Joining by tick, and the one way nodes are spun."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import rclpy
from rclpy.experimental import EventsExecutor

from loco_control.ros.health import PeriodMeter
from loco_control.ros.join import TickJoin
from loco_control.ros.messages.convert import Converter
from loco_control.ros.messages.topics import topic
from loco_control.types import MotionCommand, TrunkTorque


def command(tick):
    return MotionCommand(tick, tick * 0.004, np.full(12, float(tick)), np.zeros(12))


def torque(tick):
    return TrunkTorque(tick, tick * 0.004, np.zeros(12), np.zeros(6), np.ones(4, bool))


@pytest.fixture
def joined():
    calls = []
    converters = {"a": Converter(MotionCommand), "b": Converter(TrunkTorque)}
    join = TickJoin(converters, lambda a, b: calls.append((a.tick, b.tick)), PeriodMeter())
    send_a, send_b = join.receiver("a"), join.receiver("b")
    return (
        join,
        calls,
        lambda tick: send_a(converters["a"].pack(command(tick))),
        lambda tick: send_b(converters["b"].pack(torque(tick))),
    )


def test_step_runs_once_when_all_have_the_tick_in_any_order(joined):
    join, calls, a, b = joined
    a(0), b(0), b(1), a(1)
    assert calls == [(0, 0), (1, 1)]


def test_duplicates_and_old_ticks_are_counted_and_not_answered(joined):
    join, calls, a, b = joined
    a(3), b(3), a(3), b(2)
    assert calls == [(3, 3)]
    assert join.stale == 2


def test_different_ticks_do_not_meet(joined):
    join, calls, a, b = joined
    a(1), b(2)
    assert calls == []
    a(2)
    assert calls == [(2, 2)]


def test_one_message_of_the_future_does_not_end_the_join(joined):
    join, calls, a, b = joined
    a(0), b(0), b(900), a(1), b(1)
    assert calls == [(0, 0), (1, 1)]


def test_a_message_that_came_before_its_tick_is_not_used_in_it(joined):
    join, calls, a, b = joined
    for tick in range(3):
        a(tick), b(tick)
    b(7), b(8)
    for tick in range(3, 7):
        a(tick), b(tick)
    a(7)
    assert calls[-1] == (6, 6)
    assert join.missing() == ["b"]
    b(8), a(8)  # one tick ahead: the other topic is slow
    assert calls[-1] == (8, 8)


@pytest.mark.parametrize("late", ["a", "b"])
def test_after_lost_ticks_a_topic_may_come_all_at_once_after_the_others(joined, late):
    """Between different writers there is no order: 40 ticks of one, then those of the other."""
    join, calls, a, b = joined
    for tick in range(3):
        a(tick), b(tick)
    senders = (b, a) if late == "a" else (a, b)
    for send in senders:
        for tick in range(3, 43):
            send(tick)
    assert calls[-1] == (42, 42)


def test_a_plant_takes_nothing_from_the_future():
    calls, refused = [], []
    join = TickJoin(
        {"a": Converter(MotionCommand)}, calls.append, PeriodMeter(),
        newest=lambda: 4, refuse=refused.append,
    )  # fmt: skip
    send, pack = join.receiver("a"), Converter(MotionCommand).pack
    for tick in (3, 5, 900, 4):
        send(pack(command(tick)))
    assert [c.tick for c in calls] == [3, 4]
    assert (join.stale, join.refused, refused) == (2, 0, [])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused_and_the_next_tick_counts(joined, number):
    join, calls, a, b = joined
    spoiled = command(0)
    spoiled.dq[7] = number
    join.receiver("a")(Converter(MotionCommand).pack(spoiled))
    b(0), a(1), b(1)
    assert calls == [(1, 1)]
    assert join.refused == 1


def test_a_clock_that_was_set_back_is_believed_a_late_message_is_not(joined):
    join, calls, a, b = joined
    for tick in (100, 101, 102):
        a(tick), b(tick)
    a(101), b(101)
    assert len(calls) == 3  # late
    a(5), b(5), a(6), b(6)
    assert calls[3:] == [(5, 5), (6, 6)]


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
    """A lock that is held at the signal is free again at the end."""
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
