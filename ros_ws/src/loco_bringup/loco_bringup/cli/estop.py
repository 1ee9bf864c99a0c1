# SPDX-License-Identifier: Apache-2.0
"""`loco estop`: emergency stop from the terminal, once or by key presses."""

from __future__ import annotations

import argparse
import contextlib
import math
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
_TIMEOUT = 5.0  # wall time to discover robots, and for them to answer [s]
_RESEND_AFTER = 1.0  # wall time after which a stop without an answer is requests again [s]
_DISCOVERY = 1.0  # wall time from the discovery of a robot in which others may follow [s]
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
    """Service clients of all selected plants, also of those that are discovered later."""

    def __init__(self, namespace: str | None):
        super().__init__(f"estop_{os.getpid()}")
        self._service = None if namespace is None else f"/{namespace}/{_SERVICE}".replace("//", "/")
        self._clients: dict[str, Any] = {}
        self._discovered_at = 0.0  # wall time of the last discovery [s]
        if not self.wait(self._discover, _TIMEOUT):
            self.close()
            where = self._service or _SERVICE
            domain = os.environ.get("ROS_DOMAIN_ID", "0")
            raise GraphError(f"no robot offers the service {where} on domain {domain}")

    def _discover(self) -> bool:
        """Add clients of plants that were discovered; returns whether there is one."""
        for name, _ in self.node.get_service_names_and_types():
            is_selected = name == self._service or self._service is None
            if is_selected and name.rpartition("/")[2] == _SERVICE and name not in self._clients:
                self._clients[name] = self.node.create_client(SetBool, name)
                self._discovered_at = time.monotonic()
        return bool(self._clients)

    def send(self, stop: bool) -> bool:
        """Stop or reset all plants as soon as they are discovered, and print the answer of each.

        A plant that has not discovered this client drops its answer, so a stop is repeated.
        """
        futures: dict[str, list[Any]] = {}
        resend_at: dict[str, float] = {}

        def responses(name: str) -> list[Any]:
            return [future.result() for future in futures[name] if future.done()]

        def step() -> bool:
            self._discover()
            time_now = time.monotonic()
            for name, client in self._clients.items():
                requests = futures.setdefault(name, [])
                pending = client.service_is_ready() and not responses(name)
                if pending and time_now > resend_at.get(name, 0.0):
                    requests.append(client.call_async(SetBool.Request(data=stop)))
                    resend_at[name] = time_now + _RESEND_AFTER if stop else math.inf
            return all(map(responses, futures)) and time_now > self._discovered_at + _DISCOVERY

        self.wait(step, _TIMEOUT)
        for name in sorted(futures):
            text = next((r.message for r in responses(name)), f"no answer within {_TIMEOUT:g} s")
            sys.stdout.write(f"{name.rpartition('/')[0] or '/'}: {text}\n")
        sys.stdout.flush()
        return all(any(r.success for r in responses(name)) for name in futures)


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
