# SPDX-License-Identifier: Apache-2.0
"""Commands `loco record` and `loco replay`."""

from __future__ import annotations

import argparse

from ..bag.writer import Limits
from ..record.record import record as record_topics
from ..record.replayer import Cut, replay_bag


def record(a: argparse.Namespace) -> int:
    """`loco record`: record topics to a bag."""
    limits = Limits(a.max_bag_size, a.max_bag_duration)
    return record_topics(a.topics, a.out, a.exclude, a.duration, a.stamps, a.messages, limits)


def replay(a: argparse.Namespace) -> int:
    """`loco replay`: publish a recorded bag."""
    return replay_bag(
        a.bag, a.speed, a.topics, Cut(a.start, a.end), a.loop, a.pause, tuple(a.remap)
    )
