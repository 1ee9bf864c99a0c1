# SPDX-License-Identifier: Apache-2.0
"""Mistakes of a set-up as users make them are found, with the joint; healthy data have none."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup import family, parts, signals, suspect
from loco_learning.gap.setup.bench import Bench
from loco_learning.gap.setup.limits import LIMITS

from .conftest import read
from .machines import MACHINES


def times(column, factor):
    """A column multiplied."""

    def change(data):
        data[column] = factor * data[column]

    return change


def swap(*pairs):
    """Columns given to each other."""

    def change(data):
        for a, b in pairs:
            data[a], data[b] = data[b], data[a]

    return change


def both(joint, factor):
    """Positions and commands of a joint multiplied."""

    def change(data):
        for what in ("q", "cmd"):
            data[f"{what}_{joint}"] = factor * data[f"{what}_{joint}"]

    return change


DEGREE = 180.0 / np.pi


def per_degree(name, *joints):
    """Drives of a machine, with gains per degree at some joints, or at all."""
    machine, made = MACHINES[name], {}
    for joint, kp, kd in zip(machine.joints, machine.kp, machine.kd, strict=True):
        by = 1.0 / DEGREE if joint in joints or not joints else 1.0
        made[joint] = {"kind": "impedance", "kp": by * kp, "kd": by * kd}
    return {"drives": made}


@pytest.mark.parametrize("name", MACHINES)
def test_nothing_is_found_in_healthy_data(judged, name):
    assert judged(name) == []


def drives(machine, *by):
    """Values of robot.yaml whose gains a draft guessed, so many times those of the machine."""
    machine = MACHINES[machine]
    rows = zip(machine.joints, machine.kp, machine.kd, by, strict=True)
    made = {j: {"kind": "impedance", "kp": b * kp, "kd": b * kd} for j, kp, kd, b in rows}
    return {"drives": made, "guessed": ["drives"]}


@pytest.mark.parametrize(
    ("name", "by"), [("arm", (0.05, 0.02)), ("geared", (0.1, 4.0)), ("lift", (0.1, 0.04))]
)
def test_gains_that_a_draft_guessed_are_fitted_and_no_mistake(judged, mended, name, by):
    (finding,) = judged(name, **drives(name, *by))
    assert finding.fault == "guessed gains" and not finding.stops
    assert finding.joints == MACHINES[name].joints and "guessed in robot.yaml" in finding.says
    model, records = mended([finding])
    assert (
        family.find_mistakes(model, records) == [] and Bench(model, records).miss() < LIMITS.missed
    )


@pytest.mark.parametrize(("name", "tilt"), [("geared", 0.08), ("arm", -0.08)])
def test_a_slope_is_what_the_model_lacks_of_a_bench_that_is_inclined_a_little(
    judged, tmp_path, name, tilt
):
    assert judged(name, about={"tilt": tilt}) == []
    model, records = read(tmp_path / "set")
    sloped = replace(model, effects=[{"name": "slope", "pitch": -tilt}])
    assert Bench(sloped, records).miss() < 0.3 * Bench(model, records).miss()


def effect(data):
    """A sensor's gain of 1.2 and a bias: what an effect may do."""
    data["q_elbow"] = 1.2 * data["q_elbow"] + 0.05


def late(data):
    for column in data:
        if column.startswith("cmd"):
            data[column] = np.roll(data[column], -8)


def moved(data):
    """A zero that moved: so much weight is lacking that gains per degree would explain some."""
    data["q_elbow"] = data["q_elbow"] + 0.5


@pytest.mark.parametrize("change", [effect, late, moved])
def test_what_an_effect_does_is_no_mistake_of_the_set_up(judged, change):
    assert judged("arm", change) == []


def roles(findings):
    """Roles and joints of the lines of the only finding, which has one way to mend it."""
    (finding,) = findings
    assert finding.mends and not finding.others
    return {(c.role, c.joint) for c in finding.mends}


@pytest.mark.parametrize("columns", [("q",), ("q", "tau"), ("cmd",), ("tau",), ("cmd", "tau")])
@pytest.mark.parametrize("joint", MACHINES["arm"].joints)
def test_measured_torques_tell_which_columns_of_a_joint_are_turned(judged, joint, columns):
    def change(data):
        for what in columns:
            data[f"{what}_{joint}"] = -data[f"{what}_{joint}"]

    said = {"cmd": "command_position"}
    found = judged("arm", change)
    lines = {(c.role, c.joint) for finding in found for c in finding.mends}
    assert lines == {(said.get(what, what), joint) for what in columns}
    assert not any(finding.others for finding in found)


