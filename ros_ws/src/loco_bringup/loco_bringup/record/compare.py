# SPDX-License-Identifier: Apache-2.0
"""Byte-wise comparison of recorded and live messages; differences are reported by field."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message

from loco_control.exceptions import LocoError
from loco_control.ros.messages.codec import Codec

MAX_DIFFERENCES = 20  # largest number of differences stored per topic


@dataclass(frozen=True)
class Difference:
    """A field of a live message that differs from the recorded one."""

    topic: str
    tick: int
    field: str  # path, with the index of an array element
    recorded: Any
    live: Any

    def __str__(self) -> str:
        return f"{self.topic}, tick {self.tick}, {self.field}: {self.recorded!r}, now {self.live!r}"


@dataclass
class Verdict:
    """Outcome of a comparison.

    Attributes:
        ticks: Number of ticks fed to the controllers.
        compared: Number of compared messages by topic.
        different: Number of differing messages by topic.
        first: The first differences, in order of tick and dataflow.
        trouble: Reason for an early end; empty if there was none.
    """

    ticks: int = 0
    compared: Counter[str] = field(default_factory=Counter)
    different: Counter[str] = field(default_factory=Counter)
    first: list[Difference] = field(default_factory=list)
    trouble: str = ""

    @property
    def identical(self) -> bool:
        """Whether every recorded message was reproduced without a difference."""
        return not self.trouble and not self.different and bool(self.compared)

    def to_dict(self) -> dict[str, Any]:
        """Outcome as a dictionary for JSON."""
        return {
            "identical": self.identical,
            "ticks": self.ticks,
            "compared": dict(self.compared),
            "different": dict(self.different),
            "first": [asdict(difference) for difference in self.first],
            "trouble": self.trouble,
        }


class Comparison:
    """Comparison of live answers with recorded ones.

    Args:
        kinds: Message class of each topic.
        tolerance: Largest difference at which two numbers count as equal; 0 requires equal bytes.
    """

    def __init__(self, types: dict[str, type], tolerance: float = 0.0):
        self.verdict = Verdict()
        self._types, self._tolerance = types, tolerance
        self._codecs: dict[str, Codec] = {}
        self._counts: Counter[str] = Counter()

    def add(self, topic: str, tick: int, recorded: bytes, live: bytes) -> None:
        """Compare one message of a tick."""
        verdict = self.verdict
        verdict.compared[topic] += 1
        if recorded[: len(live)] == live and not any(recorded[len(live) :]):
            return  # up to version 0.2 messages ended with unused zeros
        differences = self._differences(topic, tick, recorded, live)
        if not differences:
            return
        verdict.different[topic] += 1
        free = MAX_DIFFERENCES - self._counts[topic]
        verdict.first += differences[: max(free, 0)]
        self._counts[topic] += len(differences)

    def _differences(self, topic: str, tick: int, recorded: bytes, live: bytes) -> list[Difference]:
        try:
            codec = self._codec(topic, recorded)
            before, current = codec.decode(recorded), codec.decode(live)
        except LocoError:
            length = f"{len(recorded)} bytes", f"{len(live)} bytes"
            return [Difference(topic, tick, "length", *length)]
        differences = []
        for name in codec.dtype.names:
            a, b = np.atleast_1d(before[name]), np.atleast_1d(current[name])
            for i in np.flatnonzero(~self._equal(a, b)):
                path = f"{name}[{i}]" if before[name].ndim else name
                differences.append(Difference(topic, tick, path, a[i].item(), b[i].item()))
        if not differences and not self._tolerance:
            differences = [Difference(topic, tick, "texts", recorded.hex()[:64], live.hex()[:64])]
        return differences

    def _equal(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Mask of the elements with equal bytes or a difference within the tolerance."""
        bits = f"u{a.dtype.itemsize}"
        same = a.view(bits) == b.view(bits)
        if self._tolerance and a.dtype.kind == "f":
            same |= np.abs(a - b) <= self._tolerance
        return same

    def _codec(self, topic: str, data: bytes) -> Codec:
        if topic not in self._codecs:
            self._codecs[topic] = Codec(deserialize_message(data, self._types[topic]), len(data))
        return self._codecs[topic]
