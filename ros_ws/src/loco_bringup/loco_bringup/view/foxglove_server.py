# SPDX-License-Identifier: Apache-2.0
"""`loco view BAG --foxglove`: the topics of a bag over the WebSocket of Foxglove."""

from __future__ import annotations

import argparse
import time
from collections import deque
from collections.abc import Callable
from types import SimpleNamespace

import foxglove

from loco_control.exceptions import BagError, ParameterError

from ..bag.reader import Bag
from ..record.order import Order
from ..record.pace import Keys, Pace
from ..terminal import console

HOST = "127.0.0.1"  # only programs of this machine are served


def show_foxglove(a: argparse.Namespace) -> int:
    """Serve a bag until Ctrl-C or the key q.

    Raises:
        ParameterError: More or less than one bag is given, or the port is in use.
        BagError: The bag is not a recording of ROS 2.
    """
    if len(a.bag) != 1:
        raise ParameterError(f"--foxglove serves one bag, got {len(a.bag)}")
    with Keys() as keys:
        try:
            serve(Bag(a.bag[0]), a.foxglove, Pace(keys=keys), lambda port: console.print(
                f"in Foxglove: Open connection, ws://{HOST}:{port}; q ends"))  # fmt: skip
        except KeyboardInterrupt:
            return 130
    return 0


def serve(bag: Bag, port: int, pace: Pace, ready: Callable[[int], None]) -> None:
    """Play a bag again and again; who subscribes late first gets the newest message of a topic.

    Args:
        bag: The recording; its bytes are sent unchanged.
        port: TCP port; 0 for any that is free.
        pace: Speed and pauses; its command quit ends the service.
        ready: Called with the port before the first message.

    Raises:
        ParameterError: The port is in use.
        BagError: The bag is not a recording of ROS 2.
    """
    context, channels, newest = foxglove.Context(), {}, {}
    topics: deque[str] = deque()  # filled by a thread of the server
    listener = SimpleNamespace(on_subscribe=lambda who, channel: topics.append(channel.topic))
    for channel in bag.summary.channels.values():
        schema = bag.summary.schemas.get(channel.schema_id)
        if schema is None or channel.message_encoding != "cdr":
            raise BagError(f"{bag.path.name}: {channel.topic} is no topic of ROS 2")
        kind = foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
        channels[channel.topic] = foxglove.Channel(
            channel.topic, schema=kind, message_encoding="cdr", context=context
        )
    try:
        server = foxglove.start_server(
            name=bag.path.stem, host=HOST, port=port, server_listener=listener, context=context
        )
    except RuntimeError as error:
        raise ParameterError(f"port {port} cannot be served: {error}; choose another one") from None
    try:
        ready(server.port)
        order, zero = Order(bag, list(channels)), bag.summary.statistics.message_start_time
        while order.count:
            pace.begin()
            for t, name, data in order:
                if not pace.wait(t, time.sleep):
                    return
                while topics:
                    if (topic := topics.popleft()) in newest:
                        channels[topic].log(newest[topic], log_time=zero + round(1e9 * t))
                channels[name].log(data, log_time=zero + round(1e9 * t))
                newest[name] = data
    finally:
        server.stop()
