# SPDX-License-Identifier: Apache-2.0
"""Faults of a topic: damage to its messages between the writer and the readers.

A fault turns each message into none, one or several. Faults of one topic are applied in the order
in which they are listed. A fault is specified by a text such as
``motion_command:drop:probability=0.1:start=2``.
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from .exceptions import NameUnknownError, ParameterError
from .params import Params, from_dict, parameter

FAULTS: dict[str, type[Fault]] = {}
EXAMPLE = "motion_command:drop:probability=0.1:start=2:stop=4"


class Body(Protocol):
    """Interface for the changes that a fault makes to the bytes of a message."""

    def with_numbers(self, data: bytes, source: bytes | None) -> bytes:
        """The message with the numbers of `source`, or with NaN if that is None."""

    def later(self, data: bytes, seconds: float) -> bytes:
        """The message with its stamp shifted by `seconds` [s], and its tick accordingly."""


@dataclass(frozen=True)
class Fault(Params):
    """Base class of faults; each kind overrides `hit`."""

    start: float = parameter(0.0, "start, simulated time", "s", 0.0)
    stop: float = parameter(np.inf, "end, simulated time", "s", 0.0)
    probability: float = parameter(1.0, "probability that a message is damaged", "-", 0.0, 1.0)
    seed: int = parameter(0, "seed of the random choice of messages", "-", 0)

    kind: ClassVar[str]
    needs: ClassVar[str] = ""  # contents that a message must have: numbers or a stamp

    def __init_subclass__(cls, kind: str, needs: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.kind, cls.needs = kind, needs
        FAULTS[kind] = cls

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """Messages to publish instead of a message that the fault damages."""
        raise NotImplementedError

    def passed(self, data: bytes, memory: Memory) -> list[bytes]:
        """Messages to publish for an undamaged one, also after `stop`: first those held back."""
        held, memory.held = memory.held, []
        return [*held, data]


@dataclass(frozen=True)
class Drop(Fault, kind="drop"):
    """Messages are lost."""

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """An empty list: the message is lost."""
        return []


@dataclass(frozen=True)
class Delay(Fault, kind="delay"):
    """Messages arrive late, in order."""

    messages: int = parameter(1, "delay in messages", "messages", 1, 1000)

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """The oldest held message, once as many are held as the delay is long."""
        memory.held.append(data)
        return [memory.held.pop(0)] if len(memory.held) > self.messages else []


@dataclass(frozen=True)
class Duplicate(Fault, kind="duplicate"):
    """Messages arrive more than once."""

    times: int = parameter(1, "number of repetitions", "-", 1, 100)

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """Several copies of the message."""
        return [data] * (1 + self.times)


@dataclass(frozen=True)
class Reorder(Fault, kind="reorder"):
    """Messages arrive in groups, the newest first."""

    messages: int = parameter(2, "size of a group", "messages", 2, 1000)

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """An empty list until a group is complete, then the group, newest first."""
        memory.held.append(data)
        if len(memory.held) < self.messages:
            return []
        held, memory.held = memory.held, []
        return held[::-1]


@dataclass(frozen=True)
class Nan(Fault, kind="nan", needs="numbers"):
    """All numbers of a message become NaN; stamp and tick are unchanged."""

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """The message with NaN for all its numbers."""
        return [memory.body.with_numbers(data, None)]


@dataclass(frozen=True)
class Freeze(Fault, kind="freeze"):
    """The first message of the fault is repeated, including its stamp."""

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """The repeated message."""
        memory.stored = data if memory.stored is None else memory.stored
        return [memory.stored]


@dataclass(frozen=True)
class ClockJump(Fault, kind="clock_jump", needs="stamp"):
    """Stamp and tick are shifted in time."""

    offset: float = parameter(0.2, "advance of the stamps; below 0: behind", "s", -1e6, 1e6)

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """The message with shifted stamp and tick."""
        return [memory.body.later(data, self.offset)]


@dataclass(frozen=True)
class Stuck(Fault, kind="stuck", needs="numbers"):
    """Numbers are frozen at their values when the fault began; stamp and tick advance."""

    def hit(self, data: bytes, memory: Memory) -> list[bytes]:
        """The message with the frozen numbers."""
        memory.stored = data if memory.stored is None else memory.stored
        return [memory.body.with_numbers(data, memory.stored)]


class Memory:
    """State of one active fault.

    Args:
        fault: The fault and its settings.
        topic: Name of the damaged topic.
        body: Reads and writes the messages of the topic.

    Attributes:
        held: Messages that are held back, oldest first.
        stored: Message that is repeated.
    """

    def __init__(self, fault: Fault, topic: str, body: Body):
        self._fault, self.body = fault, body
        key = zlib.crc32(f"{topic} {fault.kind} {fault.start:g}".encode())
        self._rng = np.random.default_rng([fault.seed, key])
        self.held: list[bytes] = []
        self.stored: bytes | None = None

    def feed(self, messages: list[bytes], t: float) -> list[bytes]:
        """Messages to publish for `messages`, written at simulated time t [s]."""
        fault = self._fault
        if t < fault.start - 1e-9 or (t >= fault.stop - 1e-9 and not self.held):
            return messages
        out: list[bytes] = []
        for data in messages:
            on = t < fault.stop - 1e-9 and self._rng.random() < fault.probability
            out += fault.hit(data, self) if on else fault.passed(data, self)
        return out


def parse(text: str) -> tuple[str, Fault]:
    """Topic and fault of ``TOPIC:KIND[:NAME=VALUE]…``.

    Raises:
        ParameterError: The text is not a fault, or a value is out of range.
        NameUnknownError: There is no such kind or value.
    """
    parts = text.split(":")
    if len(parts) < 2 or not all(parts):
        raise ParameterError(f"a fault is TOPIC:KIND[:NAME=VALUE], e.g. {EXAMPLE}; got {text!r}")
    topic, kind, *pairs = parts
    if kind not in FAULTS:
        raise NameUnknownError("fault", kind, FAULTS)
    values = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        try:
            values[key] = float(value)
        except ValueError:
            equals = ""
        if not equals:
            raise ParameterError(f"{pair!r} in fault {text!r} must be NAME=NUMBER, e.g. start=2")
    fault = from_dict(FAULTS[kind], values, f"fault {kind}")
    if fault.stop <= fault.start:
        raise ParameterError(
            f"fault {text!r} must stop after it starts, got stop {fault.stop:g} s, "
            f"start {fault.start:g} s"
        )
    return topic, fault


def to_text(topic: str, fault: Fault) -> str:
    """Text that `parse` reads, with the values that differ from the defaults."""
    values = [
        f":{f.name}={getattr(fault, f.name):.10g}"
        for f in dataclasses.fields(fault)
        if getattr(fault, f.name) != f.default
    ]
    return f"{topic}:{fault.kind}{''.join(values)}"


def check(specs: Sequence[str], topics: dict[str, set[str]]) -> list[tuple[str, Fault]]:
    """Topics and faults parsed from texts and checked against a graph.

    Args:
        specs: Faults as a user writes them, ``TOPIC:KIND:KEY=VALUE,...``.
        topics: Contents of each topic's messages that a fault may change: numbers, stamp.

    Raises:
        ParameterError: A text is no fault, or the messages of its topic lack what it changes.
        NameUnknownError: There is no such kind of fault, or the graph has no such topic.
    """
    faults = []
    for text in specs:
        topic, fault = parse(text)
        if topic not in topics:
            raise NameUnknownError("topic", topic, topics)
        if fault.needs and fault.needs not in topics[topic]:
            able = ", ".join(name for name, has in topics.items() if fault.needs in has)
            raise ParameterError(
                f"fault {fault.kind} changes {fault.needs}, and messages of {topic} have none; "
                f"possible: {able}"
            )
        faults.append((topic, fault))
    return faults
