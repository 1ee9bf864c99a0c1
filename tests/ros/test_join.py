# SPDX-License-Identifier: Apache-2.0
"""Messages of one tick meet, and what is late, early, double or spoiled does no harm."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.ros.health import PeriodMeter
from loco_control.ros.join import TickJoin
from loco_control.ros.messages.convert import Converter
from loco_control.types import MotionCommand, TrunkTorque


def command(tick):
    return MotionCommand(tick, tick * 0.004, np.full(12, float(tick)), np.zeros(12))


def torque(tick):
    return TrunkTorque(tick, tick * 0.004, np.zeros(12), np.zeros(6), np.ones(4, bool))


@pytest.fixture
def joined():
    calls = []
    converters = {"a": Converter(MotionCommand), "b": Converter(TrunkTorque)}
    join = TickJoin(converters, lambda a, b: calls.append((a.tick, b.tick)), PeriodMeter())
    send_a, send_b = join.receiver("a"), join.receiver("b")
    return (
        join,
        calls,
        lambda tick: send_a(converters["a"].pack(command(tick))),
        lambda tick: send_b(converters["b"].pack(torque(tick))),
    )


def test_step_runs_once_when_all_have_the_tick_in_any_order(joined):
    join, calls, a, b = joined
    a(0), b(0), b(1), a(1)
    assert calls == [(0, 0), (1, 1)]


def test_duplicates_and_old_ticks_are_counted_and_not_answered(joined):
    join, calls, a, b = joined
    a(3), b(3), a(3), b(2)
    assert calls == [(3, 3)]
    assert join.stale == 2


def test_different_ticks_do_not_meet(joined):
    join, calls, a, b = joined
    a(1), b(2)
    assert calls == []
    a(2)
    assert calls == [(2, 2)]


def test_one_message_of_the_future_does_not_end_the_join(joined):
    join, calls, a, b = joined
    a(0), b(0), b(900), a(1), b(1)
    assert calls == [(0, 0), (1, 1)]


def test_a_message_that_came_before_its_tick_is_not_used_in_it(joined):
    join, calls, a, b = joined
    for tick in range(3):
        a(tick), b(tick)
    b(7), b(8)
    for tick in range(3, 7):
        a(tick), b(tick)
    a(7)
    assert calls[-1] == (6, 6)
    assert join.missing() == ["b"]
    b(8), a(8)  # one tick ahead: the other topic is slow
    assert calls[-1] == (8, 8)


@pytest.mark.parametrize("late", ["a", "b"])
def test_after_lost_ticks_a_topic_may_come_all_at_once_after_the_others(joined, late):
    """Between different writers there is no order: 40 ticks of one, then those of the other."""
    join, calls, a, b = joined
    for tick in range(3):
        a(tick), b(tick)
    senders = (b, a) if late == "a" else (a, b)
    for send in senders:
        for tick in range(3, 43):
            send(tick)
    assert calls[-1] == (42, 42)


def test_a_plant_takes_nothing_from_the_future():
    calls, refused = [], []
    join = TickJoin(
        {"a": Converter(MotionCommand)}, calls.append, PeriodMeter(),
        newest=lambda: 4, on_refusal=refused.append,
    )  # fmt: skip
    send, pack = join.receiver("a"), Converter(MotionCommand).pack
    for tick in (3, 5, 900, 4):
        send(pack(command(tick)))
    assert [c.tick for c in calls] == [3, 4]
    assert (join.stale, join.refused, refused) == (2, 0, [])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused_and_the_next_tick_counts(joined, number):
    join, calls, a, b = joined
    spoiled = command(0)
    spoiled.dq[7] = number
    join.receiver("a")(Converter(MotionCommand).pack(spoiled))
    b(0), a(1), b(1)
    assert calls == [(1, 1)]
    assert join.refused == 1


def test_a_clock_that_was_set_back_is_believed_a_late_message_is_not(joined):
    join, calls, a, b = joined
    for tick in (100, 101, 102):
        a(tick), b(tick)
    a(101), b(101)
    assert len(calls) == 3  # late
    a(5), b(5), a(6), b(6)
    assert calls[3:] == [(5, 5), (6, 6)]


class Number:
    """Reader of messages of two bytes: tick and a number, 255 is infinite, 254 raises."""

    def read(self, data):
        if data[1] == 254:
            raise self.error
        return data[1]

    def finite(self, data, value):
        return value < 255

    error: Exception = ValueError("no number")


class Pair:
    """A join of two such topics with a step that keeps ticks and does what `answer` does."""

    def __init__(self, answer=lambda: None, **options):
        self.calls, self.meter = [], PeriodMeter()
        self.readers = {"a": Number(), "b": Number()}
        self.join = TickJoin(self.readers, self.step, self.meter, lambda d: d[0], **options)
        self.answer = answer
        a, b = self.join.receiver("a"), self.join.receiver("b")
        self.send = {"a": a, "b": b}

    def step(self, a, b):
        self.answer()
        self.calls.append((a, b))

    def hear(self, *messages, number=None):
        """Messages such as "a3 b3", each with its tick as its number."""
        for name, *tick in " ".join(messages).split():
            tick = int("".join(tick))
            self.send[name](bytes([tick, tick if number is None else number]))
        return [a for a, _ in self.calls]


def both(*ticks):
    return " ".join(f"a{t} b{t}" for t in ticks)


@pytest.mark.parametrize("late", ["ab", "ba"])
def test_eight_messages_wait_for_a_late_topic_and_the_oldest_goes(late):
    early, last = late
    pair = Pair()
    assert pair.hear(*(f"{early}{t}" for t in range(9)), f"{last}0") == []
    assert pair.hear(f"{last}1") == [1]


@pytest.mark.parametrize("step", [1, 3])
def test_a_state_is_late_by_four_ticks_and_set_back_by_five(step):
    ticks = [100, 100 + step, 100 + 2 * step]
    pair, last = Pair(), ticks[-1]
    pair.hear(both(*ticks), both(last - 4 * step))
    assert len(pair.calls) == 3
    assert pair.join.stale == 2
    assert pair.hear(both(last - 5 * step))[3:] == [last - 5 * step]


def test_where_the_newest_tick_is_known_nothing_is_set_back_or_forgotten():
    pair = Pair(newest=lambda: 200)
    assert pair.hear(both(100, 101), "b105 b106 a105 a106") == [100, 101, 105, 106]
    pair.hear(both(5))
    assert pair.join.stale == 2
    assert len(pair.calls) == 4


def test_before_two_ticks_were_answered_nothing_is_known_of_the_clock():
    pair = Pair()
    assert pair.hear(both(100), both(5)) == [100]
    assert Pair().hear(both(0), "b3 b6 a3 a6") == [0, 3, 6]


def test_after_a_clock_was_set_back_nothing_of_before_is_used():
    pair = Pair()
    assert pair.hear(both(100, 101, 102), "a103", both(5), "b103")[3:] == [5]


def test_what_is_a_tick_ahead_waits_and_what_is_two_ahead_is_early():
    pair = Pair()
    assert pair.hear(both(0, 1), "b2 b3 a2 a3") == [0, 1, 2, 3]
    assert pair.join.stale == 0
    assert pair.hear("b6 b7 a6") == [0, 1, 2, 3]
    assert pair.join.stale == 1
    assert Pair().hear(both(0, 1), "b5 b6 a5") == [0, 1]  # two ticks are enough to know


def test_what_a_step_waits_for():
    pair = Pair()
    assert pair.join.missing() == ["a", "b"]
    assert pair.join.done + 1 == 0  # the tick that is next
    pair.hear("b1")
    assert pair.join.missing() == ["a"]
    pair.hear("a1")
    assert pair.join.missing() == ["a", "b"]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (ParameterError("joints differ"), "joints differ"),
        (KeyError(3), "b: 2 bytes cannot be read"),
    ],
)
def test_bytes_that_cannot_be_read_are_refused_in_words_and_may_come_again(error, text):
    told = []
    pair = Pair(on_refusal=told.append)
    pair.readers["b"].error = error
    pair.hear("a1")
    pair.hear("b1", number=254)
    assert (told, pair.join.refused, pair.calls) == ([text], 1, [])
    assert pair.hear(both(1)) == [1]


def test_without_anyone_to_tell_bytes_that_cannot_be_read_raise():
    pair = Pair()
    pair.hear("a1")
    with pytest.raises(ValueError, match="no number"):
        pair.hear("b1", number=254)


def test_a_number_that_is_not_finite_is_refused_without_a_word():
    told = []
    pair = Pair(on_refusal=told.append)
    pair.hear("a1")
    assert pair.hear("b1", number=255) == []
    assert (told, pair.join.refused) == ([""], 1)
    pair.hear(both(2, 3))
    assert pair.meter.summary()["ticks"] == 1  # periods between the two that were answered


def raising(error):
    def answer():
        raise error

    return answer


@pytest.mark.parametrize(
    ("error", "text"),
    [(ZeroDivisionError("by zero"), "by zero"), (OverflowError(), "OverflowError"),
     (np.linalg.LinAlgError("singular"), "singular")],
)  # fmt: skip
def test_a_controller_without_an_answer_refuses_the_tick(error, text):
    told = []
    pair = Pair(raising(error), on_refusal=told.append)
    pair.hear(both(4))
    assert (told, pair.join.refused) == ([f"no answer at tick 4: {text}"], 1)
    pair.answer = lambda: None
    assert pair.hear(both(5)) == [5]


@pytest.mark.parametrize("options", [{}, {"newest": lambda: 9, "on_refusal": print}])
def test_elsewhere_an_error_of_a_step_is_an_error(options):
    with pytest.raises(ZeroDivisionError):
        Pair(raising(ZeroDivisionError()), **options).hear(both(4))
