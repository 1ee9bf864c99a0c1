# SPDX-License-Identifier: Apache-2.0
"""Drafts of mappings say what names and values say, with the reason, and are mappings."""

from pathlib import Path

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.drafting import text as texts
from loco_learning.gap.drafting import words
from loco_learning.gap.drafting.draft import of_table
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.importing import tables
from loco_learning.gap.recordings import mapping

T = np.arange(300) / 100.0
WAVE = 0.8 * np.sin(3.0 * T)


def drafted(names, joints=(), time=T, wave=WAVE):
    columns = {name: (time if i == 0 else wave) for i, name in enumerate(names)}
    text = of_table(tables.Table(Path("a.csv"), columns), Joints(joints))
    return text, mapping.loads(text)


@pytest.mark.parametrize(
    ("name", "role", "joint"),
    [
        ("knee_pos", "q", "knee"),
        ("cmd_knee", "command_position", "knee"),
        ("/joint_states/knee/velocity", "dq", "knee"),
        ("/joint_command/position[knee]", "command_position", "knee"),
        ("kneeTorque", "tau", "knee"),
        ("KneeVelDes", "command_velocity", "knee"),
        ("observation.state.knee.pos", "q", "knee"),
        ("action.knee.pos", "command_position", "knee"),
        ("motor_current_knee", "tau", "knee"),
        ("q_ref_knee", "command_position", "knee"),
        ("knee_temperature", "", "knee"),
        ("battery", "", ""),
        ("knee ist [mm]", "q", "knee"),
        ("knee actual [deg/s]", "dq", "knee"),
        ("KneeLength(mm)", "q", "knee"),
        ("knee_meas_Nm", "tau", "knee"),
        ("knee soll [Nm]", "command_torque", "knee"),
        ("knee soll [mm]", "command_position", "knee"),
        ("Istgeschwindigkeit knee", "dq", "knee"),
        ("kneeQdes", "command_position", "knee"),
        ("taucmd_knee", "command_torque", "knee"),
        ("iq_ref_knee", "command_torque", "knee"),
        ("knee error [mm]", "", "knee"),
        ("knee_temp_meas", "", "knee"),
        ("knee_tqAct", "tau", "knee"),
        ("kneeActVelo", "dq", "knee"),
        ("knee_rpm", "dq", "knee"),
        ("dps knee", "dq", "knee"),
        ("knee_Nm", "tau", "knee"),
        ("knee_diff_pos", "", "knee"),
        *(
            (name, "", "knee")
            for name in (
                "target_qdd_knee",
                "ddq_knee",
                "knee_acceleration",
                "knee_alpha_rad_s2",
                "knee theta [rad/s²]",
                "knee_vel_rad/s^2",
                "knee q [m/s/s]",
            )
        ),
        *(
            (name, "", "")
            for name in (
                "actual_TCP_pose_0",
                "target_TCP_speed_1",
                "ee_pos_x",
                "eef_force",
                "cartesian velocity",
            )
        ),
    ],
)
def test_words_of_a_name_say_role_and_joint(name, role, joint):
    said = words.guess(name, ("hip", "knee"))
    assert (said.role, said.joint) == (role, joint)
    if role:
        free = words.guess(name)
        assert free.role == role and free.joint == "knee"


@pytest.mark.parametrize(
    ("name", "role", "joint"),
    [
        ("hip.p", "q", "hip"), ("knee_v", "dq", "knee"), ("hip.p_des", "command_position", "hip"),
        ("v_des_knee", "command_velocity", "knee"), ("hip.t_ff", "command_torque", "hip"),
        ("knee_tau_ff", "command_torque", "knee"), ("knee_vel_ff", "command_velocity", "knee"),
        ("hip.kp", "", "hip"), ("knee V", "", "knee"), ("v_bat", "", ""),
        ("knee_p_gain", "", "knee"),
    ],
)  # fmt: skip
def test_the_letters_of_a_drive_that_takes_positions_gains_and_torques(name, role, joint):
    said = words.guess(name, ("hip", "knee"))
    assert (said.role, said.joint) == (role, joint)


