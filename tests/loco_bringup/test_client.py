# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends every command that is a node of a graph, also within a message."""

import os
import signal
import threading
import time

import pytest
from std_msgs.msg import String

from loco_bringup.client import GraphClient

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]


@pytest.fixture
def client():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with GraphClient("interrupted") as made:
        yield made
    signal.signal(signal.SIGINT, before)


def test_within_a_message_it_comes_after_the_message_and_nothing_is_logged(client, capfd):
    heard = []

    def hear(message):
        os.kill(os.getpid(), signal.SIGINT)
        heard.append(message.data)

    publisher = client.node.create_publisher(String, "words", 10)
    client.node.create_subscription(String, "words", hear, 10)
    assert client.wait(publisher.get_subscription_count, 10.0)
    publisher.publish(String(data="a"))
    with pytest.raises(KeyboardInterrupt):
        client.spin(10.0)
    assert heard == ["a"]
    assert capfd.readouterr().err == ""
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_long_wait_is_ended_at_once(client):
    began = time.monotonic()
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        client.spin(60.0)
    assert time.monotonic() - began < 30.0


def test_the_handler_of_a_program_is_left_to_it(client):
    came = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    assert client.wait(lambda: came, 60.0)


def test_a_condition_ends_a_wait_and_a_time_out_is_told(client):
    assert client.wait(lambda: True, 0.0)
    assert not client.wait(lambda: False, 0.05)
