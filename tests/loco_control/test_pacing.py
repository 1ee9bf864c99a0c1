# SPDX-License-Identifier: Apache-2.0
"""Deadlines do not drift, a stall costs what it must and no more, lateness is told rightly."""

import numpy as np
import pytest

from loco_control.pacing import Deadlines, Lateness


class Clock:
    """Time that the test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def test_ticks_are_due_at_the_start_and_periods_after_whatever_happens_between():
    clock = Clock()
    ticks = Deadlines(250.0, 25, clock)
    rng = np.random.default_rng(0)
    done = 0
    for _ in range(1000):
        clock.now = max(clock.now, ticks.next) + 0.003 * rng.random()  # always late
        done += ticks.due()
        assert ticks.next == pytest.approx(100.0 + (done + 1) / 250.0, abs=1e-9)
        assert ticks.next > clock.now
    assert ticks.dropped == 0


def test_nothing_is_due_before_its_time():
    clock = Clock()
    ticks = Deadlines(250.0, 25, clock)
    clock.now = 100.0 + 0.9 / 250.0
    assert ticks.due() == 0
    clock.now = 100.0 + 1.001 / 250.0
    assert ticks.due() == 1
    assert ticks.due() == 0


def test_a_stall_is_made_up_at_once_and_counted():
    clock = Clock()
    ticks = Deadlines(250.0, 25, clock)
    clock.now = 100.0 + 10.5 / 250.0
    assert ticks.due() == 10
    assert ticks.missed == 9  # the tenth began within its period
    assert ticks.dropped == 0
    assert ticks.lateness.maximum == pytest.approx(9.5 / 250.0)
    assert ticks.due() == 0


def test_after_a_long_stall_the_rest_is_dropped_and_the_ticks_go_on_in_step():
    clock = Clock()
    ticks = Deadlines(250.0, 25, clock)
    clock.now = 100.0 + 100.5 / 250.0
    assert ticks.due() == 25
    assert ticks.dropped == 75
    assert ticks.missed == 99
    assert ticks.due() == 0
    assert ticks.next == pytest.approx(100.0 + 101 / 250.0)  # of those the 26th


def test_quantiles_are_those_of_the_samples_to_the_width_of_a_bin():
    rng = np.random.default_rng(1)
    late, samples = Lateness(), rng.lognormal(np.log(1e-4), 1.0, 5000)
    for value in samples:
        late.add(value)
    for share in (0.5, 0.99):
        assert late.quantile(share) == pytest.approx(np.quantile(samples, share), rel=0.03)
    assert late.maximum == samples.max()
    assert late.quantile(1.0) == late.maximum


def test_lateness_without_ticks_and_beyond_the_bins():
    late = Lateness()
    assert late.quantile(0.99) == 0.0
    late.add(0.0)
    late.add(1e9)
    assert late.quantile(1.0) <= late.maximum == 1e9


def test_the_report_is_in_milliseconds():
    clock = Clock()
    ticks = Deadlines(100.0, 5, clock)
    clock.now += 0.012
    ticks.due()
    report = ticks.report()
    assert report["lateness_max_ms"] == pytest.approx(2.0)
    assert report["missed_ticks"] == report["dropped_ticks"] == 0