@pytest.mark.parametrize(
    ("name", "role", "joint"),
    [
        ("Sollgeschw. [°/s]", "command_velocity", "blade"), ("Blattwinkel [°]", "q", "blade"),
        ("kneepos", "q", "knee"), ("targetvel_knee", "command_velocity", "knee"),
        ("motorcurrent knee", "tau", "knee"), ("Sollwinkel Knie", "command_position", "Knie"),
        ("payload", "", ""), ("position", "q", "blade"),
        ("knee_i_cmd_A", "command_torque", "knee"), ("knee_i_ref", "command_torque", "knee"),
        ("knee_cmd_A", "command_torque", "knee"), ("knee_i", "", "knee"), ("i", "", "blade"),
    ],
)  # fmt: skip
def test_words_that_are_written_together(name, role, joint):
    said = words.guess(name, (joint or "knee",))
    assert said.role == role and said.joint == (joint if joint in ("knee", "Knie") else "")


def test_names_of_a_robot_arm_that_call_what_is_desired_d():
    """Also where the column without the letter is not logged."""
    names = ["t", "tau_J_d[0]", "tau_J_d[1]", "q[0]", "q[1]"]
    _, rules = drafted(names, ("fr3_joint1", "fr3_joint2"))
    assert [(c.role, c.place) for c in rules.columns] == [
        (role, joint) for role in ("command_torque", "q") for joint in ("fr3_joint1", "fr3_joint2")
    ]
    assert words.guess("shaft_d_pos", ("knee",)).role == "q"  # an unknown word beside it


def test_letters_and_numbers_are_the_joints_in_their_order():
    _, rules = drafted(["t", "p_des1", "p_des2", "p1", "p2", "v1", "v2"], ("hip", "knee"))
    assert [(c.role, c.place) for c in rules.columns] == [
        (role, joint) for role in ("command_position", "q", "dq") for joint in ("hip", "knee")
    ]


def test_ts_is_a_time():
    assert words.time_unit("ts") == words.time_unit("time") == ""


def test_the_longest_name_of_a_joint_is_its():
    assert words.joint_in("left_knee_pos", ("knee", "left_knee")) == "left_knee"
    assert words.joint_in("joint_12_pos", ("joint_1", "joint_12")) == "joint_12"
    assert words.joint_in("kneecap_pos", ("knee",)) == ""


@pytest.mark.parametrize(
    ("name", "joint"),
    [
        ("hip_pos", "left_hip_flexion"), ("knee angle [deg]", "left_knee_flexion"),
        ("left_pos", ""), ("flexion_pos", ""), ("x_enc", "x_axis"), ("pan.pos", "pan_joint"),
        ("pan_tilt_pos", ""),
    ],
)  # fmt: skip
def test_a_word_of_one_joint_alone_names_it(name, joint):
    joints = ("left_hip_flexion", "left_knee_flexion", "x_axis", "pan_joint", "tilt_joint")
    assert words.joint_in(name, joints) == joint


def test_measured_without_a_quantity_is_the_position_where_there_is_no_other():
    names = ["t", "pan_meas", "pan_ref", "tilt[deg]", "tilt_ref"]
    text, rules = drafted(names, ("pan_joint", "tilt_joint"))
    assert [(c.role, c.place, c.unit) for c in rules.columns if c.role == "q"] == [
        ("q", "pan_joint", ""), ("q", "tilt_joint", "deg")
    ]  # fmt: skip
    _, rules = drafted(["t", "pan_meas", "pan_pos", "pan_ref"], ("pan_joint", "tilt_joint"))
    assert [c.column for c in rules.columns] == ["pan_pos", "pan_ref"]


def test_names_of_links_go_by_the_order_of_the_joints_and_say_so():
    names = ["t", "cart_pos_mm", "pole_angle_deg", "cart_setpoint_mm"]
    text, rules = drafted(names, ("rail", "hinge"))
    assert [(c.role, c.place) for c in rules.columns] == [
        ("q", "rail"), ("q", "hinge"), ("command_position", "rail")
    ]  # fmt: skip
    assert text.count("in this order?") == 3
    with pytest.raises(ParameterError, match="no joint of the robot"):
        drafted([*names, "wagon_pos"], ("rail", "hinge"))