@pytest.mark.parametrize("columns", [("q",), ("q", "tau"), ("cmd",)])
@pytest.mark.parametrize("name", ["arm", "geared"])
def test_measured_torques_tell_which_columns_are_exchanged(judged, name, columns):
    joints = MACHINES[name].joints
    change = swap(*(tuple(f"{what}_{joint}" for joint in joints) for what in columns))
    said = {"cmd": "command_position"}
    wanted = {(said.get(what, what), joint) for what in columns for joint in joints}
    assert roles(judged(name, change)) == wanted


@pytest.mark.parametrize(("name", "by"), [("arm", (0.5, 3.0)), ("lift", (2.0, 0.5))])
def test_guessed_gains_follow_from_the_measured_torque_with_their_error(judged, name, by):
    (finding,) = judged(name, **drives(name, *by))
    machine, found = MACHINES[name], {c.key: c.value for c in finding.mends}
    for joint, kp, kd in zip(machine.joints, machine.kp, machine.kd, strict=True):
        assert found[f"drives.{joint}.kp"] == pytest.approx(kp, rel=0.02)
        assert found[f"drives.{joint}.kd"] == pytest.approx(kd, rel=0.05)
    assert "±" in finding.says and "in robot.yaml" in str(finding)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mN m"), (100.0, "N cm"), (1e-3, "kN m")])
def test_a_torque_in_another_power_of_ten_gets_its_unit(judged, mended, factor, unit):
    (finding,) = judged("arm", times("tau_shoulder", factor))
    assert [(c.key, c.value, c.role) for c in finding.mends] == [("unit", unit, "tau")]
    assert family.find_mistakes(*mended([finding])) == []


DEGREE = 180.0 / np.pi
PLANTED = [
    ("arm", times("q_elbow", -1.0), {}, {"sign"}, ("elbow",)),
    ("arm", times("cmd_shoulder", -1.0), {}, {"sign"}, ("shoulder",)),
    ("lift", times("cmd_column", -1.0), {}, {"sign"}, ("column",)),
    ("pendulum", times("cmd_swing", -1.0), {}, {"sign"}, ("swing",)),
    ("arm", swap(("q_elbow", "q_shoulder")), {}, {"exchanged"}, ("shoulder", "elbow")),
    ("arm", swap(("cmd_elbow", "cmd_shoulder")), {}, {"exchanged"}, ("shoulder", "elbow")),
    ("arm", times("q_shoulder", 1.917), {}, {"scale"}, ("shoulder",)),
    ("arm", times("cmd_elbow", 1.0 / 2.5), {}, {"scale"}, ("elbow",)),
    ("lift", times("cmd_column", 1e3), {}, {"scale", "unit"}, ("column",)),
    ("lift", times("q_arm", DEGREE), {}, {"scale", "unit"}, ("arm",)),
    ("pendulum", times("q_swing", DEGREE), {}, {"unit"}, ("swing",)),
    ("arm", times("q_shoulder", DEGREE), {}, {"scale", "unit"}, ("shoulder",)),
]


def wrapped(column, period):
    """A column that jumps by a period about 0."""

    def change(data):
        data[column] = (data[column] + 0.5 * period) % period - 0.5 * period

    return change


def plus(column, offset):
    """A column with an offset."""

    def change(data):
        data[column] = data[column] + offset

    return change


SIGNALS = [
    ("arm", wrapped("q_elbow", 2.0 * np.pi / 3.0), {}, {"wrap"}, ("elbow",)),
    ("lift", wrapped("q_arm", np.pi / 2.0), {}, {"wrap"}, ("arm",)),
    ("arm", plus("q_shoulder", 2.0 * np.pi), {}, {"turns"}, ("shoulder",)),
    ("lift", plus("cmd_arm", -4.0 * np.pi), {}, {"turns"}, ("arm",)),
    ("lift", both("arm", DEGREE), {}, {"unit"}, ("arm",)),
    ("arm", times("q_elbow", 4096.0 / (2.0 * np.pi)), {}, {"scale"}, ("elbow",)),
]
BOTH = [
    ("arm", both("elbow", DEGREE), {}, {"joint scale", "unit"}, ("elbow",)),
    ("geared", both("shoulder", 0.4), {}, {"joint scale"}, ("shoulder",)),
    ("geared", both("elbow", 3.0), {}, {"joint scale"}, ("elbow",)),
    ("arm", both("elbow", -1.0), {}, {"axis"}, ("elbow",)),
    ("arm", None, per_degree("arm"), {"gains"}, ("shoulder", "elbow")),
    ("arm", None, per_degree("arm", "elbow"), {"gains"}, ("elbow",)),
    ("lift", None, per_degree("lift", "arm"), {"gains"}, ("arm",)),
    ("arm", None, {"masses": {"shoulder_link": 16.0, "elbow_link": 6.0}}, {"masses"}, ()),
    ("pendulum", None, {"masses": {"swing_link": 15.0}}, {"masses"}, ()),
    ("pendulum", times("cmd_swing", 1e3), {}, {"masses", "unit"}, ()),
    ("arm", None, {"about": {"carried": True}}, {"gravity carried"}, ()),
    ("arm", None, {"about": {"tilt": np.pi}}, {"gravity turned"}, ()),
    ("arm", None, {"about": {"tilt": 0.7}}, {"gravity turned"}, ()),
    ("stiff", None, {"about": {"tilt": -0.6}}, {"gravity turned"}, ()),
    ("arm", None, {"about": {"tilt": -0.2}}, {"gravity turned"}, ()),
    ("geared", None, {"about": {"tilt": 0.14}}, {"gravity turned"}, ()),
    ("stiff", None, {"masses": {"shoulder_link": 16.0, "elbow_link": 6.0}}, {"masses"}, ()),
    ("stiff", both("elbow", -1.0), {}, {"axis"}, ("elbow",)),
]


