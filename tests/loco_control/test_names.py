# SPDX-License-Identifier: Apache-2.0
"""Names and order of legs and joints."""

from loco_control.names import FEET, JOINT_KINDS, JOINTS, LEGS, foot_name, joint_name


def test_joints_are_leg_major_and_unique():
    assert len(set(JOINTS)) == 12 and len(set(FEET)) == 4
    for index, name in enumerate(JOINTS):
        assert name == joint_name(LEGS[index // 3], JOINT_KINDS[index % 3])


def test_names_are_those_of_the_hyq_description():
    assert JOINTS[0] == "lf_haa_joint" and JOINTS[-1] == "rh_kfe_joint"
    assert FEET == ("lf_foot", "rf_foot", "lh_foot", "rh_foot")
    assert foot_name("lf") == FEET[0]