def test_the_column_that_names_the_only_joint_is_its():
    text, rules = drafted(["t", "current", "knee_angle", "knee_torque", "motor_angle"], ["knee"])
    assert {c.column: c.role for c in rules.columns} == {
        "knee_angle": "q", "knee_torque": "command_torque"
    }  # fmt: skip
    assert "left out; or a command? {column: current" in text


def test_feedback_is_measured_and_a_joint_may_be_named_like_an_angle():
    _, rules = drafted(["t", "pos_cmd", "pos_fbk"], ["knee"])
    assert [c.role for c in rules.columns] == ["command_position", "q"]
    assert words.guess("theta", ["theta"]).role == "q"


def test_columns_without_names_are_asked_for_by_their_numbers():
    with pytest.raises(ParameterError, match="no line of names above its 3 columns; add one, or"):
        drafted(["1", "2", "3"], ["knee"])


@pytest.mark.parametrize(
    ("name", "step", "unit"),
    [("t", 0.01, "s"), ("time_ms", 10.0, "ms"), ("timestamp", 1e7, "ns"), ("stamp", 1e4, "us"),
     ("t", 10.0, "ms"), ("__time", 0.01, "s"), ("time (millisec)", 10.0, "ms"),
     ("micros", 1e4, "us")],
)  # fmt: skip
def test_the_time_and_its_unit_are_told_by_name_and_step(name, step, unit):
    text, rules = drafted([name, "knee_pos", "knee_cmd"], time=step * np.arange(300))
    assert rules.time == name and f"unit: {unit}}}" in text and "100 Hz" in text


def test_without_a_time_the_rate_is_asked_for():
    text, rules = drafted(["knee_pos", "knee_cmd", "x"], time=WAVE)
    assert "no column of times" in text and "Not used: x" in text
    assert not rules.time_rate and not rules.time


@pytest.mark.parametrize(
    ("speed", "endless", "unit"),
    [
        (10.0, {"wheel": 30.0}, ""),  # a wheel that turns far is in rad: it was read as degrees
        (10.0, {}, "deg"),  # a joint with limits is not
        (60.0, {"wheel": 30.0}, "deg"),  # nor one that would be too fast
    ],
)
def test_a_wheel_that_turns_far_is_in_rad_if_it_can_be_as_fast(speed, endless, unit):
    columns = {"t_ms": 1e3 * T, "wheel_pos": speed * T, "wheel_cmd": speed * T}
    text = of_table(tables.Table(Path("a.csv"), columns), Joints(("wheel",), endless=endless))
    assert {c.unit for c in mapping.loads(text).columns} == {unit}


def test_units_are_told_by_name_or_size_and_said():
    text, rules = drafted(["t", "knee_pos_deg", "knee_cmd"], wave=60.0 * WAVE)
    assert [c.unit for c in rules.columns] == ["deg", "deg"]
    assert "deg by its name" in text and "deg, as it reaches 48" in text
    text, rules = drafted(["t", "knee_pos", "knee_cmd", "knee_current"])
    assert rules.columns[2].unit == "A" and "N·m per A, from the data sheet" in text


def test_turns_are_no_degrees_where_the_velocity_can_tell():
    _, rules = drafted(["t", "knee_pos", "knee_vel"], wave=20.0 * WAVE)
    assert [c.unit for c in rules.columns] == ["", ""]