@pytest.mark.parametrize(("name", "change", "robot", "faults", "joints"), PLANTED + SIGNALS + BOTH)
def test_a_mistake_is_found_at_its_joint_and_its_lines_mend_it(
    judged, mended, recorded, tmp_path, name, change, robot, faults, joints
):
    findings = judged(name, change, **robot)
    assert len(findings) == 1 and findings[0].fault in faults, list(map(str, findings))
    assert set(joints) <= set(findings[0].joints) and findings[0].stops
    assert findings[0].fault != "gains" or joints == findings[0].joints
    assert findings[0].mends and "say " in str(findings[0])
    model, records = mended(findings)
    assert family.find_mistakes(model, records) == []
    assert Bench(model, records).miss() < 0.08  # dry friction is left, which the models lack
    if change and MACHINES[name].kp:  # else q and tau turned are the command turned
        machine = MACHINES[name].write(tmp_path / "clean", recorded(name))
        for clean, record in zip(read(machine)[1], records, strict=True):
            right, ours = ({**r.command, "q": r.signals["q"]} for r in (clean, record))
            for key, x in right.items():
                assert np.all(np.std(ours[key] - x, axis=0) < 0.05 * np.std(x, axis=0))


def test_a_command_of_the_other_sign_that_drives_the_model_into_a_stop_is_told(recorded, tmp_path):
    records = recorded("lift")
    for data in records:
        data["q_column"] = data["q_column"] + 0.5
        data["cmd_column"] = -(data["cmd_column"] + 0.5)
    urdf = MACHINES["lift"].write(tmp_path / "set", records) / "machine.urdf"
    text = urdf.read_text()
    urdf.write_text(text.replace('lower="-0.5" upper="0.5"', 'lower="0.1" upper="0.9"'))
    assert text != urdf.read_text()
    (finding,) = family.find_mistakes(*read(tmp_path / "set"))
    assert finding.fault == "sign" and finding.joints == ("column",)
    assert [(c.role, c.value) for c in finding.mends] == [("command_position", -1)]


def test_a_command_that_is_the_measured_position_is_told(judged):
    def change(data):
        data["cmd_elbow"] = np.concatenate([[data["q_elbow"][0]] * 3, data["q_elbow"][:-3]])
        data["cmd_shoulder"] = data["q_shoulder"]

    first, second = judged("arm", change)
    assert {first.fault, second.fault} == {"ahead"} and first.stops
    assert (first.joints, second.joints) == (("shoulder",), ("elbow",))
    assert "follows its command to 0.00%" in first.says
    assert "elbow is 15 ms ahead of its command" in second.says


@pytest.mark.parametrize("factor", [0.83, 1.3, 11.0])
def test_an_effort_that_is_a_current_is_told_and_taken_so(judged, mended, factor):
    (finding,) = judged("arm", times("tau_elbow", factor))
    assert finding.fault == "effort" and finding.joints == ("elbow",) and not finding.stops
    assert float(finding.mends[0].value) == pytest.approx(1.0 / factor, rel=0.03)
    assert family.find_mistakes(*mended([finding])) == []


@pytest.mark.parametrize("factor", [0.003, 0.2, 40.0])
def test_an_effort_of_another_size_is_told_where_gains_are_guessed(judged, factor):
    found = judged("arm", times("tau_elbow", factor), **drives("arm", 0.5, 3.0))
    (finding,) = (one for one in found if one.fault == "effort")
    assert finding.joints == ("elbow",) and not finding.stops
    assert float(finding.mends[0].value) == pytest.approx(1.0 / factor, rel=0.05)


