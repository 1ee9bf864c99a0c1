# SPDX-License-Identifier: Apache-2.0
"""A node under test, and a node that plays the rest of the graph."""

from __future__ import annotations

import time

import pytest
import rclpy
from rclpy.action import ActionClient
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

    def answer(self, ask, meanwhile=lambda: None, timeout=20.0):
        """Answer of a service that is asked again after 5 s.

        A server that does not know its client yet drops the answer (rmw_fastrtps waits for 0.1 s).
        """
        asked, due = [], time.monotonic()

        def answered():
            nonlocal due
            if time.monotonic() >= due:
                asked.append(ask())
                due += 5.0
            meanwhile()
            return any(future.done() for future in asked)

        self.wait(answered, timeout)
        return next(future.result() for future in asked if future.done())

    def close(self):
        self.node.close()
        self.node.destroy_node()
        self.tester.destroy_node()
        rclpy.try_shutdown()


class Caller:
    """A client of an action of the node under test.

    Attributes:
        patience: Longest wait for a result [s].
    """

    patience = 240.0

    def __init__(self, bench, action, name):
        self.bench, self.action, self.feedback = bench, action, []
        self.client = ActionClient(bench.tester, action, name)
        bench.wait(self.client.server_is_ready)
        for _ in range(20):  # the server has to know the client too, or its answers are lost
            bench.executor.spin_once(timeout_sec=0.01)

    def send(self, **goal):
        """Handle of a goal that was accepted."""
        heard = self.feedback.append  # of the client lives on what it was given: not us, too
        sent = self.client.send_goal_async(self.action.Goal(**goal), lambda m: heard(m.feedback))
        self.bench.wait(sent.done)
        return sent.result()

    def result(self, handle, meanwhile=lambda: None):
        """Status and result of a goal; `meanwhile` is called until it is there."""
        answer = self.bench.answer(handle.get_result_async, meanwhile, self.patience)
        return answer.status, answer.result

    def close(self):
        self.client.destroy()


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