@pytest.mark.parametrize(
    ("joints", "names", "expected"),
    [
        (("a_joint", "b_joint"), ["q1", "q2", "tau1", "tau2"], ["a_joint", "b_joint"]),
        (("a_joint", "b_joint"), ["q_0", "q_1", "q_cmd_0", "q_cmd_1"], ["a_joint", "b_joint"]),
        (("joint_2", "joint_1"), ["q1", "q2", "qd1_des", "qd2_des"], ["joint_1", "joint_2"]),
        (("lwr_joint1", "lwr_joint2"), ["q0", "q1", "dq0", "dq1"], ["lwr_joint1", "lwr_joint2"]),
        (("finger1", "arm2", "arm1", "finger2", "arm3"), ["q3", "q2", "tau3", "tau2"], ["arm3", "arm2"]),
        (("hip", "knee"), ["pos.2", "pos.3"], []),  # not counted from 0 or 1
        (("hip", "knee"), ["imu_q1", "imu_q2"], []),  # of something else
        (("hip", "knee"), ["q1_2", "q2_2"], []),
    ],
)  # fmt: skip
def test_numbers_in_names_are_those_of_joints_or_their_order(joints, names, expected):
    table = tables.Table(Path("a.csv"), {"t": T, **dict.fromkeys(names, WAVE)})
    if not expected:
        with pytest.raises(
            ParameterError, match=r"no joint of the robot \(hip, knee\) is named in: "
        ):
            of_table(table, Joints(joints))
        return
    rules = mapping.loads(of_table(table, Joints(joints)))
    assert [c.place for c in rules.columns] == 2 * expected


Q, GOAL = (
    np.stack([WAVE, 0.5 * np.cos(2.0 * T)]),
    np.stack([1.05 * WAVE, 0.5 * np.cos(2.0 * T + 0.1)]),
)
DQ = np.gradient(Q, 0.01, axis=1)
TORQUE = 60.0 * (GOAL - Q) - 2.0 * DQ
OF_LABS = {
    "odrive": ("axis{}.encoder.pos_estimate [turn]", "axis{}.controller.input_pos [turn]",
               "axis{}.encoder.vel_estimate [turn/s]", "axis{}.motor.current_control.Iq_measured [A]"),
    "servos": ("ID{} Present Position", "ID{} Goal Position", "ID{} Present Velocity",
               "ID{} Present Load"),
    "controller": ("/arm/controller_state/feedback/positions[{}]",
                   "/arm/controller_state/reference/positions[{}]",
                   "/arm/controller_state/feedback/velocities[{}]",
                   "/arm/controller_state/feedback/effort[{}]"),
    "dog": ("motorState[{}].q", "motorCmd[{}].q", "motorState[{}].dq", "motorState[{}].tauEst"),
    "axes": ("A{}_act", "A{}_cmd", "A{}_vel", "TrqA{}"),
    "arm": ("q[{}]", "q_d[{}]", "dq[{}]", "tau_J[{}]"),
    "greek": ("theta{}", "theta{}_d", "thetadot{}", "tau{}"),
    "letters": ("q{}", "qd{}", "dq{}", "tau{}"),
    "simulator": ("qpos_{}", "ctrl_{}", "qvel_{}", "torque_{}"),
    "model": ("out.q[{}]", "out.q_ref[{}]", "out.qd[{}]", "out.tau[{}]"),
}  # fmt: skip


@pytest.mark.parametrize("kind", OF_LABS)
def test_columns_as_laboratories_name_them(kind):
    columns = {"t": T}
    for template, values in zip(OF_LABS[kind], (Q, GOAL, DQ, TORQUE), strict=True):
        columns |= {template.format(i + 1): row for i, row in enumerate(values)}
    columns |= {f"motorCmd[{i + 1}].Kp": np.full(300, 60.0) for i in range(2)}
    text = of_table(tables.Table(Path("a.csv"), columns), Joints(("hip", "knee")))
    roles = {(c.role, c.place): c.column for c in mapping.loads(text).columns}
    assert roles == {
        (role, joint): template.format(i + 1)
        for role, template in zip(("q", "command_position", "dq", "tau"), OF_LABS[kind], strict=True)
        for i, joint in enumerate(("hip", "knee"))
    }  # fmt: skip


@pytest.mark.parametrize(("name", "other"), [("qd", "dq"), ("ctrl", "command_torque"),
                                             ("u", "command_torque")])  # fmt: skip
def test_a_name_with_two_meanings_has_that_of_its_values(name, other):
    for values, role in ((GOAL[0], "command_position"), (TORQUE[0], other), (DQ[0], other)):
        columns = {"t": T, "q": Q[0], name: values}
        text = of_table(tables.Table(Path("a.csv"), columns), Joints(("knee",)))
        assert mapping.loads(text).columns[1].role == role


