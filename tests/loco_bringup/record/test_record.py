# SPDX-License-Identifier: Apache-2.0
"""`loco record`: any graph's topics, with their types, QoS and bytes."""

import threading
import time

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from loco_bringup.bag.reader import Bag
from loco_bringup.record.record import record
from loco_control.exceptions import BagError, ParameterError

pytestmark = pytest.mark.ros


class Talker(threading.Thread):
    """A graph that is none of ours: three topics of other QoS, one of them late."""

    def __init__(self):
        super().__init__(daemon=True)
        self.context, self._over = rclpy.Context(), threading.Event()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("talker", context=self.context)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        fast = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_publisher(String, "/name", latched).publish(String(data="it"))
        self._value = self.node.create_publisher(Float64, "/value", 10)
        self._joints = self.node.create_publisher(JointState, "/lab/joints", fast)

    def run(self):
        k, heard, late = 0, 0, None
        while not self._over.wait(0.01):
            self._value.publish(Float64(data=float(k)))
            message = JointState(name=["knee"], position=[0.1 * k])
            message.header.stamp.sec = 100 + k
            self._joints.publish(message)
            k += 1
            heard = heard if self._value.get_subscription_count() else k
            if late is None and self._value.get_subscription_count() and k - heard > 50:
                late = self.node.create_publisher(Float64, "/late", 10)
            elif late:
                late.publish(Float64(data=1.0))

    def close(self):
        self._over.set()
        self.join()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def talker():
    made = Talker()
    made.start()
    yield made
    made.close()


def test_all_topics_are_found_with_type_and_qos_also_late_ones(talker, tmp_path):
    assert record(out=tmp_path / "bag", duration=20.0, exclude="rosout|clock", messages=900) == 0
    bag = Bag(tmp_path / "bag")
    assert set(bag.topics) == {"/name", "/value", "/lab/joints", "/late"}
    assert bag.topics["/name"].count == 1 and bag.messages("name")[0].data == "it"
    values = bag.records("value")["data"]
    np.testing.assert_array_equal(np.diff(values), 1.0)  # none is missing
    offered = {name: yaml.safe_load(bag.offered(name))[0] for name in bag.topics}
    assert offered["/name"]["durability"] == "transient_local"
    assert offered["/lab/joints"]["reliability"] == "best_effort"
    assert abs(bag.end - time.time()) < 60.0


def test_some_topics_by_the_stamps_of_their_messages(talker, tmp_path):
    assert record(["lab/joints"], tmp_path / "bag", duration=20.0, stamps=True, messages=50) == 0
    bag = Bag(tmp_path / "bag")
    assert set(bag.topics) == {"/lab/joints"}
    stamps = [m.header.stamp.sec for m in bag.messages("joints")]
    np.testing.assert_array_equal(bag.times("joints"), np.array(stamps) * 1_000_000_000)


def test_what_never_came_is_said(tmp_path, capfd):
    assert record(["nothing"], tmp_path / "bag", duration=0.3) == 1
    assert "never seen: /nothing" in capfd.readouterr().out


def test_mistakes_are_one_clear_line(tmp_path):
    with pytest.raises(ParameterError, match="duration"):
        record(out=tmp_path / "bag", duration=-1.0)
    with pytest.raises(ParameterError, match="regular expression"):
        record(out=tmp_path / "bag", exclude="(")
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="no bag can be written"):
        record(out=tmp_path / "file" / "bag")
