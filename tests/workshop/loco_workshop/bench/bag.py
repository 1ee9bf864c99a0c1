# SPDX-License-Identifier: Apache-2.0
"""`loco bench bag`: speed of reading and writing messages of constant layout."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_control.ros.messages.convert import Converter, blank
from loco_control.ros.messages.topics import topic
from loco_control.types import MotionCommand, RobotState, TrunkTorque

MESSAGES = 60_000
_OTHERS = 3_000  # number of messages for slow readers
_KINDS = {"robot_state": RobotState, "motion_command": MotionCommand, "trunk_torque": TrunkTorque}
_FIELD = {"robot_state": "q", "motion_command": "q", "trunk_torque": "tau"}


def bench_bag() -> list[dict[str, Any]]:
    """Messages per second of CPU time, from a compressed bag on disk to an array of joints."""
    with tempfile.TemporaryDirectory() as folder:
        long = write_bag(Path(folder) / "long", MESSAGES)
        short = write_bag(Path(folder) / "short", _OTHERS)
        Bag(short).records("robot_state")  # loads the compiled kernels
        readers: list[tuple[str, Path, int, Callable[[Path, str], np.ndarray]]] = [
            ("ours", long, MESSAGES, _ours),
            ("rosbags", short, _OTHERS, _rosbags),
            ("mcap-ros2-support", short, _OTHERS, _mcap_ros2),
        ]
        return [
            {"reader": name, **{t: _rate(read, path, t, n) for t in _KINDS}}
            for name, path, n, read in readers
        ]


def write_bag(folder: Path, count: int) -> Path:
    """Write a bag of control topics with numbers that are hardly compressible."""
    rng = np.random.default_rng(0)
    writer = BagWriter(folder)
    packs = {name: Converter(kind).pack for name, kind in _KINDS.items()}
    values = {name: blank(kind) for name, kind in _KINDS.items()}
    for name in _KINDS:
        writer.add_row("/" + name, topic(name))
    noise = rng.normal(size=(256, 12))
    for tick in range(count):
        for name, value in values.items():
            value.tick, value.t = tick, tick / 250.0
            setattr(value, _FIELD[name], noise[tick % 256])
            writer.write("/" + name, packs[name](value), tick * 4_000_000)
    writer.close()
    return folder


def _rate(way: Callable[[Path, str], np.ndarray], path: Path, name: str, count: int) -> int:
    """Messages per second of CPU time (all threads), best of ten."""
    best = float("inf")
    for _ in range(10):
        began = time.process_time()
        values = way(path, name)
        best = min(best, time.process_time() - began)
        if values.shape != (count, 12):
            raise AssertionError(f"{way.__name__} read {values.shape} of {count} messages")
    return round(count / best)


def _ours(path: Path, name: str) -> np.ndarray:
    return np.ascontiguousarray(Bag(path).records(name)[_FIELD[name]])


def _rosbags(path: Path, name: str) -> np.ndarray:
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == "/" + name]
        read = (reader.deserialize(d, c.msgtype) for c, _, d in reader.messages(connections))
        return np.array([getattr(message, _FIELD[name]) for message in read])


def _mcap_ros2(path: Path, name: str) -> np.ndarray:
    with open(next(path.glob("*.mcap")), "rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        read = reader.iter_decoded_messages(topics=["/" + name])
        return np.array([getattr(message, _FIELD[name]) for _, _, _, message in read])