def test_the_torque_of_a_controller_is_no_torque_beside_that_of_a_drive():
    def roles(torque, measured=None, follows=()):
        columns = {"t": T, "q": Q[0], "q_ref": GOAL[0], "tau_ref": torque}
        columns |= {} if measured is None else {"tau": measured}
        text = of_table(tables.Table(Path("a.csv"), columns), Joints(("knee",), follows))
        return {c.column: c.role for c in mapping.loads(text).columns}, text

    inverse = np.sin(1.7 * T)  # such as the torque that inverse dynamics of the goal needs
    for torque, measured in ((TORQUE[0], None), (inverse, 1.1 * inverse)):
        found, text = roles(torque, measured)
        assert found["tau_ref"] == "command_torque" and "q_ref" not in found
        assert "# Left out: q_ref; tau_ref is all that the motor is told?" in text
        assert "Not used" not in text
        found, _ = roles(torque, measured, ("knee",))
        assert found["q_ref"] == "command_position" and found.get("tau_ref", "tau") == "tau"
    for measured in (None, inverse + TORQUE[0]):
        found, _ = roles(inverse, measured)
        assert (found["q_ref"], found["tau_ref"]) == ("command_position", "command_torque")


def test_an_array_that_counts_from_0_is_in_the_order_of_joints_that_count_from_1():
    names = [f"/joint_states/joint{i}/position" for i in (1, 2)]
    names += [f"/command/data.{i}" for i in (0, 1)]
    text, rules = drafted(["t", *names], ("joint1", "joint2"))
    assert [(c.role, c.place) for c in rules.columns] == [
        (role, joint) for role in ("q", "command_position") for joint in ("joint1", "joint2")
    ]
    assert text.count("in this order?") == 2
    _, rules = drafted(["t", *names[:2], "torque_1"], ("joint1", "joint2"))
    assert [c.place for c in rules.columns] == ["joint1", "joint2", "joint1"]


def test_a_goal_beside_speeds_alone_is_a_speed():
    for names, roles in (
        (["rpm_hip", "rpm_knee", "target_hip", "target_knee"], ["dq", "command_velocity"]),
        (["hip", "knee", "rpm_hip", "rpm_knee", "goal_hip", "goal_knee"],
         ["q", "dq", "command_position"]),
        (["rpm_hip", "rpm_knee", "target_pos_hip", "target_pos_knee"], ["dq", "command_position"]),
    ):  # fmt: skip
        text, rules = drafted(["t", *names], ("hip", "knee"))
        assert [(c.role, c.place) for c in rules.columns] == [
            (role, joint) for role in roles for joint in ("hip", "knee")
        ]
        assert {c.unit for c in rules.columns if c.role == "command_velocity"} <= {"rpm"}


def test_columns_that_are_alike_have_one_meaning_in_all_joints():
    inverse = np.sin(1.7 * T)
    for totals in range(4):  # joints whose torque is surely that of a controller
        columns = {"t": T}
        for i in range(3):
            columns |= {f"q_{i}": Q[0], f"q_ref_{i}": GOAL[0]}
            columns[f"tau_ref_{i}"] = TORQUE[0] if i < totals else inverse
        text = of_table(tables.Table(Path("a.csv"), columns), Joints(("hip", "knee", "ankle")))
        roles = [c.role for c in mapping.loads(text).columns]
        assert roles.count("command_position") == (0 if totals > 1 else 3)
        assert roles.count("command_torque") == 3


def test_a_tool_beside_the_joints_is_none_of_them():
    names = [f"{n}_{i}" for n in ("actual_q", "target_q", "actual_TCP_pose", "target_TCP_pose",
                                  "target_qdd", "actual_TCP_force") for i in range(2)]  # fmt: skip
    text, rules = drafted(["t", *names], ("hip", "knee"))
    assert [c.column for c in rules.columns] == names[:4]
    assert f"# Not used: {', '.join(names[4:])}" in text


