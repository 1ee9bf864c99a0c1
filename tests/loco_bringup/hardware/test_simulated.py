# SPDX-License-Identifier: Apache-2.0
"""Faults of a simulated bus, as the command line names them."""

import pytest

from loco_bringup.hardware.simulated import Failing
from loco_control.exceptions import ParameterError


class Bus:
    """What a fault changes."""

    lost = garbled = 0.0

    def __init__(self):
        self.silent, self.hot = [], []
        self.silence, self.overheat = self.silent.append, self.hot.append


def test_faults_happen_when_they_are_due():
    failing, bus = Failing(["lost=0.1", "garbled=0.2@3", "silent=1@2", "hot=2"]), Bus()
    failing.apply(bus, 0.0)
    assert (bus.lost, bus.garbled, bus.silent, bus.hot) == (0.1, 0.0, [], [2])
    failing.apply(bus, 2.5)
    assert (bus.garbled, bus.silent) == (0.0, [1])
    failing.apply(bus, 3.0)
    failing.apply(bus, 4.0)
    assert (bus.garbled, bus.silent, bus.hot) == (0.2, [1], [2])


@pytest.mark.parametrize(
    "text",
    ["", "lost", "lost=2", "lost=-0.1", "lost=nan", "silent=1.5", "hot=1@-1", "cold=1", "hot=inf"],
)
def test_other_words_are_no_fault(text):
    with pytest.raises(ParameterError, match="--fault must be"):
        Failing([text])


def test_a_servo_that_is_not_there_cannot_fail():
    with pytest.raises(ParameterError, match="hot=9: the bus has the servos 1, 2"):
        Failing(["lost=0.1", "hot=9"]).check(Bus(), [1, 2])
