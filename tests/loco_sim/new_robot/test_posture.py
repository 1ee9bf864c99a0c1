# SPDX-License-Identifier: Apache-2.0
"""How far a point is inside of what a robot stands on."""

import numpy as np
import pytest

from loco_sim.new_robot.posture import inside

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


@pytest.mark.parametrize(
    ("point", "margin"),
    [((1.0, 1.0), 1.0), ((0.5, 1.0), 0.5), ((2.0, 1.0), 0.0), ((2.5, 1.0), -0.5),
     ((1.0, -3.0), -3.0)],
)  # fmt: skip
def test_the_margin_is_the_way_to_the_nearest_side(point, margin):
    assert inside(SQUARE, np.array(point)) == pytest.approx(margin)


def test_a_foot_in_the_middle_and_the_order_of_feet_change_nothing():
    more = np.vstack([SQUARE[::-1], [[1.0, 1.0]]])
    assert inside(more, np.array([0.5, 1.2])) == pytest.approx(0.5)


@pytest.mark.parametrize("turn", [0.3, 1.0])
def test_margins_turn_with_the_feet(turn):
    way = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    at = np.array([0.3, 1.1])
    assert inside(SQUARE @ way.T, way @ at) == pytest.approx(inside(SQUARE, at))


@pytest.mark.parametrize(
    "feet", [SQUARE[:1], SQUARE[:2], np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])]
)
def test_on_two_feet_or_a_line_nobody_stands(feet):
    assert inside(feet, np.array([0.0, 3.0])) < 0.0
    assert inside(feet, feet[0]) == 0.0
