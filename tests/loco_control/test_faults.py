# SPDX-License-Identifier: Apache-2.0
"""Faults: what they make of messages, and how they are said."""

import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.faults import FAULTS, Memory, check, parse, to_text


class Letters:
    """Messages like b"a1": a number and a stamp."""

    def with_numbers(self, data, source):
        return (b"n" if source is None else source[:1]) + data[1:]

    def later(self, data, seconds):
        return data[:1] + str(int(data[1:]) + round(seconds)).encode()


def through(text, count=6, chain=None):
    """What comes of messages a0, b1, … at 0 s, 1 s, …, at each of them."""
    memories = [Memory(parse(each)[1], "t", Letters()) for each in chain or [text]]
    out = []
    for t in range(count):
        messages = [b"abcdefgh"[t : t + 1] + str(t).encode()]
        for memory in memories:
            messages = memory.feed(messages, float(t))
        out.append(" ".join(m.decode() for m in messages))
    return out


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        ("drop", ["a0", "", "", "", "e4", "f5"]),
        ("delay", ["a0", "", "b1", "c2", "d3 e4", "f5"]),
        ("delay:messages=2", ["a0", "", "", "b1", "c2 d3 e4", "f5"]),
        ("duplicate", ["a0", "b1 b1", "c2 c2", "d3 d3", "e4", "f5"]),
        ("reorder", ["a0", "", "c2 b1", "", "d3 e4", "f5"]),
        ("nan", ["a0", "n1", "n2", "n3", "e4", "f5"]),
        ("freeze", ["a0", "b1", "b1", "b1", "e4", "f5"]),
        ("clock_jump:offset=5", ["a0", "b6", "c7", "d8", "e4", "f5"]),
        ("stuck", ["a0", "b1", "b2", "b3", "e4", "f5"]),
    ],
)
def test_a_fault_acts_from_start_to_stop(fault, expected):
    assert through(f"t:{fault}:start=1:stop=4") == expected
    assert {fault.partition(":")[0]} <= FAULTS.keys()


def test_faults_act_one_after_the_other():
    both = ["t:stuck:start=1:stop=3", "t:duplicate:start=2:stop=4"]
    assert through("", chain=both) == ["a0", "b1", "b2 b2", "d3 d3", "e4", "f5"]


@pytest.mark.parametrize("kind", sorted(FAULTS))
def test_probability_zero_is_no_fault_and_equal_seeds_give_equal_messages(kind):
    assert through(f"t:{kind}:probability=0") == through("t:drop:start=99")
    some = through(f"t:{kind}:probability=0.5:seed=3", 8)
    assert some == through(f"t:{kind}:probability=0.5:seed=3", 8)


def test_seeds_differ():
    runs = {tuple(through(f"t:drop:probability=0.5:seed={s}", 8)) for s in range(20)}
    assert len(runs) > 10


@pytest.mark.parametrize("kind", sorted(FAULTS))
def test_what_is_said_is_read_again(kind):
    topic, fault = parse(f"/tf:{kind}:start=1.5:stop=2.25:probability=0.125:seed=7")
    assert (topic, parse(to_text(topic, fault))) == ("/tf", (topic, fault))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint_command", "a fault is TOPIC:KIND"),
        ("joint_command:", "a fault is TOPIC:KIND"),
        ("joint_command:dorp", "did you mean 'drop'"),
        ("joint_command:drop:p=0.1", "no parameter in fault drop named 'p'.*probability"),
        ("joint_command:drop:start", "must be NAME=NUMBER"),
        ("joint_command:drop:start=soon", "must be NAME=NUMBER"),
        ("joint_command:drop:probability=2", r"must be in \[0, 1\] -, got 2.0"),
        ("joint_command:drop:start=3:stop=2", "must stop after it starts"),
        ("joint_command:delay:messages=1.5", "must be a whole number"),
        ("elbow:drop", "no topic named 'elbow'.*joint_command, text"),
        ("text:nan", "fault nan changes numbers, and messages of text have none; possible: joint_"),
        ("text:clock_jump", "messages of text have none; possible: joint_command"),
    ],
)
def test_a_mistake_is_one_clear_line(text, message):
    topics = {"joint_command": {"numbers", "stamp"}, "text": set()}
    with pytest.raises((ParameterError, NameUnknownError), match=message) as error:
        check([text], topics)
    assert "\n" not in str(error.value)
