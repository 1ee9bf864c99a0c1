# SPDX-License-Identifier: Apache-2.0
"""Laws of the nominal values that are refitted."""

import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.gap.prediction import nominal
from loco_learning.gap.prediction.nominal import nominal_value
from loco_sim.plant.model import Model
from loco_sim.robot import robot
from loco_sim.robot.description import Description

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


@pytest.mark.parametrize(("name", "speeds"), [("linear_axis", 0), ("servo_pendulum", 1)])
def test_every_moved_link_and_every_drive_is_in_doubt_once(name, speeds):
    there = Model(name).make_robot()
    names = [key for change in nominal.priors(there) for key in change]
    assert len(names) == len(set(names))
    assert sum(key.startswith("bodies.") for key in names) == 2 * len(there.joints)
    assert sum(key.endswith("no_load_speed") for key in names) == speeds
    assert not nominal.priors(there, ("bodies.*", "drives.*"))


@pytest.mark.parametrize("index", [0, -1])
def test_a_change_is_a_robot_that_can_be_built_and_differs(index):
    there = Model("servo_pendulum").make_robot()
    change = {
        name: nominal_value(there, name) + spread
        for name, spread in nominal.priors(there)[index].items()
    }
    moved = Model("servo_pendulum", change).make_robot()
    assert nominal.split_drives(change) == (change, [])
    if index == 0:
        ratio = Description(moved.urdf).mass() / Description(there.urdf).mass()
        assert 1.0 < ratio <= 1.0 + nominal.MASS + 1e-9
    else:
        assert moved.drives != there.drives


def test_a_drive_without_a_gear_is_weak_beyond_its_limit_as_well():
    (group,) = [g for g in nominal.priors(Model("linear_axis").make_robot()) if "slide" in str(g)]
    name = f"{nominal.CONSTANT}.slide"
    assert group == {name: nominal.DRIVE}
    assert nominal_value(None, name) == 0.0
    overrides, effects = nominal.split_drives({name: -0.01, "bodies.carriage.mass": 1.01})
    assert overrides == {"bodies.carriage.mass": 1.01}
    assert effects == [{"name": nominal.CONSTANT, "joint": "slide", "error": -0.01}]
    said = nominal.written(Model("linear_axis").make_robot(), {name: -0.01})
    assert said == pytest.approx({"drives.slide.kp": 1980.0, "drives.slide.kd": 59.4})


def test_a_drive_that_is_off_comes_after_what_limits_it():
    drives = [{"name": nominal.CONSTANT, "joint": "slide", "error": -0.01}]
    limit, spring = {"name": "torque_limit"}, {"name": "added_stiffness"}
    assert nominal.built([], drives) == drives
    assert nominal.built([limit, spring], drives) == [limit, *drives, spring]