def test_a_torque_of_nan_alone_moved_nothing():
    columns = {"t": T, "knee_pos": WAVE, "knee_torque": np.full(len(T), np.nan)}
    text = of_table(tables.Table(Path("a.csv"), columns), Joints(("knee",)))
    assert [c.role for c in mapping.loads(text).columns] == ["q"]
    assert "# Missing: a command of knee; if nothing drove it: undriven: [knee]" in text


@pytest.mark.parametrize(("name", "step", "counts"), [("Timestamp", 1, True), ("t", 2, False),
                         ("time_ms", 1, False), ("Timestamp", 0.01, False)])  # fmt: skip
def test_a_time_may_count_rows(name, step, counts):
    text, _ = drafted([name, "knee_pos"], ("knee",), time=step * np.arange(300.0) + 1100)
    assert ("or a count of rows? Then say the rate" in text) == counts


def test_a_column_that_rises_evenly_is_the_time_where_no_name_is_one():
    for name, step, rate in (("x_value", 0.005, "200 Hz"), ("name", 5.0, "200 Hz")):
        text, rules = drafted([name, "knee_pos", "knee_cmd"], time=step * np.arange(300))
        assert rules.time == name and rate in text and "no name is a time: this?" in text
    for name, step in (("count", 0.005), ("x", 1.0), ("x", 1e-9)):
        text, _ = drafted([name, "knee_pos", "knee_cmd"], time=step * np.arange(300))
        assert "no column of times" in text


def test_where_a_command_is_missing_what_follows_the_position_is_told():
    columns = {"t": T, "q1": Q[0], "r1": GOAL[0], "x": np.cos(9.0 * T)}
    text = of_table(tables.Table(Path("a.csv"), columns), Joints(("knee",)))
    assert "# Missing: a command of knee; r1 follows its position: is it one?" in text


def test_numbered_columns_go_by_the_order_of_the_joints_and_say_so():
    names = ["time", *(f"{n}[{i}]" for n in ("dof_pos", "des_dof_pos") for i in range(2))]
    text, rules = drafted(names, ("hip", "knee"))
    assert [(c.role, c.place) for c in rules.columns] == [
        ("q", "hip"), ("q", "knee"), ("command_position", "hip"), ("command_position", "knee")
    ]  # fmt: skip
    assert text.count("in this order?") == 4 and "Missing" not in text


def test_what_lacks_and_what_is_there_twice_is_said():
    text, rules = drafted(["t", "knee_pos", "knee_angle", "knee_cmd"], ("hip", "knee"))
    assert len(rules.columns) == 2 and "Also q of knee, left out; or a command?" in text
    assert "Missing: q of hip" in text and "Missing: a command of hip" in text


def test_where_nothing_is_a_command_the_measured_torque_is_what_moved_the_joint():
    text, rules = drafted(["t", "knee_pos", "knee_torque"], ("knee",))
    assert [c.role for c in rules.columns] == ["q", "command_torque"]
    assert texts.MOVED in text and "Missing" not in text
    _, rules = drafted(["t", "knee_pos", "knee_torque", "knee_cmd"], ("knee",))
    assert [c.role for c in rules.columns] == ["q", "tau", "command_position"]


@pytest.mark.parametrize(
    ("follows", "place"), [(["hip"], ["hip"]), (["hip", "knee"], []), ([], [])]
)
def test_a_command_without_a_joint_is_of_the_only_one_that_is_driven(follows, place):
    columns = dict.fromkeys(("servo_goal", "hip_pos", "knee_pos"), WAVE)
    table = tables.Table(Path("a.csv"), {"t": T, **columns})
    rules = mapping.loads(of_table(table, Joints(("hip", "knee"), follows)))
    commands = [c.place for c in rules.columns if c.role == "command_position"]
    assert commands == place


@pytest.mark.parametrize("passive", [(), ("shoulder",)])
def test_a_joint_without_a_drive_lacks_no_command(passive):
    columns = dict.fromkeys(("shoulder_pos", "elbow_pos", "elbow_cmd"), WAVE)
    table = tables.Table(Path("a.csv"), {"t": T, **columns})
    text = of_table(table, Joints(("shoulder", "elbow"), ["elbow"], passive))
    assert ("# Missing: a command of shoulder" in text) != bool(passive)