@pytest.mark.parametrize("drawn", [{}, drives("arm", 0.5, 3.0)])
def test_an_effort_that_cannot_hold_the_weight_is_told(judged, drawn):
    """Its course is none of the motion, so that no scale is known."""
    noise = np.random.default_rng(0)

    def change(data):
        data["tau_shoulder"] = 1e-3 * noise.normal(size=len(data["tau_shoulder"]))

    found = judged("arm", change, **drawn)
    (finding,) = (one for one in found if one.fault == "effort")
    assert (finding.joints, finding.mends, finding.stops) == (("shoulder",), (), True)
    assert (
        "where inertia and weight need" in finding.says and "leave the column out" in finding.says
    )


@pytest.fixture
def swinging(recorded, tmp_path):
    """A model and a record of the arm."""
    model, records = read(MACHINES["arm"].write(tmp_path / "set", recorded("arm")))
    return model, records[0]


@pytest.mark.parametrize(
    ("factors", "clock"),
    [((2.0, 1.0), False), ((1.0, 0.5), False), ((2.0, 0.45), False), ((2.0, 2.0), True)],
)
def test_a_wrong_clock_is_offered_only_where_no_joint_refutes_it(swinging, factors, clock):
    model, record = swinging
    dq = np.gradient(record.signals["q"], record.dt, axis=0) * factors
    record = replace(record, signals={**record.signals, "dq": dq})
    found = list(suspect.findings(record, model.make_robot()))
    assert len(found) == sum(factor != 1.0 for factor in factors)
    for finding in found:
        assert ("time: {scale" in finding.says) is clock
        assert [c.key for c in finding.mends] == ([] if clock else ["scale"])


def test_speeds_and_places_of_a_slide_in_mm_get_their_line(recorded, tmp_path):
    model, (record, _) = read(MACHINES["lift"].write(tmp_path / "set", recorded("lift")))
    q = record.signals["q"]
    dq = np.gradient(q, record.dt, axis=0)
    for factors, roles in (((1.0, 1e3), ["dq"]), ((1e3, 1.0), ["q"])):
        scale = np.array([[a, 1.0] for a in factors])
        signals = {**record.signals, "q": q * scale[0], "dq": dq * scale[1]}
        (finding,) = suspect.findings(replace(record, signals=signals), model.make_robot())
        unit = "mm/s" if roles == ["dq"] else "mm"
        assert [(c.role, c.value) for c in finding.mends] == [(role, unit) for role in roles]


@pytest.mark.parametrize(
    ("fixed", "rate", "found"),
    [(True, 0.5, True), (True, 0.02, False), (False, 0.001, True), (False, 0.5, False)],
)
def test_a_base_that_is_bolted_moves_and_one_that_is_free_does_not(swinging, fixed, rate, found):
    model, record = swinging
    gyro = rate * np.sin(20.0 * record.t)[:, None] * np.ones(3)
    record = replace(record, signals={**record.signals, "gyro": gyro})
    robot = replace(model.make_robot(), fixed_base=fixed)
    (finding,) = list(signals.base(record, robot)) or [None]
    assert (finding is not None) is found
    if found:
        assert [(c.key, c.value) for c in finding.mends] == [("fixed_base", not fixed)]


def rates(scale):
    def change(data):
        for joint in ("shoulder", "elbow"):
            data[f"dq_{joint}"] = scale * np.gradient(data[f"q_{joint}"], data["t"])

    return change


def lacks_rates(data):
    """A driver that writes positions where velocities belong."""
    for joint in ("shoulder", "elbow"):
        data[f"dq_{joint}"] = 1.7 * data[f"q_{joint}"]


def test_a_velocity_that_is_a_position_is_told(judged):
    assert judged("arm", rates(1.0)) == []
    findings = judged("arm", lacks_rates)
    assert [f.joints for f in findings] == [("shoulder",), ("elbow",)]
    assert all("is not the derivative of q, but a multiple of q" in f.says for f in findings)


@pytest.mark.parametrize("by", [0.05, 0.2])
def test_a_scale_of_the_velocities_is_one_finding_for_all_recordings(judged, by):
    """The number differs a little between recordings, and so does that of the position command."""

    def change(data):
        rates(by)(data)
        data["cmd_elbow"] = 4.0 * data["cmd_elbow"]

    findings = judged("arm", change)
    scales = {c.joint: c.value for f in findings for c in f.mends if c.role == "dq"}
    assert scales == pytest.approx({"shoulder": 1.0 / by, "elbow": 1.0 / by}, rel=0.1)
    assert not any("run" in f.says for f in findings)


