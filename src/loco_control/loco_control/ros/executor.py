# SPDX-License-Identifier: Apache-2.0
"""Execution of the nodes of a process until a signal; every node is spun by `run_nodes`.

``EventsExecutor.spin()`` of the Jazzy wheels occupies a core and ignores signals. Waiting for a
future with a time-out does neither and stays in C++ between messages, unlike ``spin_once``,
but leaks 32 bytes each time. So the waits are long, and a timer checks for signals.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import signal
import sys
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

_USUAL_COLLECTION = gc.get_threshold()  # numbers of new objects
_CHECK_PERIOD = 0.2  # wall time between two checks for a signal [s]
_SLICE = 5.0  # longest wait in C++ [s]
# Wake this long before a deadline, then poll the clock, since waking takes 0.05 ms [s].
_WAKE_MARGIN = 1e-4
_BURST = 20  # messages handled between two late ticks


def run_nodes(makers: Sequence[Callable[[], Node]], args: list[str] | None = None) -> int:
    """Spin nodes in one EventsExecutor until a signal.

    Args:
        makers: Constructors of the nodes, called after ``rclpy.init``. A plain rclpy node gets
            a `Herald`, so that it can replace a node of loco.
        args: ROS arguments, ``sys.argv`` when None.

    Returns:
        Exit code: 0 after a signal, 2 after a user's error.
    """
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    signals = _listen()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[LocoNode] = []
    other_nodes: list[Node] = []
    code = 0
    executor = EventsExecutor()
    try:
        with _in_process(executor, makers):
            for make in makers:
                if signals:
                    raise ExternalShutdownException
                node = make()
                if not isinstance(node, LocoNode):
                    other_nodes.append(node)
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
        code = 0  # other code has shut the context down
    finally:
        for node in nodes:
            node.close()
        executor.shutdown()  # before the nodes: it holds the events of their subscriptions
        for node in (*nodes, *other_nodes):
            node.destroy_node()
        rclpy.try_shutdown()
        LocoNode.post = None
        # At exit Python restores the default handlers, and a signal in that time would kill the
        # process; an ignored signal stays ignored.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def entry(node: type[Node]) -> Callable[[list[str] | None], None]:
    """Entry point of a process with one node, for ``ros2 run`` and ``python -m``."""

    def main(args: list[str] | None = None) -> None:
        sys.exit(run_nodes([node], args))

    return main


def _listen() -> list[int]:
    """Record SIGINT and SIGTERM from now on; they are handled between messages.

    rclpy would end the context in the middle of a callback, which then fails to publish, and
    Python's KeyboardInterrupt could interrupt a callback that holds a lock. A second signal must
    not end the process while it closes.

    Returns:
        Numbers of the received signals; the list grows.
    """
    signals: list[int] = []
    previous_handler = signal.getsignal(signal.SIGTERM)  # of the calling program; still called

    def note(number: int, frame: Any) -> None:
        signals.append(number)
        if number == signal.SIGTERM and callable(previous_handler):
            previous_handler(number, frame)

    signal.signal(signal.SIGINT, note)
    signal.signal(signal.SIGTERM, note)
    return signals


def _in_process(executor: Any, makers: Sequence[Any]) -> contextlib.AbstractContextManager:
    """Enable in-process messages if the process has several nodes and all are `LocoNode`."""
    all_loco_nodes = all(isinstance(make, type) and issubclass(make, LocoNode) for make in makers)
    if not all_loco_nodes or len(makers) < 2:
        return contextlib.nullcontext()
    if obstacle := in_process.obstacle():
        log.info("%s, so the nodes of this process talk over DDS", obstacle)
        return contextlib.nullcontext()
    LocoNode.post = in_process.Post(executor)
    return in_process.deaf_to_itself()


def _prepare(nodes: Sequence[LocoNode]) -> None:
    """Apply the nodes' real-time settings, and exclude existing objects from garbage collection.

    A full collection takes some 50 ms, and existing objects live until the end anyway.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_USUAL_COLLECTION)  # `composed` collects rarely until here
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
    """Handle one message, or wait for one until the absolute deadline of the node.

    Args:
        executor: Executor of all nodes of the process.
        node: The node that has deadlines.
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
    """Handle one message, with priority for messages of this process."""
    if not LocoNode.post or not LocoNode.post.hand_over():
        executor.spin_once(timeout_sec=max_wait)
