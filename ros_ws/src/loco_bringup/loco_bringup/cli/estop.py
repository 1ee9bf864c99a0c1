# SPDX-License-Identifier: Apache-2.0
"""`loco estop`: emergency stop from the terminal, once or by key presses."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import termios
import time
import tty
from collections.abc import Iterator
from typing import Any

from std_srvs.srv import SetBool

from loco_control.exceptions import GraphError, ParameterError
from loco_control.ros.messages.topics import topic

from ..client import GraphClient

_SERVICE = "set_estop"
_TIMEOUT = 5.0  # wall time to discover robots, and for each to answer [s]
_KEYS = "space stops, r resets, q quits\n"


def show_estop(a: argparse.Namespace) -> int:
    """`loco estop`: stop or reset robots, once or at each key press.

    Returns:
        0 if every robot confirmed, else 1.

    Raises:
        GraphError: No robot is running.
        ParameterError: The rate of the heartbeat is out of range.
    """
    if not 0.0 <= a.heartbeat <= 1000.0:
        raise ParameterError(f"--heartbeat must be 0 to 1000 Hz, got {a.heartbeat:g}")
    if a.heartbeat:
        return _beat(a.namespace or "", a.heartbeat)
    with _Stopper(a.namespace) as stopper:
        if not a.keys:
            return int(not stopper.send(not a.reset))
        sys.stdout.write(_KEYS)
        sys.stdout.flush()
        for key in _keys():
            if key == "q":
                break
            if key in " r":
                stopper.send(key == " ")
    return 0


def _beat(namespace: str, rate: float) -> int:
    """Publish the operator's heartbeat until the user ends it."""
    row = topic("heartbeat")
    with GraphClient(f"heartbeat_{os.getpid()}", namespace) as client:
        publisher = client.node.create_publisher(row.type, row.name, row.qos.writer())
        sys.stdout.write(f"{rate:g} beats a second on {publisher.topic_name}; Ctrl-C ends them\n")
        sys.stdout.flush()
        with contextlib.suppress(KeyboardInterrupt):
            while True:
                publisher.publish(row.type())
                client.spin(1.0 / rate)
    return 0


class _Stopper(GraphClient):
    """Service clients of all selected plants."""

    def __init__(self, namespace: str | None):
        super().__init__(f"estop_{os.getpid()}")
        self._wanted = None if namespace is None else f"/{namespace}/{_SERVICE}".replace("//", "/")
        try:
            self._clients = {n: self.node.create_client(SetBool, n) for n in self._find()}
        except GraphError:
            self.close()
            raise

    def _find(self) -> list[str]:
        end = time.monotonic() + _TIMEOUT
        while time.monotonic() < end:
            names = [n for n, _ in self.node.get_service_names_and_types()]
            services = [n for n in names if n == self._wanted or self._wanted is None]
            services = [n for n in services if n.rpartition("/")[2] == _SERVICE]
            if services:
                return sorted(services)
            self.spin(0.05)
        where = "" if self._wanted is None else f" {self._wanted}"
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        raise GraphError(f"no robot offers the service{where or ' ' + _SERVICE} on domain {domain}")

    def send(self, stop: bool) -> bool:
        """Stop or reset all plants, and print the answer of each."""
        done = []
        for name, client in self._clients.items():
            client.wait_for_service(timeout_sec=_TIMEOUT)
            future: Any = client.call_async(SetBool.Request(data=stop))
            answer = future.result() if self.wait(future.done, _TIMEOUT) else None
            text = answer.message if answer else f"no answer within {_TIMEOUT:g} s"
            sys.stdout.write(f"{name.rpartition('/')[0] or '/'}: {text}\n")
            sys.stdout.flush()
            done.append(bool(answer and answer.success))
        return all(done)


def _keys() -> Iterator[str]:
    """Pressed keys, until the end of the input; a terminal delivers them without Enter."""
    before = termios.tcgetattr(sys.stdin) if sys.stdin.isatty() else None
    try:
        if before:
            tty.setcbreak(sys.stdin)
        while key := sys.stdin.read(1):
            yield key
    finally:
        if before:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
