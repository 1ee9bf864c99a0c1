# SPDX-License-Identifier: Apache-2.0
"""Messages of one tick meet, and what is late, early, double or spoiled does no harm."""

import numpy as np
import pytest

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
        newest=lambda: 4, refuse=refused.append,
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
