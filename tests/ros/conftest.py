# SPDX-License-Identifier: Apache-2.0
"""A node under test, and a node that plays the rest of the graph."""

from __future__ import annotations

import time

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from loco_control.ros.executor import until_deadline
from loco_control.ros.messages.convert import Converter
from loco_control.ros.messages.topics import TOPICS, topic
from loco_control.ros.node import LocoNode


class Bench:
    """A node under test and a node that plays the rest of the graph."""

    def __init__(self, make, table=TOPICS, parameters=None):
        pairs = (parameters or {}).items()
        args = [a for name, value in pairs for a in ("-p", f"{name}:={value}")]
        arguments = ["--ros-args", *args] if args else []
        # rclpy's handlers would swallow Ctrl-C and SIGTERM of the test run.
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        self._table = table
        self.executor = EventsExecutor()
        try:
            self.node: LocoNode = make()
        except BaseException:
            rclpy.try_shutdown()  # or no other test could begin
            raise
        self.tester = rclpy.create_node("tester")
        self.executor.add_node(self.node)
        self.executor.add_node(self.tester)
        self._subscriptions = []

    def publisher(self, name):
        row = topic(name, self._table)
        publisher = self.tester.create_publisher(row.type, row.name, row.qos.writer())
        self.wait(lambda: publisher.get_subscription_count() > 0)
        return publisher

    def listen(self, name, cls=None, wait=True):
        """Everything said on a topic: objects of `cls`, or messages without one."""
        row, got = topic(name, self._table), []
        receive = got.append
        if cls is not None:
            converter = Converter(cls)

            def receive(data):
                got.append(converter.unpack(converter.codec.decode(data)))

        subscription = self.tester.create_subscription(
            row.type, row.name, receive, row.qos.reader(100), raw=cls is not None
        )
        self._subscriptions.append(subscription)
        if wait:
            self.wait(lambda: subscription.get_publisher_count() > 0)
        return got

    def wait(self, condition, timeout=20.0):
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, "timed out"
            until_deadline(self.executor, self.node, 0.02)

    def close(self):
        self.node.close()
        self.node.destroy_node()
        self.tester.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def bench():
    """Function that makes a `Bench` of a node class; `done` closes all, as the end does."""
    made = []

    def make(cls, table=TOPICS, **parameters):
        made.append(Bench(cls, table, parameters))
        return made[-1]

    def done():
        while made:
            made.pop().close()

    make.done = done
    yield make
    done()