def test_names_of_any_kind_come_back_whole():
    name = 'knee "left": pos # 1'
    text, rules = drafted(["t", name, "yes_cmd"], ("yes", "knee"))
    assert [c.column for c in rules.columns] == [name, "yes_cmd"]
    assert [c.place for c in rules.columns] == ["knee", "yes"] and text.startswith("# Drafted")


def test_a_table_that_says_nothing_is_one_line():
    with pytest.raises(ParameterError, match="a.csv: no name says what is .* it has a, b.*by hand"):
        drafted(["t", "a", "b"])


@pytest.mark.parametrize(
    ("name", "role", "unit"),
    [
        ("knee dq [rad/s]", "dq", "rad/s"),
        ("velocity.knee (deg/s)", "dq", "deg/s"),
        ("knee_vel_deg", "dq", "deg/s"),
        ("knee speed [rpm]", "dq", "rpm"),
        ("knee torque [mNm]", "tau", "mN m"),
        ("knee torque [Nmm]", "tau", "mN m"),
        ("knee_tau_Nm", "tau", "N m"),
        ("knee q [°]", "q", "deg"),
        ("knee_current [mA]", "tau", "mA"),
        ("knee_pos[0]", "q", ""),
        ("vel_knee_degps", "dq", "deg/s"),
        ("knee_vel_radps", "dq", "rad/s"),
        ("knee_pos_turns", "q", "rev"),
        ("knee_vel_turns", "dq", "rev/s"),
        ("knee_pos_rev_1", "q", "rev"),
        ("knee_pos [turn]", "q", "rev"),
        ("knee.vel_estimate [turn/s]", "dq", "rev/s"),
        ("knee_pos_deg[0]", "q", "deg"),
    ],
)
def test_a_unit_in_a_name_is_one_of_its_role(name, role, unit):
    said = words.guess(name, ("knee",))
    assert (said.role, said.unit, said.joint) == (role, unit, "knee")


@pytest.mark.parametrize(
    ("name", "role"),
    [("knee.SetPos [deg]", "command_position"), ("knee.ActPos", "q"), ("knee.ActTrq", "tau"),
     ("knee.set position", "command_position"), ("knee.actual torque", "tau"),
     ("knee_soll", "command_position"), ("u_knee", "command_torque"),
     ("input_knee", "command_torque"), ("knee_input_position", "command_position"),
     ("knee_input_voltage", ""), ("knee_set_temperature", "")],
)  # fmt: skip
def test_a_setpoint_is_no_measurement(name, role):
    assert words.guess(name, ("knee",)).role == role


@pytest.mark.parametrize("names", [["A1.pos", "A2.pos", "A1.set pos", "A2.set pos"],
                                   ["J1_meas", "J2_meas", "J1_ref", "J2_ref"],
                                   ["m1_q", "m2_q", "m1_u", "m2_u"]])  # fmt: skip
def test_a_letter_and_a_number_are_a_joint(names):
    names = [name.replace("meas", "pos_meas") for name in names]
    text, rules = drafted(["t", *names], ("hip", "knee"))
    assert [c.place for c in rules.columns] == ["hip", "knee", "hip", "knee"]
    assert "Missing" not in text


@pytest.mark.parametrize("names", [["knee_a_pos", "knee_b_pos"], ["knee_vor_pos", "knee_pos_ist"]])
def test_of_two_positions_none_is_the_same_again_and_no_torque_is_a_command(names):
    text, rules = drafted(["t", *names, "knee_torque"], ("knee",))
    assert [c.role for c in rules.columns] == ["q", "tau"] and "Missing: a command of knee" in text
    assert rules.columns[0].column == (names[1] if "ist" in names[1] else names[0])
    assert "Also q of knee, left out; or a command?" in text


