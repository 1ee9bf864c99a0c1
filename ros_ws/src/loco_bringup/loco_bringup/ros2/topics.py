# SPDX-License-Identifier: Apache-2.0
"""Commands `ros2 topic` list, info, echo, hz and pub."""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np
from rclpy.duration import Duration

from loco_control.exceptions import GraphError
from loco_control.ros.messages.installed import profile

from ..client import matching
from .client import DISCOVERY, Client
from .values import as_yaml, filled, type_of

write = sys.stdout.write


def list_topics(client: Client, a: argparse.Namespace) -> None:
    """Print the topics, with their types if requested."""
    client.settle()
    for name, types in sorted(client.node.get_topic_names_and_types()):
        write(f"{name} [{', '.join(types)}]\n" if a.show_types else f"{name}\n")


def info(client: Client, a: argparse.Namespace) -> None:
    """Print the type of a topic and its numbers of publishers and subscriptions."""
    write(f"Type: {client.topic_type(a.topic)}\n")
    client.settle()
    write(f"Publisher count: {client.node.count_publishers(a.topic)}\n")
    write(f"Subscription count: {client.node.count_subscribers(a.topic)}\n")


def echo(client: Client, a: argparse.Namespace) -> None:
    """Print messages on arrival; only the first with ``--once``."""
    got = _listen(client, a.topic, a.type)
    while True:
        client.wait(lambda: got)
        for message in got[: 1 if a.once else None]:
            write(f"{as_yaml(message)}---\n")
        sys.stdout.flush()
        if a.once:
            return
        got.clear()


def hz(client: Client, a: argparse.Namespace) -> None:
    """Print the rate of a topic over its newest messages once per second, in wall time."""
    times: list[float] = []
    _listen(client, a.topic, None, lambda _: times.append(time.monotonic()))
    while True:
        before = len(times)
        client.spin(1.0)
        if len(times) < 2 or len(times) == before:
            write("no new messages\n" if times else "")
        else:
            gaps = np.diff(times[-a.window :])
            write(
                f"average rate: {1.0 / gaps.mean():.3f}\n\tmin: {gaps.min():.3f}s "
                f"max: {gaps.max():.3f}s std dev: {gaps.std():.5f}s window: {len(gaps) + 1}\n"
            )
        sys.stdout.flush()


def _listen(client: Client, name: str, kind: str | None, receive: Any = None) -> list[Any]:
    """List that receives the messages of a topic, including latched ones if a writer latches."""
    got: list[Any] = []
    cls = type_of(kind or client.topic_type(name), "msg")
    client.wait(lambda: client.node.get_publishers_info_by_topic(name), DISCOVERY)
    quality = matching(client.node.get_publishers_info_by_topic(name), 100)
    client.node.create_subscription(cls, name, receive or got.append, quality)
    return got


def pub(client: Client, a: argparse.Namespace) -> None:
    """Publish a message at a rate, a number of times or once.

    Raises:
        GraphError: A number of times is given, and no subscription appeared within `DISCOVERY`.
    """
    cls = type_of(a.type, "msg")
    message = filled(cls, a.values)
    reliable, latched = a.qos_reliability != "best_effort", a.qos_durability == "transient_local"
    publisher = client.node.create_publisher(cls, a.topic, profile(reliable, latched, 10))
    times = 1 if a.once else a.times
    expected = a.wait_matching_subscriptions
    expected = int(times > 0) if expected is None else expected
    if expected and not client.wait(lambda: publisher.get_subscription_count() >= expected, 0.1):
        write(f"Waiting for at least {expected} matching subscription(s)...\n")
        sys.stdout.flush()
        if not client.wait(lambda: publisher.get_subscription_count() >= expected, DISCOVERY):
            raise GraphError(f"nobody listens to {a.topic}; see `loco ros2 topic list`")
    write("publisher: beginning loop\n")
    count = 0
    while True:
        count += 1
        publisher.publish(message)
        write(f"publishing #{count}: {message!r}\n\n")
        sys.stdout.flush()
        if count == times:  # the node must not be gone before all have the message
            if reliable:  # a subscription that does not know the publisher yet gets it again
                publisher.wait_for_all_acked(Duration(seconds=DISCOVERY))
            client.spin(a.keep_alive)
            return
        client.spin(1.0 / a.rate)
