# SPDX-License-Identifier: Apache-2.0
"""A replay in its own process, steered by topic, under other names, again and again."""

import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64, String

from loco_bringup.bag.writer import BagWriter
from loco_bringup.record.replayer import CONTROL
from loco_control.ros.messages.definitions import definition, type_hash

pytestmark = pytest.mark.ros

KIND = "std_msgs/msg/Float64"


class Listener:
    """Hears what is replayed and sends commands."""

    def __init__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("listener", context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.heard = []
        self._node.create_subscription(Float64, "/other", lambda m: self.heard.append(m.data), 1000)
        self._control = self._node.create_publisher(String, CONTROL, 10)

    def until(self, condition, timeout=30.0):
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"timed out; heard {self.heard}"
            self._executor.spin_once(timeout_sec=0.02)

    def say(self, text):
        self.until(lambda: self._control.get_subscription_count() == 1)
        self._control.publish(String(data=text))

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def listener():
    made = Listener()
    yield made
    made.close()


@pytest.fixture
def bag(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    for name in ("/value", "/unused"):
        writer.add_topic(name, KIND, definition(KIND), type_hash(KIND), [])
    import struct

    for k in range(20):
        data = b"\x00\x01\x00\x00" + struct.pack("<d", k)
        writer.write("/value", data, k * 10_000_000)
        writer.write("/unused", data, k * 10_000_000)
    writer.close()
    return writer.folder


def test_paused_stepped_looped_renamed_and_ended_by_topic(bag, listener):
    process = subprocess.Popen(
        [sys.executable, "-m", "loco_bringup.cli.main", "replay", str(bag), "--pause", "--loop",
         "--remap", "value:=/other", "--speed", "10"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        listener.say("nonsense")  # is refused with a warning
        listener.until(lambda: listener._node.count_publishers("/other") == 1)
        listener.say("step 3")
        listener.until(lambda: len(listener.heard) >= 3)
        later = time.monotonic() + 0.5
        listener.until(lambda: time.monotonic() > later)
        assert listener.heard == [0.0, 1.0, 2.0]
        listener.say("resume")
        listener.until(lambda: len(listener.heard) > 50)  # two and a half rounds
        assert listener.heard[:50] == [float(k % 20) for k in range(50)]
        listener.say("quit")
        out, _ = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0
    assert "then stopped" in out and "a replay knows pause, resume" in out
