# SPDX-License-Identifier: Apache-2.0
"""Runs nodes until a signal; the only way a node is spun.

``EventsExecutor.spin()`` of the Jazzy wheels burns a core and ignores signals. Waiting for a
future with a time-out does neither and stays in C++ between messages, unlike ``spin_once``,
but leaves 32 bytes behind each time. So the waits are long, and a timer looks for signals.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import signal
import time
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from .. import realtime
from ..exceptions import LocoError
from . import in_process
from .guest import Herald
from .node import LocoNode

log = logging.getLogger(__name__)

_CHECK_PERIOD = 0.2  # wall time between two looks for a signal [s]
_SLICE = 5.0  # longest wait in C++ [s]
_WAKE_MARGIN = (
    1e-4  # wake so long before a deadline and look at the clock: waking takes 0.05 ms [s]
)
_BURST = 20  # messages that are handled between two ticks that are both late


def run_nodes(makers: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Spin nodes in one EventsExecutor until a signal.

    Args:
        makers: Constructors of the nodes, called after ``rclpy.init``. A plain rclpy node gets
            a `Herald`, so that it can take the place of one of ours.
        args: ROS arguments, ``sys.argv`` when None.

    Returns:
        Exit code: 0 after a signal, 2 for a user's mistake.
    """
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    signals = _listen()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[LocoNode] = []
    guests: list[Node] = []
    code = 0
    executor = EventsExecutor()
    try:
        with _in_process(executor, makers):
            for make in makers:
                if signals:
                    raise ExternalShutdownException
                node = make()
                if not isinstance(node, LocoNode):
                    guests.append(node)
                    executor.add_node(node)
                    node = Herald(node)
                nodes.append(node)
                executor.add_node(node)
        _prepare(nodes)
        _spin(executor, nodes, lambda: not signals and rclpy.ok())
    except ExternalShutdownException:
        code = 0
    except LocoError as error:
        code = 2
        log.error("%s", error)
        if nodes and rclpy.ok():
            nodes[-1].event("error", str(error))
    except Exception:
        if rclpy.ok():
            raise
        code = 0  # somebody else ended the context
    finally:
        for node in nodes:
            node.close()
        executor.shutdown()  # it holds the events of subscriptions, which go with their nodes
        for node in (*nodes, *guests):
            node.destroy_node()
        rclpy.try_shutdown()
        LocoNode.post = None
        # Python restores the default of what it handles when it ends, and a signal in that time
        # would be the end of the process; one that is ignored stays ignored.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _listen() -> list[int]:
    """Keep the signals to end that come from now on; they are looked for between messages.

    rclpy would end the context in the middle of a callback, which then fails to publish, and
    Python's KeyboardInterrupt would come there, too, perhaps with a lock held for good. Nor may a
    second signal end the process while it closes.

    Returns:
        Numbers of the signals; the list grows.
    """
    signals: list[int] = []
    previous_handler = signal.getsignal(signal.SIGTERM)  # by who called us, and is told as before

    def note(number: int, frame: Any) -> None:
        signals.append(number)
        if number == signal.SIGTERM and callable(previous_handler):
            previous_handler(number, frame)

    signal.signal(signal.SIGINT, note)
    signal.signal(signal.SIGTERM, note)
    return signals


def _in_process(executor: Any, makers: Sequence[Any]) -> contextlib.AbstractContextManager:
    """Hand messages over within the process, where several nodes are there and all are ours."""
    all_loco_nodes = all(isinstance(make, type) and issubclass(make, LocoNode) for make in makers)
    if not all_loco_nodes or len(makers) < 2:
        return contextlib.nullcontext()
    if obstacle := in_process.obstacle():
        log.info("%s, so the nodes of this process talk over DDS", obstacle)
        return contextlib.nullcontext()
    LocoNode.post = in_process.Post(executor)
    return in_process.deaf_to_itself()


def _prepare(nodes: Sequence[LocoNode]) -> None:
    """Ask the kernel for what the nodes want, and keep what is there out of garbage collection.

    A full collection takes some 50 ms; what is there now stays to the end anyway.
    """
    gc.collect()
    gc.freeze()
    for params in {node.realtime for node in nodes}:
        granted = realtime.prepare(params)
        for line in granted:
            log.info("%s", line)
        for node in nodes:
            node.granted += granted


def _spin(executor: Any, nodes: Sequence[LocoNode], stop_requested: Callable[[], bool]) -> None:
    timed = next((node for node in nodes if node.timed), None)
    if LocoNode.post and timed:
        LocoNode.post.timed = True
    while timed is not None and stop_requested():
        until_deadline(executor, timed, _CHECK_PERIOD)
    stop = Future()
    check = lambda: None if stop_requested() else stop.set_result(None)  # noqa: E731
    nodes[0].create_timer(_CHECK_PERIOD, check)
    while stop_requested():
        executor.spin_until_future_complete(stop, timeout_sec=_SLICE)


def until_deadline(executor: Any, node: LocoNode, max_wait: float) -> None:
    """Handle a message, or wait for one until the node's deadline, which is absolute.

    Args:
        executor: Executor of all nodes of the process.
        node: The one with deadlines.
        max_wait: Longest wait [s].
    """
    left = node.deadline - _WAKE_MARGIN - time.monotonic()
    if left > 0.0:
        _handle(executor, min(left, max_wait))
        return
    while time.monotonic() < node.deadline:
        pass
    node.on_deadline()
    if node.deadline <= time.monotonic():
        for _ in range(_BURST):
            _handle(executor, 0.0)


def _handle(executor: Any, max_wait: float) -> None:
    """Handle one message, of this process first."""
    if not LocoNode.post or not LocoNode.post.hand_over():
        executor.spin_once(timeout_sec=max_wait)