def changes(data):
    """Commands as changes of the position that is measured, or of that commanded before."""
    for joint in ("shoulder", "elbow"):
        data[f"cmd_{joint}"] = data[f"cmd_{joint}"] - data[f"q_{joint}"]


def increments(data):
    for joint in ("shoulder", "elbow"):
        data[f"cmd_{joint}"] = np.diff(data[f"cmd_{joint}"], prepend=0.0)


@pytest.mark.parametrize("change", [changes, increments])
def test_a_command_that_is_a_change_of_the_position_is_told(judged, change):
    (finding,) = [f for f in judged("arm", change) if f.stops]
    assert finding.fault == "relative" and set(finding.joints) <= {"shoulder", "elbow"}


@pytest.mark.parametrize(("scale", "posture"), [(0.25, 0.4), (0.1, -0.6)])
def test_an_action_about_a_posture_has_a_scale_and_an_offset(judged, mended, scale, posture):
    def change(data):
        data["cmd_elbow"] = (data["cmd_elbow"] - posture) / scale

    findings = judged("arm", change)
    (finding,) = findings
    values = {c.key: c.value for c in finding.mends}
    assert {c.role for c in finding.mends} == {"command_position"}
    assert values["scale"] == pytest.approx(scale, rel=0.15)
    assert values["offset"] == pytest.approx(posture, abs=0.1)


@pytest.mark.parametrize(("first", "last"), [(2.0, 2.7), (3.0, 4.0)])
def test_a_stretch_without_torques_is_told_and_not_taken_for_a_sign(judged, first, last):
    def change(data):
        rows = (data["t"] >= first) & (data["t"] < last)
        for joint, way in (("shoulder", -1.0), ("elbow", 1.0)):  # it falls and swings
            data[f"tau_{joint}"][rows] = 0.01
            data[f"q_{joint}"][rows] += way * 0.8 * np.sin(5.0 * (data["t"][rows] - first)) ** 2

    findings = judged("arm", change)
    assert {f.fault for f in findings} == {"part"} and len(findings) == 2  # one a recording
    for finding in findings:
        assert "the drives were off" in finding.says and "sign" not in finding.says
        told = [float(x) for x in re.findall(r"from ([\d.]+) to ([\d.]+) s", finding.says)[0]]
        assert told == pytest.approx([first, last], abs=0.06)


@pytest.mark.parametrize("lag", [0.05, 0.2])
def test_a_joint_that_coasts_along_a_ramp_has_a_drive(hinge, lag):
    """Its drive damps the velocity: the lag is largest where motion is fast, without a torque."""
    t = np.arange(4000) / 500.0
    speed = np.interp(t, [1.0, 1.5, 4.0, 4.5], [0.0, 1.0, 1.0, 0.0])
    speed = np.where((t > 1.0) & (t < 4.5), speed, 0.3 * np.sin(9.0 * t))
    q = np.cumsum(speed) / 500.0
    rng = np.random.default_rng(0)
    tau = 20.0 * np.gradient(speed, t) + 0.2 * rng.normal(size=len(t))
    command = q + lag * speed + 1e-3 * tau
    signals = {"q": q[:, None], "tau": tau[:, None]}
    record = Record("ramp", t, {"position": command[:, None]}, ("hinge",), signals, ("hinge",))
    model = SimpleNamespace(make_robot=lambda overrides: hinge)
    off = (t > 2.0) & (t < 3.5)
    drifting = command.copy()
    drifting[off] += 0.3 * np.sin(8.0 * t[off])
    adrift = replace(record, command={"position": drifting[:, None]})
    assert [len([*parts.changed(model, one)]) for one in (record, adrift)] == [0, 1]


@pytest.mark.parametrize(("unit", "grams"), [(1e6, False), (1e9, False), (1e9, True)])
def test_inertias_in_other_units_are_told_where_the_motion_agrees(tmp_path, recorded, unit, grams):
    machine = MACHINES["arm"]

    def other(match):
        key, value = match.groups()
        by = (1e3 if grams else 1.0) if key == "mass value" else unit
        return f'{key}="{by * float(value)}"'

    urdf = re.sub(r'(mass value|i[xyz]{2})="([^"]+)"', other, machine.urdf)
    folder = replace(machine, urdf=urdf).write(tmp_path / "set", recorded("arm"))
    (finding,) = family.find_mistakes(*read(folder))
    assert finding.fault == "inertias"
    assert f"in {'kg·mm²' if unit == 1e6 else 'g·mm²'}" in finding.says
    assert ("masses are in g" in finding.says) is grams
