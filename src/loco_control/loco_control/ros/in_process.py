# SPDX-License-Identifier: Apache-2.0
"""Messages between the nodes of one process, handed over as bytes instead of through DDS.

Fast DDS is told not to match endpoints of its own process (`in_process.xml`), so that a node
hears of its neighbours from the `Post` alone. Everyone else hears them over DDS as before, and
they hear everyone else.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

PROFILE = Path(__file__).with_name("in_process.xml")
_OF_USER = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_IN_FOLDER = "DEFAULT_FASTRTPS_PROFILES.xml"  # Fast DDS reads it where it starts
_AT_ONCE = 32  # messages that are handed over before the executor looks at the rest: four ticks


def obstacle() -> str:
    """Reason why this process cannot keep its messages from DDS, "" if there is none."""
    if (rmw := get_rmw_implementation_identifier()) != "rmw_fastrtps_cpp":
        return f"the middleware is {rmw}"
    if found := next((name for name in _OF_USER if os.environ.get(name)), ""):
        return f"{found} is set"
    return f"the folder has a {_IN_FOLDER}" if Path(_IN_FOLDER).exists() else ""


@contextlib.contextmanager
def deaf_to_itself() -> Iterator[None]:
    """Within it, the first node of the process must be made; the profile is read then."""
    os.environ[_OF_USER[0]] = str(PROFILE)
    try:
        yield
    finally:
        del os.environ[_OF_USER[0]]


class Post:
    """Hands what a node of this process publishes to the readers in this process, in order.

    A message is never handed over while its writer still publishes, but when the executor comes
    to it, as with DDS. None is lost: the depth of a queue is of no importance here.

    Args:
        executor: Executor of all nodes of the process.

    Attributes:
        timed: Somebody calls `hand_over` between deadlines; else the executor does.
    """

    def __init__(self, executor: Any):
        self._executor, self.timed = executor, False
        self._asked = False  # the executor will come to us
        self._queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._readers: dict[str, list[Callable[[bytes], None]]] = {}
        self._writers: dict[str, int] = {}
        self._kept: dict[str, deque[bytes]] = {}  # newest messages of latched topics

    def publisher(self, *args: Any, **more: Any) -> Publisher:
        """Make a publisher, as the class that `Node.create_publisher` wants."""
        made = _Publisher(*args, **more)
        name, qos = made.topic_name, made.qos_profile
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            made.kept = self._kept.setdefault(name, deque(maxlen=qos.depth))
        made.post, made.readers = self, self._readers.setdefault(name, [])
        self._writers[name] = self.writers(name) + 1
        return made

    def subscribe(self, subscription: Subscription, callback: Callable) -> None:
        """Hand what this process publishes on the topic of a subscription to its callback, too."""
        kind, name, receive = subscription.msg_type, subscription.topic_name, callback
        if not subscription.raw:

            def receive(data: bytes) -> None:
                callback(deserialize_message(data, kind))

        self._readers.setdefault(name, []).append(receive)
        if subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            for data in self._kept.get(name, ()):
                self.put([receive], data)

    def writers(self, name: str) -> int:
        """Number of publishers of a topic in this process."""
        return self._writers.get(name, 0)

    def put(self, readers: Sequence[Callable[[bytes], None]], data: bytes) -> None:
        """Queue a message for readers."""
        for receive in readers:
            self._queue.append((receive, data))
        if not self._asked and not self.timed:
            self._ask()

    def hand_over(self) -> bool:
        """Hand the oldest message to its reader; whether there was one."""
        if not self._queue:
            return False
        receive, data = self._queue.popleft()
        receive(data)
        return True

    def _ask(self) -> None:
        self._asked = True
        self._executor.create_task(self._work)

    def _work(self) -> None:
        queue = self._queue
        for _ in range(_AT_ONCE):
            if not queue:
                break
            receive, data = queue.popleft()
            receive(data)
        self._asked = False
        if queue:
            self._ask()


class _Publisher(Publisher):
    """Publisher over DDS that tells the readers in this process, too."""

    post: Post
    readers: list[Callable[[bytes], None]]
    kept: deque[bytes] | None = None

    def publish(self, message: Any) -> None:
        """Publish a message, or the bytes of one."""
        super().publish(message)
        if self.readers or self.kept is not None:
            self.tell(message if isinstance(message, bytes) else serialize_message(message))

    def tell(self, data: bytes) -> None:
        """Tell the readers in this process alone."""
        if self.kept is not None:
            self.kept.append(data)
        if self.readers:
            self.post.put(self.readers, data)

    def get_subscription_count(self) -> int:
        """Number of readers, those in this process included."""
        return super().get_subscription_count() + len(self.readers)


def raw(publisher: Publisher) -> Callable[[bytes], None]:
    """Function that publishes the bytes of a message.

    It is rclpy's compiled publish without the checks in Python around it, which took 3 % of a
    composed tick.
    """
    send = publisher.handle.publish_raw
    if not isinstance(publisher, _Publisher):
        return send
    tell = publisher.tell

    def publish(data: bytes) -> None:
        send(data)
        tell(data)

    return publish