def test_names_without_a_joint_of_the_robot_are_told():
    text, _ = drafted(["t", "knee_pos", "knee_cmd", "elbow_pos"], ("knee",) * 1 + ("hip",))
    assert "# No joint of the robot (knee, hip) is named in: elbow_pos" in text
    with pytest.raises(
        ParameterError, match=r"a.csv: no joint of the robot \(hip, knee\) is named in: a"
    ):
        drafted(["t", "arm_pos", "arm_cmd"], ("hip", "knee"))


def test_texts_of_a_table_are_named():
    cells = np.full(300, "", dtype=object)
    cells[[4, 9]] = "--"
    columns = {"t": T, "knee_pos": WAVE, "knee_cmd": WAVE}
    texts = {"mode": "it is 'idle'"}
    table = tables.Table(Path("a.csv"), columns, texts=texts, cell_texts={"knee_pos": cells})
    text = of_table(table, Joints(("knee",)))
    assert "# Not used: mode" in text and "“--” in 2 rows: no reading?" in text
    assert mapping.loads(text).columns[0].missing_texts == ("--",)


def test_a_time_by_its_content_is_in_seconds_and_one_that_rises_is_preferred():
    columns = {"time_ms": T, "t": np.floor(T), "knee_pos": WAVE}
    for clocks, name in (((), "time_ms"), (("time_ms",), "time_ms"), (("t",), "time_ms")):
        table = tables.Table(Path("a.csv"), columns, clocks=clocks)
        rules = mapping.loads(of_table(table, Joints(())))
        assert (rules.time, rules.time_unit) == (name, 1.0 if name in clocks else 1e-3)


def of(folder, text, joints):
    path = folder / "a.csv"
    path.write_text(text)
    return mapping.loads(of_table(tables.read(path), Joints(joints)))


@pytest.mark.parametrize("peak", [900.0, 4000.0])
def test_whole_numbers_beyond_degrees_are_counts_about_their_middle(peak):
    turn = 1024 if peak < 1000.0 else 4096
    wave = np.round(0.5 * turn + (peak - 0.5 * turn) * np.sin(3.0 * T))
    _, rules = drafted(["t", "knee_pos", "knee_vel"], ["knee"], wave=wave)
    angle = rules.columns[0]
    assert angle.unit == "count" and angle.gain == pytest.approx(2.0 * np.pi / turn)
    assert angle.gain * turn / 2.0 + angle.offset == pytest.approx(0.0)
    _, rules = drafted(["t", "knee_pos"], ["knee"], wave=np.round(180.0 * np.sin(3.0 * T)))
    assert rules.columns[0].unit == "deg"


def test_the_names_in_a_row_of_a_message_say_the_order_of_its_joints(tmp_path):
    head = "%time,field.name0,field.name1,field.position0,field.position1,field.effort0\n"
    rows = "".join(f"{10**7 * i},knee,hip,{i}.5,-{i}.5,0.0\n" for i in range(9))
    rules = of(tmp_path, head + rows, ["hip", "knee"])
    assert [(c.column, c.place) for c in rules.columns] == [
        ("field.position0", "knee"), ("field.position1", "hip")
    ]  # fmt: skip
    rules = of(tmp_path, head + rows, ["knee"])
    assert [c.place for c in rules.columns] == ["knee"]


def test_columns_that_are_only_called_as_joints_are_positions(tmp_path):
    rules = of(tmp_path, "timestamp,hip,knee\n0.0,1.0,2.0\n0.1,1.5,2.5\n0.2,1,2\n", ["hip", "knee"])
    assert [(c.role, c.place) for c in rules.columns] == [("q", "hip"), ("q", "knee")]


def test_a_row_for_each_joint_is_told(tmp_path):
    rows = "".join(f"{0.1 * i},{joint},{i}\n" for joint in ("hip", "knee") for i in range(9))
    with pytest.raises(
        ParameterError, match="joint names the joint of each row .hip, knee.; write"
    ):
        of(tmp_path, "t,joint,position\n" + rows, ["hip", "knee"])


def test_a_column_in_newton_metres_goes_before_one_in_ampere():
    _, rules = drafted(["t", "actual_q_0", "target_current_0", "target_moment_0"], ["knee"])
    assert [c.column for c in rules.columns] == ["actual_q_0", "target_moment_0"]
