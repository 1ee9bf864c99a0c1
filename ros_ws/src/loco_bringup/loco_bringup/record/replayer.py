# SPDX-License-Identifier: Apache-2.0
"""Node `replayer`: publishes the recorded bytes of a bag, unchanged, in log order."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import uninstall_signal_handlers
from std_msgs.msg import String

from loco_control.exceptions import LocoError, ParameterError
from loco_control.reading import parse_yaml
from loco_control.ros.messages.installed import ros_class
from loco_control.ros.messages.topics import LATCHED, LATCHED_LOG, STATE, TOPICS, Qos
from loco_control.ros.parameters import sealed_node

from ..bag.reader import Bag
from ..terminal import bar, console
from .order import Order
from .pace import Keys, Pace

CONTROL = "/replayer/control"


@dataclass(frozen=True)
class Cut:
    """Part of a bag, in seconds from its first message."""

    start: float = 0.0
    end: float | None = None


def replay_bag(
    path: Path,
    speed: float = 1.0,
    topics: list[str] | None = None,
    cut: Cut = Cut(),
    loop: bool = False,
    pause: bool = False,
    remap: Iterable[str] = (),
) -> int:
    """Publish the messages of a bag at `speed` times the recorded (simulated) time.

    It is controlled by keys and by the topic ``/replayer/control`` (pause, resume, step [N],
    speed X, quit).

    Args:
        path: Bag folder or file.
        speed: Multiple of real time; 0 for as fast as possible.
        topics: Names of the topics; None for all.
        cut: Part of the bag to publish.
        loop: Restart at the end.
        pause: Start paused.
        remap: ``FROM:=TO`` texts; a topic is published under another name.

    Returns:
        0 at the end of the bag, 130 after Ctrl-C.

    Raises:
        ParameterError: `speed`, `cut` or `remap` is invalid.
        NameUnknownError: The bag has no such topic.
    """
    if not speed >= 0.0:
        raise ParameterError(f"speed must be 0 or more (x real time), got {speed}")
    bag = Bag(path)
    names = [bag.resolve(t) for t in topics] if topics else list(bag.topics)
    renamed = _renamed(bag, remap)
    order = Order(bag, names, cut.start, cut.end)
    rclpy.init(args=[])
    try:
        with Keys() as keys:
            player = _Player(bag, names, renamed, Pace(speed, pause, keys))
            try:
                sent = player.play(order, loop)
            finally:
                player.close()
        text = f"{sent} messages of {len(names)} topics replayed from {bag.path}"
        console.print(text if not player.pace.over else f"{text}, then stopped")
    except (KeyboardInterrupt, ExternalShutdownException):
        return 130
    finally:
        rclpy.try_shutdown()
        uninstall_signal_handlers()  # try_shutdown keeps them, and SIGTERM would have no effect
    return 0


def _renamed(bag: Bag, remap: Iterable[str]) -> dict[str, str]:
    names = {}
    for text in remap:
        old, arrow, new = text.partition(":=")
        if not (old and arrow and new):
            raise ParameterError(f"--remap wants FROM:=TO, e.g. joint_states:=/old, got {text!r}")
        names[bag.resolve(old)] = new
    return names


class _Player:
    """Publishers of the topics, and a node that subscribes to `CONTROL`."""

    def __init__(self, bag: Bag, names: list[str], renamed: dict[str, str], pace: Pace):
        self.pace, self._bag = pace, bag
        self._node = sealed_node("replayer")
        self._node.create_subscription(String, CONTROL, self._on_control, 10)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._publish = {}
        for name in names:
            qos = _qos(bag, name).writer()
            kind = ros_class(bag.topics[name].type)
            publisher = self._node.create_publisher(kind, renamed.get(name, name), qos)
            self._publish[name] = publisher.publish

    def close(self) -> None:
        """Leave the graph immediately, since uncollected objects would remain visible in it."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _on_control(self, message: String) -> None:
        try:
            self.pace.command(message.data)
        except ParameterError as error:
            self._node.get_logger().warning(str(error))

    def _spin(self, seconds: float) -> None:
        """Handle incoming messages for at most this time [s]."""
        self._executor.spin_once(timeout_sec=seconds)
        if not rclpy.ok():
            raise KeyboardInterrupt

    def play(self, order: Order, loop: bool) -> int:
        """Publish all messages; returns their number."""
        sent, columns = 0, "{task.completed:6.1f}/{task.total:.1f} s"
        with bar(columns) as progress:
            task = progress.add_task(self._bag.path.stem, total=order.length)
            while True:
                self.pace.begin()
                for t, name, data in order:
                    if not self.pace.wait(t, self._spin):
                        return sent
                    self._publish[name](data)
                    sent += 1
                    if sent % 500 == 0:
                        progress.update(task, completed=t)
                        self._spin(0.0)
                if not (loop and order.count):
                    return sent


def _qos(bag: Bag, name: str) -> Qos:
    """Recorded QoS of a topic; that of loco's topic table if the bag has none."""
    row = TOPICS.get(name) or TOPICS.get(name.rsplit("/", 1)[-1])
    if row is not None:
        return row.qos
    try:
        profile = parse_yaml(bag.offered(name), bag.path)[0]
        latched = profile["durability"] in ("transient_local", 1)
        reliable = profile["reliability"] not in ("best_effort", 2)
    except (LocoError, TypeError, LookupError):
        return LATCHED if name.endswith("robot_description") else STATE
    if latched:
        return LATCHED_LOG if profile.get("depth", 1) != 1 else LATCHED
    return Qos(reliable, False, STATE.depth)


def main() -> None:
    """Entry point of ``ros2 run loco_bringup replayer BAG [--speed X] [--loop]``."""
    parser = argparse.ArgumentParser(prog="replayer", description="Publish a bag's topics again.")
    parser.add_argument("bag", type=Path)
    parser.add_argument(
        "--speed", type=float, default=1.0, help="x real time, 0 as fast as possible"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    arguments, _ = parser.parse_known_args()
    try:
        sys.exit(replay_bag(arguments.bag, arguments.speed, loop=arguments.loop))
    except LocoError as error:
        sys.stderr.write(f"replayer: {error}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
