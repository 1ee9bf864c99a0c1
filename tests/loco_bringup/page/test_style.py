# SPDX-License-Identifier: Apache-2.0
"""What the figures show is what the signals say."""

import numpy as np
import pytest

from loco_bringup.page.html import number
from loco_bringup.page.style import COMMAND, MEASURED, OTHER, TARGET, flag_spans
from loco_bringup.report.figures import drivers, posed
from loco_bringup.report.parts import label
from loco_learning.runs.rollout import rollout

DT = 0.004


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_flag_spans_are_the_flags(share):
    flag = np.random.default_rng(1).random(500) < share
    t = np.arange(500) * DT
    again = np.zeros(500, dtype=bool)
    for start, length in flag_spans(t, flag, DT):
        first = round(start / DT)
        again[first : first + round(length / DT)] = True
    np.testing.assert_array_equal(again, flag)


def test_who_drives_is_read_from_the_commands(short):
    log = rollout(short)
    by_target, by_readout = drivers(log)
    np.testing.assert_array_equal(by_readout, log.driving)
    np.testing.assert_array_equal(by_target, ~log.driving)


def test_a_tick_without_ground_truth_gets_the_pose_before(short):
    log = rollout(short).cut(slice(0, 20))
    whole = log.position.copy()
    log.position[[0, 7, 8]] = np.nan
    position = posed(log).position
    np.testing.assert_array_equal(position[[0, 7, 8]], whole[[1, 6, 6]])
    np.testing.assert_array_equal(np.delete(position, [0, 7, 8], 0), np.delete(whole, [0, 7, 8], 0))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.25, "−0.25"),
        (1234.56, "1235"),
        (2.5e-7, "2.5e−7"),
        (float("nan"), "–"),
        (float("inf"), "∞"),
    ],
)
def test_numbers_are_short(value, text):
    assert number(value) == text


def test_metric_names_become_words():
    assert label("cost_of_transport") == "Cost of transport"
    assert label("nrmse") == "NRMSE"
    assert label("grf_max") == "GRF max"


def test_colours_differ_in_brightness_too():
    """Readers who see no colours still tell target, command and measured apart."""

    def brightness(color):
        red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    levels = sorted(brightness(s) for s in (TARGET, COMMAND, MEASURED))
    assert min(np.diff(levels)) > 40
    assert len({TARGET, COMMAND, MEASURED, OTHER}) == 4
