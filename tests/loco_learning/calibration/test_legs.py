# SPDX-License-Identifier: Apache-2.0
"""HyQ is calibrated by its driven joints, bolted in the air."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration.mawe import LOSSES
from loco_learning.calibration.objective import Reference, replay
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import Commands, Recording
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description

LEGS = parameter_set("legs")
AIR = {"fixed_base": True, "height": 1.0}
TRUTH = {**LEGS.default, "damping_kfe": 8.0, "stiffness_hfe": 180.0}
QUICK = CalibrationParams(parameters="legs", skip=1.2)


@pytest.fixture(scope="module")
def recording():
    """All joints swing at 1 Hz about the standing pose."""
    robot = Model("hyq", AIR).make_robot()
    t = np.arange(1300) / 250.0
    command = robot.standing + 0.2 * np.sin(2.0 * np.pi * t)[:, None]
    done = replay(Model("hyq", {**AIR, **LEGS.overrides(TRUTH)}), Commands(t, command))
    return Recording("swing", t, command, done.q, robot.joints, robot.joints)


def test_the_defaults_are_those_of_hyq():
    plain, made = (Model("hyq", o).make_robot() for o in ({}, LEGS.overrides(LEGS.default)))
    assert made.drives == plain.drives
    assert LEGS.default["damping_haa"] == 0.1  # of the URDF


def test_hyq_takes_what_the_set_writes():
    values = LEGS.from_unit(np.linspace(0.2, 0.8, len(LEGS.names)))
    robot = Model("hyq", LEGS.overrides(values)).make_robot()
    for joint, drive in robot.drives.items():
        kind = joint.split("_")[1]
        assert drive.kp == pytest.approx(values[f"stiffness_{kind}"])
        assert Description(robot.urdf).damping(joint) == pytest.approx(values[f"damping_{kind}"])


def test_the_true_legs_are_ten_times_nearer_than_the_default(recording):
    reference = Reference(recording, Model("hyq", AIR), QUICK)
    right, wrong = (reference.evaluate(values) for values in (TRUTH, LEGS.default))
    assert reference.joints == list(Model("hyq").make_robot().joints)
    for name in LOSSES:
        assert right.error[name] < 0.1 * wrong.error[name]


def test_parameters_of_another_robot_are_refused_with_the_way_out(recording):
    reference = Reference(recording, Model("hyq", AIR), QUICK.replace(parameters="seven"))
    text = "parameters 'seven' do not fit robot 'hyq'.*choose others with --parameters: .*legs"
    with pytest.raises(ParameterError, match=text):
        reference.check()
