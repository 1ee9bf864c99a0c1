# SPDX-License-Identifier: Apache-2.0
"""Replays: order, part of a bag, speed, pause and steps."""

import time

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.record.order import Order
from loco_bringup.record.pace import Pace
from loco_control.exceptions import ParameterError
from loco_control.ros.messages.definitions import definition, type_hash

KIND = "std_msgs/msg/Float64"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Two topics at 100 Hz for 1 s from 5 s on; times jump back within small chunks."""
    writer = BagWriter(tmp_path_factory.mktemp("order") / "bag", chunk_size=700)
    for name in ("/a", "/b"):
        writer.add_topic(name, KIND, definition(KIND), type_hash(KIND), [])
    order = np.arange(101)
    order = np.concatenate([np.random.default_rng(0).permutation(p) for p in np.split(order, [50])])
    for k in order.tolist():
        for name in ("/a", "/b"):
            data = b"\x00\x01\x00\x00" + np.float64(k).tobytes()
            writer.write(name, data, 5_000_000_000 + k * 10_000_000)
    writer.close()
    return Bag(writer.folder)


def test_messages_come_in_the_order_of_their_times(bag):
    rows = list(Order(bag, ["/a", "/b"]))
    times = [t for t, _, _ in rows]
    assert times == sorted(times) and len(rows) == 202
    values = [np.frombuffer(d[4:])[0] for _, name, d in rows if name == "/a"]
    np.testing.assert_array_equal(values, np.arange(101))


def test_a_part_of_the_bag(bag):
    order = Order(bag, ["/b"], start=0.25, end=0.5)
    times = [t for t, _, _ in order]
    np.testing.assert_allclose(times, np.arange(25, 51) / 100, atol=1e-9)
    assert order.count == 26 and order.length == pytest.approx(0.5)
    assert list(order) == list(order)
    for wrong in ({"start": 2.0}, {"start": -1.0}, {"start": 0.5, "end": 0.2}):
        with pytest.raises(ParameterError, match="start|end"):
            Order(bag, ["/a"], **wrong)


def play(pace, times, commands=()):
    """Wall times at which messages are let go; commands come while waiting."""
    said, waiting = [], list(commands)

    def idle(seconds):
        if waiting:
            pace.command(waiting.pop(0))
        time.sleep(min(seconds, 0.002))

    pace.begin()
    for t in times:
        if not pace.wait(t, idle):
            break
        said.append((t, time.perf_counter()))
    return said


def test_speed_scales_the_time_between_messages():
    times = np.arange(0.0, 0.4, 0.05).tolist()
    for speed in (2.0, 4.0):
        began = time.perf_counter()
        said = play(Pace(speed), times)
        assert len(said) == len(times)
        assert said[-1][1] - began >= times[-1] / speed
    began = time.perf_counter()
    play(Pace(0.0), times)
    assert time.perf_counter() - began < 0.1


def test_paused_it_lets_go_what_is_stepped_all_of_one_time_at_once():
    times = [0.0, 0.0, 0.1, 0.1, 0.2, 0.3]
    said = play(Pace(1.0, paused=True), times, ["step", "step", "quit"])
    assert [t for t, _ in said] == [0.0, 0.0, 0.1, 0.1]
    said = play(Pace(1.0, paused=True), times, ["step 3", "quit"])
    assert [t for t, _ in said] == [0.0, 0.0, 0.1, 0.1, 0.2]


def test_after_a_pause_the_pace_goes_on_from_there():
    pace = Pace(1.0, paused=True)
    pace.begin()
    began = time.perf_counter()
    waited = []

    def idle(seconds):
        waited.append(seconds)
        time.sleep(0.01)
        if time.perf_counter() - began > 0.1:
            pace.command("resume")

    assert pace.wait(3.0, idle)  # no jump to 3 s
    assert time.perf_counter() - began < 1.0
    assert pace.wait(3.02, lambda seconds: time.sleep(seconds))
    assert time.perf_counter() - began > 0.12


def test_unknown_commands_are_named():
    for wrong in ("stop", "speed", "speed -1", "step x", ""):
        with pytest.raises(ParameterError, match="pause, resume"):
            Pace().command(wrong)
