# SPDX-License-Identifier: Apache-2.0
"""Laws of the coordinates of hypotheses."""

import math

import pytest

from loco_sim.effects.coordinates import Coordinate, assemble

STRAIGHT = Coordinate("torque", 0.05, (1.0,), 0.0, 200.0, "N·m", strength=True)
CURVED = Coordinate("time", 0.1, (0.0,), 1e-3, 100.0, "s", logarithmic=True)


@pytest.mark.parametrize("c", [STRAIGHT, CURVED])
@pytest.mark.parametrize("x", [0.3, 1.0, 2.5])
def test_value_and_coordinate_are_inverse(c, x):
    assert c.inverse(c.value(x)) == pytest.approx(x)


def test_values_stay_in_their_bounds():
    assert STRAIGHT.value(-3.0) == 0.0
    assert CURVED.value(-100.0) == 1e-3
    assert CURVED.value(1e9) == 100.0
    assert STRAIGHT.clipped(-3.0) == 0.0


def test_one_unit_of_a_logarithm_is_a_factor_of_e():
    assert CURVED.value(1.0) / CURVED.value(0.0) == pytest.approx(math.e)


def test_vectors_are_put_together_from_their_axes():
    axes = [
        Coordinate("offset", 0.01, (1.0,), -1.0, 1.0, "m", True, False, direction)
        for direction in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    ]
    assert assemble([*axes, STRAIGHT], [2.0, -1.0, 1.0]) == {
        "offset": [0.02, 0.0, -0.01],
        "torque": 0.05,
    }
    assert [c.label for c in axes] == ["offset.x", "offset.z"]
