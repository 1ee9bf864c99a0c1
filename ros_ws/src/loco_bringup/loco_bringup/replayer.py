# SPDX-License-Identifier: Apache-2.0
"""Node `replayer`: publishes the recorded bytes of a bag again, unchanged, in log order."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import rclpy
from mcap.reader import make_reader
from rclpy.executors import ExternalShutdownException

from loco_control.exceptions import LocoError, ParameterError
from loco_control.ros.topics import LATCHED, STATE, TOPICS, Qos

from .bag import Bag, message_class
from .console import bar, console


def replay_bag(path: Path, speed: float = 1.0, topics: list[str] | None = None) -> int:
    """Publish the messages of a bag at `speed` times the recorded (simulated) pace.

    Args:
        path: Bag folder or file.
        speed: Times real time; 0 publishes as fast as it goes.
        topics: Only these; all when None.

    Returns:
        0 at the end of the bag, 130 after Ctrl-C.

    Raises:
        ParameterError: `speed` is negative.
        NameUnknownError: The bag has no such topic.
    """
    if not speed >= 0.0:
        raise ParameterError(f"speed must be 0 or more (x real time), got {speed}")
    bag = Bag(path)
    names = [bag.resolve(t) for t in topics] if topics else list(bag.topics)
    rclpy.init(args=[])
    node = rclpy.create_node("replayer")
    try:
        publishers = {
            name: node.create_publisher(
                message_class(bag.topics[name].type), name, _qos(name).writer()
            )
            for name in names
        }
        sent = _publish(bag, publishers, speed)
        console.print(f"{sent} messages of {len(names)} topics replayed from {bag.path}")
    except (KeyboardInterrupt, ExternalShutdownException):
        return 130
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _publish(bag: Bag, publishers: dict, speed: float) -> int:
    began, sent = time.perf_counter(), 0
    columns = "{task.completed:6.1f}/{task.total:.1f} s"
    with bar(columns) as progress, open(bag.path, "rb") as stream:
        task = progress.add_task(bag.path.stem, total=bag.end - bag.start)
        for _, channel, message in make_reader(stream).iter_messages(topics=list(publishers)):
            t = message.log_time / 1e9 - bag.start
            if speed:
                time.sleep(max(0.0, began + t / speed - time.perf_counter()))
            publishers[channel.topic].publish(message.data)
            sent += 1
            if sent % 500 == 0:
                progress.update(task, completed=t)
                if not rclpy.ok():
                    raise KeyboardInterrupt
    return sent


def _qos(name: str) -> Qos:
    row = TOPICS.get(name) or TOPICS.get(name.rsplit("/", 1)[-1])
    if row is None:
        return LATCHED if name.endswith("robot_description") else STATE
    return row.qos


def main() -> None:
    """Entry point of ``ros2 run loco_bringup replayer BAG [--speed X]``."""
    parser = argparse.ArgumentParser(prog="replayer", description="Publish a bag's topics again.")
    parser.add_argument("bag", type=Path)
    parser.add_argument(
        "--speed", type=float, default=1.0, help="x real time, 0 as fast as possible"
    )
    arguments, _ = parser.parse_known_args()
    try:
        sys.exit(replay_bag(arguments.bag, arguments.speed))
    except LocoError as error:
        sys.stderr.write(f"replayer: {error}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
