# SPDX-License-Identifier: Apache-2.0
"""Damping and feedback of a joint, told from its motion and torque alone."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.statistics.free import free

DT = 0.002
TIME = np.arange(0.0, 20.0, DT)


def motion(mass, damping, stiffness, times=TIME, unit=1.0):
    """A motion of two sines in an angle's unit, and the torque that makes it."""
    q, dq, ddq = (
        sum(
            size * w**k * np.sin(w * times + 0.5 * np.pi * k)
            for size, w in ((0.4, 2.0), (0.2, 5.3))
        )
        for k in range(3)
    )
    return unit * q, mass * ddq + damping * dq + stiffness * q, DT


@pytest.mark.parametrize(
    ("mass", "damping", "stiffness"),
    [(1.0, 2.0, 0.0), (1.0, 2.0, 5.0), (0.5, 0.0, 5.0), (1.0, 4.0, 3.0)],
)
def test_errors_decay_as_the_slowest_root_says(mass, damping, stiffness):
    decay = -np.max(np.roots([mass, damping, stiffness]).real)
    found = free([motion(mass, damping, stiffness)])
    assert found.decay == pytest.approx(decay, abs=0.2)


def test_a_torque_that_follows_the_velocity_is_fed_back_and_one_of_the_position_is_not():
    assert free([motion(0.0, 3.0, 0.0)]).fed_back == pytest.approx(1.0, abs=0.02)
    assert free([motion(1.0, 0.0, 4.0)]).fed_back < 0.1


def test_neither_unit_nor_order_of_records_matters():
    one, two = motion(1.0, 2.0, 5.0), motion(1.0, 2.0, 5.0, TIME + 7.3)
    first, turned = free([one, two]), free([two, one])
    degrees = free([(np.degrees(q), tau, dt) for q, tau, dt in (one, two)])
    for other in (turned, degrees):
        assert (other.fed_back, other.decay, other.time) == pytest.approx(
            (first.fed_back, first.decay, first.time)
        )


def test_the_shift_by_the_mean_torque_is_that_of_a_spring():
    q, torque, dt = motion(1.0, 2.0, 5.0)
    held = free([(q + 0.3, torque + 1.5, dt)])
    assert held.shift == pytest.approx(np.mean(torque + 1.5) / 5.0 / np.std(q), rel=0.1)
    assert free([(q, torque - np.mean(torque), dt)]).shift < 0.05


@pytest.mark.parametrize(("rows", "told"), [(20, False), (21, True)])
def test_no_more_rows_than_twice_the_unknowns_say_nothing(rows, told):
    """A third at either end is not used: 8 and 9 are left."""
    found = free([motion(0.2, 3.0, 1.0, TIME[:rows])])
    assert (found.fed_back != 0.0) is told
