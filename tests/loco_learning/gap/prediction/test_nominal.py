# SPDX-License-Identifier: Apache-2.0
"""Laws of the nominal values that are refitted."""

import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.gap.prediction import nominal
from loco_sim.robot import robot

ROBOT = robot.load("servo_pendulum")


def test_values_are_those_that_an_override_would_change():
    found = nominal.values(ROBOT, ("drives.pivot.kp", "masses.rod"))
    assert found == {"drives.pivot.kp": 6.2, "masses.rod": 0.5}
    changed = robot.load("servo_pendulum", {k: 1.5 * v for k, v in found.items()})
    again = nominal.values(changed, tuple(found))
    assert again == pytest.approx({k: 1.5 * v for k, v in found.items()})


def test_no_name_is_no_value():
    assert nominal.values(ROBOT, ("",)) == {}


@pytest.mark.parametrize(
    "name", ["wheels.x", "drives.knee.kp", "drives.pivot.taste", "masses.head"]
)
def test_unknown_names_are_refused(name):
    with pytest.raises(NameUnknownError):
        nominal.values(ROBOT, (name,))


def test_a_value_of_zero_has_no_logarithm():
    tuned = robot.load("servo_pendulum", {"drives.pivot.gear_damping": 0.0})
    with pytest.raises(ParameterError):
        nominal.values(tuned, ("drives.pivot.gear_damping",))
