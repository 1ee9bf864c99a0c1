# SPDX-License-Identifier: Apache-2.0
"""Held joints tell nothing; units have the dimension of their role; lines act together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.setup import bodies, family
from loco_learning.gap.setup.bench import Bench, Trial, moving
from loco_learning.gap.setup.finding import (
    JOINT,
    MAPPING,
    MODEL,
    OFFSET,
    SCALE,
    SIGN,
    Change,
    composed,
    unit_of,
)  # fmt: skip
from loco_learning.gap.setup.finding import (
    correct as corrected,
)

from .conftest import read
from .machines import MACHINES

DEGREE = 180.0 / np.pi


def found(folder, machine, change=None, **robot):
    """What is found in two recordings of a machine that are written to a folder."""
    records = [machine.record(seed) for seed in (1, 2)]
    for data in records:
        if change:
            change(data)
    return family.find_mistakes(*read(machine.write(folder, records, **robot)))


def stepped(data):
    """Angles of an encoder of 4096 counts a turn."""
    step = 2.0 * np.pi / 4096.0
    data["q_arm"] = step * np.round((data["q_arm"] + 0.3 * step) / step)


@pytest.mark.parametrize("change", [None, stepped])
def test_nothing_is_found_of_a_joint_that_is_held(tmp_path, change):
    assert found(tmp_path / "set", replace(MACHINES["lift"], size=(0.1, 0.0)), change) == []


@pytest.mark.parametrize(("speed", "moves"), [(0.0, False), (5.0, True)])
def test_a_joint_that_is_told_a_velocity_is_not_held(speed, moves):
    t = np.linspace(0.0, 20.0, 2000)[:, None]
    told = {"position": np.zeros_like(t), "velocity": speed * np.sin(t)}
    q = 40.0 + speed * (1.0 - np.cos(t)) + 0.1 * np.sin(7.0 * t)
    wheel = SimpleNamespace(command=told, signals={"q": q}, joints=("wheel",), driven=("wheel",))
    assert moving(wheel, ("wheel",)) == [moves]


def test_a_correction_of_a_joint_without_an_error_is_no_finding(tmp_path, recorded):
    bench = Bench(*read(MACHINES["arm"].write(tmp_path / "set", recorded("arm"))))
    joint = bench().joints[0]
    still = replace(bench(), moving=(np.zeros(len(bench().joints), dtype=bool),) * 2)
    change = Change(MAPPING, OFFSET, 2.0 * np.pi, "q", joint)
    bench._trials = dict.fromkeys((repr(()), repr((change,))), still)
    assert bench.settled("turns", (joint,), "", [(change,)]) == []


@pytest.mark.parametrize("joint", MACHINES["arm"].joints)
@pytest.mark.parametrize(("vanishes", "told"), [(True, False), (False, True)])
def test_no_scale_is_told_that_only_makes_a_coupling_vanish(
    recorded, tmp_path, monkeypatch, joint, vanishes, told
):
    model, records = read(MACHINES["arm"].write(tmp_path / "set", recorded("arm")))

    def misses(trial):  # the less, the smaller the motion, or the nearer it is to a seventh
        i = trial.joints.index(joint)
        size = np.std(trial.measured[0][:, i]) / np.std(records[0].signals["q"][:, i])
        return np.full(2, size if vanishes else min(0.3 * abs(np.log(7.0 * size)), 1.0))

    monkeypatch.setattr(Trial, "misses", misses)
    assert bodies.determined(Bench(model, records), (joint,), 7.0, False) is told


def with_speeds(data, factors=()):
    """Add velocities; multiply columns."""
    for column in [c for c in data if c.startswith("q_")]:
        data[f"d{column}"] = np.gradient(data[column], data["t"])
    for column, by in dict(factors).items():
        data[column] = by * data[column]


def everything(joints, by):
    return {f"{what}_{joint}": by for joint in joints for what in ("q", "dq", "cmd")}


@pytest.mark.parametrize(
    ("name", "factors", "lines"),
    [
        ("arm", {"q_elbow": -1.0}, {("sign", -1, "q", "elbow")}),
        ("lift", {"q_arm": -1.0}, {("sign", -1, "q", "arm")}),
        ("arm", {"cmd_elbow": -1.0}, {("sign", -1, "command_position", "elbow")}),
        ("lift", {"q_column": 1e3}, {("unit", "mm", "q", "column")}),
        ("lift", {"cmd_column": 1e3}, {("unit", "mm", "command_position", "column")}),
        ("lift", {"q_column": 1e3, "dq_column": 1e3, "cmd_column": 1e3},
         {("unit", "mm", "q", "column"), ("unit", "mm/s", "dq", "column"),
          ("unit", "mm", "command_position", "column")}),
        ("arm", everything(("shoulder", "elbow"), DEGREE),
         {("unit", "deg" + "/s" * (role == "dq"), role, joint)
          for joint in ("shoulder", "elbow") for role in ("q", "dq", "command_position")}),
    ],
)  # fmt: skip
def test_lines_of_all_findings_together_restore_the_signals(
    recorded, mended, tmp_path, name, factors, lines
):
    records = recorded(name)
    for data in records:
        with_speeds(data)
    clean = read(MACHINES[name].write(tmp_path / "clean", records))[1]
    for data in records:
        data |= {column: by * data[column] for column, by in factors.items()}
    findings = family.find_mistakes(*read(MACHINES[name].write(tmp_path / "set", records)))
    assert {(c.key, c.value, c.role, c.joint) for f in findings for c in f.mends} == lines
    model, ours = mended(findings)
    assert family.find_mistakes(model, ours) == []
    for right, record in zip(clean, ours, strict=True):
        for key in ("q", "dq"):
            np.testing.assert_allclose(record.signals[key], right.signals[key], atol=1e-4)
        np.testing.assert_allclose(record.command["position"], right.command["position"], atol=1e-5)


def line(key, value, joint="elbow", role="q"):
    return Change(MAPPING, key, value, role, joint)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ([line(SIGN, -1), line(SIGN, -1)], []),
        ([line(SCALE, 2.0), line(SCALE, 0.5)], []),
        ([line(SCALE, 2.0), line(SIGN, -1), line(SCALE, 2.0)], [line(SCALE, 4.0), line(SIGN, -1)]),
        ([line(SIGN, -1), line(OFFSET, 1.0), line(SIGN, -1)], None),
        ([line(SIGN, -1), line(JOINT, "shoulder"), line(SIGN, -1, "shoulder")], None),
        ([line(SIGN, -1), line(SIGN, -1, role="dq")], None),
        ([Change(MODEL, "a", 1.0), Change(MODEL, "a", 2.0)], [Change(MODEL, "a", 2.0)]),
    ],
)
def test_factors_of_a_column_are_multiplied_where_they_commute(before, after):
    assert composed(before) == (before if after is None else after)


def test_an_exchange_and_a_sign_after_it_act_in_their_order(recorded, mended, tmp_path):
    records = recorded("arm")
    clean = read(MACHINES["arm"].write(tmp_path / "clean", records))[1]
    for data in records:
        data["q_elbow"], data["q_shoulder"] = data["q_shoulder"], -data["q_elbow"]
    record = read(MACHINES["arm"].write(tmp_path / "set", records))[1][0]
    lines = [line(JOINT, "shoulder"), line(JOINT, "elbow", "shoulder"), line(SIGN, -1)]
    q = corrected(record, lines).signals["q"]
    np.testing.assert_allclose(q, clean[0].signals["q"], atol=1e-6)
    finding = family.Finding("", (), "", tuple(lines))
    np.testing.assert_allclose(mended([finding])[1][0].signals["q"], q, atol=1e-6)


@pytest.mark.parametrize("unit", ["deg", "mm", "rev"])
def test_the_unit_of_a_velocity_is_that_of_a_rate(unit):
    assert unit_of(unit, "dq") == unit_of(unit, "command_velocity") == f"{unit}/s"
    assert unit_of(unit, "q") == unit and unit_of("N m", "tau") == "N m"


def from_row(row, change):
    """A change of the rows of the second recording from some row on."""

    def of(data):
        later = {key: values.copy() for key, values in data.items()}
        change(later)
        for key in data:
            data[key] = np.concatenate([data[key][:row], later[key][row:]])

    return of


def times(column, by):
    def change(data):
        data[column] = by * data[column]

    return change


def stuck(data):
    data["q_elbow"][:] = data["q_elbow"][380]


def moved(data):
    data["q_arm"] += 0.7


PARTS = [
    ("arm", times("q_elbow", -1.0), "has the other sign"),
    ("lift", times("q_arm", -1.0), "has the other sign"),
    ("arm", times("q_shoulder", DEGREE), "times what it was"),
    ("lift", times("q_column", 1e3), "times what it was"),
    ("arm", stuck, "stands still"),
    ("lift", moved, "another zero"),
]


@pytest.mark.parametrize(("name", "change", "says"), PARTS)
def test_a_mistake_of_a_part_of_a_recording_is_told_with_its_row_and_without_a_line(
    recorded, tmp_path, name, change, says
):
    records = recorded(name)
    from_row(380, change)(records[1])
    (finding,) = family.find_mistakes(*read(MACHINES[name].write(tmp_path / "set", records)))
    assert finding.fault == "part" and says in finding.says and not finding.mends
    assert abs(int(finding.says.split("(row ")[1].split(")")[0]) - 380) <= 3
    assert finding.says.startswith("run1")


ONE = [
    ("arm", times("q_elbow", -1.0), "sign", ("elbow",)),
    ("lift", times("cmd_column", -1.0), "sign", ("column",)),
    ("arm", times("q_shoulder", 2.0), "scale", ("shoulder",)),
    ("lift", times("cmd_arm", 2.5), "scale", ("arm",)),
]


@pytest.mark.parametrize("which", [0, 2])
@pytest.mark.parametrize(("name", "change", "fault", "joints"), ONE)
def test_a_mistake_of_one_recording_is_told_for_it_alone(
    recorded, tmp_path, name, change, fault, joints, which
):
    records = recorded(name)
    records.append(MACHINES[name].record(3))
    change(records[which])
    (finding,) = family.find_mistakes(*read(MACHINES[name].write(tmp_path / "set", records)))
    assert (finding.fault, finding.joints, finding.mends) == (fault, joints, ())
    assert finding.says.startswith(f"run{which} alone: ") and finding.stops


@pytest.mark.parametrize(
    ("name", "joint", "period"), [("arm", "elbow", 1.0), ("lift", "arm", 2.0 * np.pi / 5.0)]
)
def test_a_command_that_wraps_with_its_joint_gets_the_same_period(
    recorded, mended, tmp_path, name, joint, period
):
    records = recorded(name)
    for data in records:
        for what in ("q", "cmd"):
            data[f"{what}_{joint}"] = (data[f"{what}_{joint}"] + 0.3 * period) % period
    (finding,) = family.find_mistakes(*read(MACHINES[name].write(tmp_path / "set", records)))
    lines = {(c.key, c.role, c.joint): c.value for c in finding.mends}
    assert set(lines) == {("wrap", role, joint) for role in ("q", "command_position")}
    assert all(value == pytest.approx(period, rel=0.03) for value in lines.values())


@pytest.mark.parametrize("rows", [15, 20])
@pytest.mark.parametrize("name", ["arm", "geared"])
def test_commands_that_are_late_by_one_time_are_one_finding(recorded, tmp_path, name, rows):
    records = recorded(name)
    for data in records:
        for joint in MACHINES[name].joints:
            column = data[f"cmd_{joint}"]
            data[f"cmd_{joint}"] = np.concatenate([np.full(rows, column[0]), column[:-rows]])
    findings = family.find_mistakes(*read(MACHINES[name].write(tmp_path / "set", records)))
    assert [(f.fault, set(f.joints)) for f in findings] == [("ahead", set(MACHINES[name].joints))]
