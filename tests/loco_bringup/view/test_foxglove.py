# SPDX-License-Identifier: Apache-2.0
"""`loco view --foxglove`, read by a WebSocket client as the program Foxglove reads it."""

import json
import queue
import socket
import struct
import threading
from pathlib import Path

import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.cli import main as cli
from loco_bringup.record.pace import Pace

pytest.importorskip("foxglove")
client = pytest.importorskip("websockets.sync.client")

from loco_bringup.view.foxglove_server import serve  # noqa: E402

BAG = Path(__file__).parents[2] / "golden/tigrillo_open"
WAIT = 60.0  # until the server answers, on a busy machine [s]


@pytest.fixture
def server():
    """Port of a server that plays the bag as fast as it goes."""
    ports, pace = queue.Queue(), Pace(0.0)
    thread = threading.Thread(target=serve, args=(Bag(BAG), 0, pace, ports.put))
    thread.start()
    yield ports.get(timeout=WAIT)
    pace.command("quit")
    thread.join()


def test_a_client_reads_the_topics_with_their_types_and_recorded_bytes(server):
    bag, wanted = Bag(BAG), {}
    with client.connect(f"ws://127.0.0.1:{server}", subprotocols=["foxglove.sdk.v1"]) as socket_:
        while len(wanted) < len(bag.topics):
            message = socket_.recv(timeout=WAIT)
            if isinstance(message, str) and (message := json.loads(message))["op"] == "advertise":
                wanted |= {channel["id"]: channel for channel in message["channels"]}
        assert {c["topic"]: c["schemaName"] for c in wanted.values()} == {
            name: topic.type for name, topic in bag.topics.items()
        }
        asked = [{"id": number, "channelId": number} for number in wanted]
        socket_.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        read = {}
        while len(read) < len(wanted):
            message = socket_.recv(timeout=WAIT)
            if isinstance(message, bytes) and message[0] == 1:
                number, _ = struct.unpack_from("<IQ", message, 1)
                read[wanted[number]["topic"]] = message[13:]
    for name, data in read.items():
        assert data in bag.raw(name)[1]


@pytest.mark.parametrize(("bags", "told"), [([BAG], "cannot be served"), ([BAG, BAG], "got 2")])
def test_a_port_in_use_and_two_bags_are_told(bags, told, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SystemExit):
        cli.main(["view", *map(str, bags), "--foxglove", str(taken.getsockname()[1])])
    assert told in capsys.readouterr().err
