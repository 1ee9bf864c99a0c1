# SPDX-License-Identifier: Apache-2.0
"""Parameter sets: bounds, scales, and where they are written in robot.yaml."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_learning.calibration import parameters
from loco_learning.calibration.parameters import SETS
from loco_sim.robot import robot as robots
from loco_sim.robot.description import Description
from loco_sim.robot.equipment import GRAVITY

EACH_SET = pytest.mark.parametrize("chosen", SETS.values(), ids=SETS)
EACH = pytest.mark.parametrize(
    "parameter", [p for s in SETS.values() for p in s.parameters], ids=lambda p: p.name
)


def test_the_sets_have_the_sizes_of_the_thesis_and_of_the_code():
    assert len(parameters.parameter_set("seven").names) == 7
    assert len(parameters.parameter_set("ten").names) == 10
    with pytest.raises(NameUnknownError, match="legs, seven, ten|seven, ten, legs"):
        parameters.parameter_set("eight")


@EACH
def test_the_default_lies_inside_the_bounds(parameter):
    assert parameter.low < parameter.default < parameter.high


def test_the_published_optimum_lies_inside_the_bounds_of_seven_and_outside_the_codes():
    def outside(name):
        rows = parameters.parameter_set(name).parameters
        return [p.name for p in rows if p.thesis and not p.low <= p.thesis <= p.high]

    assert outside("seven") == []
    assert outside("ten") == ["friction_hind"]


@EACH
@pytest.mark.parametrize("x", [0.0, 0.2, 0.5, 1.0])
def test_the_unit_scale_goes_there_and_back(parameter, x):
    value = parameter.from_unit(x)
    assert parameter.low <= value <= parameter.high
    assert parameter.to_unit(value) == pytest.approx(x, abs=1e-9)


@EACH
def test_the_scale_rises_and_is_held_at_the_bounds(parameter):
    values = [parameter.from_unit(x) for x in np.linspace(-0.5, 1.5, 21)]
    assert values == sorted(values)
    assert values[0] == pytest.approx(parameter.low)
    assert values[-1] == pytest.approx(parameter.high)


@EACH_SET
def test_vectors_and_values_by_name_are_the_same(chosen):
    x = np.linspace(0.1, 0.9, len(chosen.names))
    np.testing.assert_allclose(chosen.to_unit(chosen.from_unit(x)), x)


@pytest.mark.parametrize("name", ["seven", "ten"])
def test_tigrillo_takes_what_a_set_writes(name):
    chosen = parameters.parameter_set(name)
    values = chosen.from_unit(np.linspace(0.2, 0.8, len(chosen.names)))
    robot = robots.load("tigrillo", chosen.overrides(values))
    for end, leg in (("front", "lf"), ("hind", "rh")):
        knee, foot = robot.springs[f"{leg}_kfe_joint"], f"{leg}_foot"
        assert knee.stiffness == pytest.approx(values[f"stiffness_{end}"])
        assert robot.friction[foot] == pytest.approx(values[f"friction_{end}"])
        share = Description(robot.urdf).mass() / len(robot.feet) * GRAVITY
        assert share / robot.contact[foot][0] == pytest.approx(values[f"depth_{end}"])
        if f"stop_{end}" in values:
            assert knee.stop == pytest.approx(values[f"stop_{end}"])


def test_the_mass_share_moves_mass_and_keeps_the_total():
    seven = parameters.parameter_set("seven")
    for share in (0.5, 0.7):
        made = seven.overrides({**seven.default, "mass_share": share})
        front, hind = (made[name] for name in parameters.MASSES)
        assert front + hind == pytest.approx(parameters.TOTAL)
        assert front / (front + hind) == pytest.approx(share)
