# SPDX-License-Identifier: Apache-2.0
"""Exchange of messages between the nodes of one process as bytes, without DDS.

The Fast DDS profile of loco does not match endpoints of the same process, so nodes of one process
receive each other's messages from `Post` alone. Exchange with other processes uses DDS.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from rclpy.utilities import get_rmw_implementation_identifier

from . import IGNORE_OWN, PROFILE, has_user_profile

_AT_ONCE = 32  # messages handed over before the executor handles other events: four ticks


def obstacle() -> str:
    """Reason why in-process exchange is impossible here; "" if there is none."""
    if (rmw := get_rmw_implementation_identifier()) != "rmw_fastrtps_cpp":
        return f"the middleware is {rmw}"
    return f"{PROFILE} is set" if has_user_profile(os.environ) else ""


@contextlib.contextmanager
def deaf_to_itself() -> Iterator[None]:
    """Context in which the first node of the process must be created; it reads the profile."""
    os.environ[IGNORE_OWN] = "true"
    try:
        yield
    finally:
        os.environ[IGNORE_OWN] = "false"


class Post:
    """Queue that hands messages published in this process to its readers, in order.

    As with DDS, a message is handed over by the executor and never within the call that publishes
    it. No message is lost: the queue depth of the QoS profile does not apply.

    Args:
        executor: Executor of all nodes of the process.

    Attributes:
        timed: Whether `hand_over` is called between deadlines; else the executor calls it.
    """

    def __init__(self, executor: Any):
        self._executor, self.timed = executor, False
        self._interrupted = False  # a task of the executor is pending
        self._queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._readers: dict[str, list[Callable[[bytes], None]]] = {}
        self._writers: dict[str, int] = {}
        self._latched: dict[str, deque[bytes]] = {}  # newest messages of latched topics

    def publisher(self, *args: Any, **kwargs: Any) -> Publisher:
        """Create a publisher; takes the place of the publisher class in `Node.create_publisher`."""
        publisher = _Publisher(*args, **kwargs)
        name, qos = publisher.topic_name, publisher.qos_profile
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            publisher.latched = self._latched.setdefault(name, deque(maxlen=qos.depth))
        publisher.post, publisher.readers = self, self._readers.setdefault(name, [])
        self._writers[name] = self.writers(name) + 1
        return publisher

    def subscribe(self, subscription: Subscription, callback: Callable) -> None:
        """Pass messages of this process on the topic of a subscription to `callback`, too."""
        kind, name, receive = subscription.msg_type, subscription.topic_name, callback
        if not subscription.raw:

            def receive(data: bytes) -> None:
                callback(deserialize_message(data, kind))

        self._readers.setdefault(name, []).append(receive)
        if subscription.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            for data in self._latched.get(name, ()):
                self.put([receive], data)

    def writers(self, name: str) -> int:
        """Number of publishers of a topic in this process."""
        return self._writers.get(name, 0)

    def put(self, readers: Sequence[Callable[[bytes], None]], data: bytes) -> None:
        """Queue a message for readers."""
        for receive in readers:
            self._queue.append((receive, data))
        if not self._interrupted and not self.timed:
            self._interrupt()

    def hand_over(self) -> bool:
        """Hand the oldest message to its reader; False if the queue was empty."""
        if not self._queue:
            return False
        receive, data = self._queue.popleft()
        receive(data)
        return True

    def _interrupt(self) -> None:
        self._interrupted = True
        self._executor.create_task(self._work)

    def _work(self) -> None:
        queue = self._queue
        for _ in range(_AT_ONCE):
            if not queue:
                break
            receive, data = queue.popleft()
            receive(data)
        self._interrupted = False
        if queue:
            self._interrupt()


class _Publisher(Publisher):
    """DDS publisher that also queues its messages for the readers in this process."""

    post: Post
    readers: list[Callable[[bytes], None]]
    latched: deque[bytes] | None = None

    def publish(self, message: Any) -> None:
        """Publish a message, or the bytes of one."""
        super().publish(message)
        if self.readers or self.latched is not None:
            self.deliver(message if isinstance(message, bytes) else serialize_message(message))

    def deliver(self, data: bytes) -> None:
        """Queue a message for the readers in this process only."""
        if self.latched is not None:
            self.latched.append(data)
        if self.readers:
            self.post.put(self.readers, data)

    def get_subscription_count(self) -> int:
        """Number of readers, those in this process included."""
        return super().get_subscription_count() + len(self.readers)


def raw(publisher: Publisher) -> Callable[[bytes], None]:
    """Function that publishes the bytes of a message.

    This is rclpy's compiled publish without its Python checks, which took 3 % of the time of a
    tick with all nodes in one process.
    """
    send = publisher.handle.publish_raw
    if not isinstance(publisher, _Publisher):
        return send
    deliver = publisher.deliver

    def publish(data: bytes) -> None:
        send(data)
        deliver(data)

    return publish
