# SPDX-License-Identifier: Apache-2.0
"""Collection of the messages of several topics that belong to one tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..exceptions import LocoError
from .health import PeriodMeter
from .messages.convert import TICK

_PENDING = 8  # messages of a topic that wait for those of other topics
_BACK = 4  # largest delay of a message [ticks]; a larger step back means that the clock was reset


def loco_tick(data: bytes) -> int:
    """Tick of a serialised message of `loco_msgs`."""
    return int.from_bytes(data[TICK], "little")


class TickJoin:
    """Collector of one message per topic, which calls `step` when all have the same tick.

    A tick is any increasing number: the tick itself, or the stamp. A message of a tick that was
    answered already, or of an older one, is stale: it is counted and not answered. A message that
    cannot be decoded or has numbers that are not finite is refused.

    Args:
        readers: Readers by topic: `read` decodes its bytes, ``finite(data, value)`` checks them.
        step: Function called with the decoded messages of a tick.
        meter: Meter of the tick period, marked at each step.
        tick_of: Function that extracts the tick from the bytes of a message.
        newest: Function, for plants, that returns the newest possible tick; messages of later
            ticks are stale. Without it, a first topic that goes back by more than `_BACK` ticks
            means that the plant's clock was reset. A message more than a tick ahead of the first
            topic waits, since the first topic may be late; if another message of its topic
            arrives before that tick, its clock was wrong and it is stale.
        on_refusal: Function called with the reason when a tick is refused: an error message, or ""
            for numbers that are not finite; without it an error is raised. If it is given without
            `newest`, by controllers, numbers for which `step` has no solution are refused, too.
    """

    def __init__(
        self,
        readers: dict[str, Any],
        step: Callable,
        meter: PeriodMeter,
        tick_of: Callable[[bytes], int] = loco_tick,
        newest: Callable[[], int] | None = None,
        on_refusal: Callable[[str], None] | None = None,
    ):
        self._readers, self._tick_of = readers, tick_of
        self._step, self._meter = step, meter
        self._newest, self._on_refusal = newest, on_refusal
        self._waiting: dict[str, dict[int, bytes]] = {name: {} for name in readers}  # by tick
        self._last_tick = -1  # tick of the message received last
        self._period = 0  # smallest difference between two ticks, 0: unknown
        self._has_begun = -1  # tick of the last message of the first topic
        self.done = -1  # newest tick answered
        self.stale = self.refused = 0

    def receiver(self, name: str) -> Callable[[bytes], None]:
        """Callback for the raw bytes of one topic."""
        tick_of, own_messages = self._tick_of, self._waiting[name]
        other_messages = self._waiting.values()
        first, count = own_messages is next(iter(other_messages)), len(self._readers)

        def receive(data: bytes) -> None:
            tick = tick_of(data)
            if first:
                self._has_begun = tick
            elif own_messages and self._newest is None:
                self._forget_early(own_messages)
            if tick <= self.done or (self._newest is not None and tick > self._newest()):
                self.stale += 1
                if not first or not self._set_back(tick):
                    return
            own_messages[tick], self._last_tick = data, tick
            matches = [messages[tick] for messages in other_messages if tick in messages]
            if len(matches) == count:
                self._answer(tick, matches)
            elif len(own_messages) > _PENDING:
                del own_messages[next(iter(own_messages))]

        return receive

    def _forget_early(self, own_messages: dict[int, bytes]) -> None:
        """Discard messages that are ahead of the first topic: their clock was wrong."""
        latest = self._has_begun + self._period
        for tick in [t for t in own_messages if self._period and t > latest]:
            del own_messages[tick]
            self.stale += 1

    def _set_back(self, tick: int) -> bool:
        """Whether `tick` means a reset of the clock, not a late message; if so, restart there."""
        has_period = self._period and self._newest is None
        if not has_period or tick >= self.done - _BACK * self._period:
            return False
        self.done = tick - self._period
        for messages in self._waiting.values():
            messages.clear()
        return True

    def missing(self) -> list[str]:
        """Topics whose message for the next step is missing."""
        return [name for name, messages in self._waiting.items() if self._last_tick not in messages]

    def _answer(self, tick: int, messages_of_tick: list[bytes]) -> None:
        readers = self._readers.values()
        values = []
        for name, data in zip(self._readers, messages_of_tick, strict=True):
            try:
                values.append(self._readers[name].read(data))
            except Exception as error:  # of loco, of rclpy, or any other caused by these bytes
                if self._on_refusal is None:
                    raise
                self.refused += 1
                for messages in self._waiting.values():
                    del messages[tick]  # a repeated message may be valid
                is_loco_error = isinstance(error, LocoError)
                self._on_refusal(
                    str(error) if is_loco_error else f"{name}: {len(data)} bytes cannot be read"
                )
                return
        if self.done >= 0:
            self._period = min(self._period or tick, tick - self.done)
        self.done = tick
        for messages in self._waiting.values():
            for old in [t for t in messages if t <= tick]:
                del messages[old]
        checked = zip(readers, messages_of_tick, values, strict=True)
        if not all(reader.finite(data, value) for reader, data, value in checked):
            self.refused += 1
            if self._on_refusal is not None:
                self._on_refusal("")
            return
        self._meter.mark()
        if self._newest is not None or self._on_refusal is None:
            self._step(*values)
            return
        try:
            self._step(*values)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            self.refused += 1
            self._on_refusal(f"no answer at tick {tick}: {str(error) or type(error).__name__}")
