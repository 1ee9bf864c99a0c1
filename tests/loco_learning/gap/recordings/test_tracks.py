# SPDX-License-Identifier: Apache-2.0
"""Columns become signals in SI units."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.recordings import mapping, tracks

T = np.arange(6) * 0.01


class Columns:
    """A source that holds arrays."""

    name, header = "made", {}

    def __init__(self, **columns):
        self.columns, self.notes = columns, []

    def series(self, column):
        return T, np.array(self.columns[column.column], dtype=float)


@pytest.mark.parametrize(("scale", "told"), [(1.0, True), (0.38, False)])
def test_a_current_without_its_torque_constant_is_told(hinge, scale, told):
    entry = f"{{column: a, role: tau, joint: hinge, unit: mA, scale: {scale}}}"
    source = Columns(a=[0, 90, 180, 0, 0, 0])
    tracks.from_source(source, mapping.loads(f"columns: [{entry}]"), mapping.Rule(), hinge)
    assert told == any("tau of hinge is a current at 1 N·m per A" in n for n in source.notes)


def read(robot, entry, rule=mapping.Rule(), **columns):  # noqa: B008 (frozen)
    rules = mapping.loads(f"columns: [{entry}]")
    return tracks.from_source(Columns(**columns), rules, rule, robot)


def test_sign_scale_unit_and_offset(hinge):
    entry = "{column: a, role: q, joint: hinge, unit: deg, sign: -1, offset: pi}"
    (found,) = read(hinge, entry, a=[0, 90, 180, 0, 0, 0])
    assert np.allclose(found.x[:3], [np.pi, np.pi / 2, 0.0])
    assert (found.role, found.place) == ("q", "hinge")


def test_unsigned_numbers_get_their_sign_back(hinge):
    entry = "{column: a, role: tau, joint: hinge, unit: count, scale: 0.1, wrap: unsigned16}"
    (found,) = read(hinge, entry, a=[0, 3, 65535, 65533, 32767, 32768])
    assert np.allclose(found.x, [0.0, 0.3, -0.1, -0.3, 3276.7, -3276.8])


@pytest.mark.parametrize("values", [[0, 1, -1, 0, 0, 0], [0, 70000, 0, 0, 0, 0], [0.5] * 6])
def test_only_whole_numbers_without_sign_can_wrap(hinge, values):
    with pytest.raises(ParameterError, match="whole numbers from 0 to 65535"):
        read(hinge, "{column: a, role: q, joint: hinge, wrap: unsigned16}", a=values)


def test_numbers_that_look_unsigned_are_suspected(hinge):
    with pytest.raises(ParameterError, match="say wrap: unsigned16"):
        read(hinge, "{column: a, role: q, joint: hinge}", a=[0, 3, 65535, 65533, 1, 2])


def test_turns_are_undone(hinge):
    angle = np.linspace(0.0, 10.0, 6) % (2.0 * np.pi)
    (found,) = read(hinge, "{column: a, role: q, joint: hinge, wrap: 2pi}", a=angle)
    assert np.allclose(found.x, np.linspace(0.0, 10.0, 6))


def test_rows_and_times_are_cut(hinge):
    entry = "{column: a, role: q, joint: hinge}"
    (found,) = read(hinge, entry, mapping.Rule(rows=(1, 4)), a=np.arange(6))
    assert np.array_equal(found.x, [1, 2, 3])
    (found,) = read(hinge, entry, mapping.Rule(start=0.015, end=0.04), a=np.arange(6))
    assert np.array_equal(found.x, [2, 3, 4])


def test_unused_columns_are_checked_and_left_out(hinge):
    assert read(hinge, "{column: a, role: unused, unit: V}", a=np.zeros(6)) == []


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{column: a, role: gyro, axis: w}", "must be one of x, y, z, got 'w'"),
        (
            "{column: a, role: q, joint: hinge, unit: mm}",
            "turning joint: give q in a unit of angle",
        ),
        (
            "{column: a, role: tau, joint: hinge, unit: N}",
            "turning joint: give tau in a unit of torque",
        ),
    ],
)
def test_units_fit_the_joint(hinge, entry, said):
    with pytest.raises(ParameterError, match=said):
        read(hinge, entry, a=np.zeros(6))


def test_a_sliding_joint_is_measured_in_metres(one_joint):
    slide = one_joint("hinge", "prismatic")
    (found,) = read(slide, "{column: a, role: q, joint: hinge, unit: mm}", a=np.full(6, 5.0))
    assert np.allclose(found.x, 0.005)
    with pytest.raises(ParameterError, match="sliding joint"):
        read(slide, "{column: a, role: q, joint: hinge, unit: deg}", a=np.zeros(6))


class Hand:
    """A robot of whose joints one follows another."""

    joints, followers = ("a", "b"), {"b": ("a", -2.0, 0.5)}


@pytest.mark.parametrize("own", [(), ("command_position",), ("q", "command_position")])
def test_a_joint_that_follows_another_is_made_from_it_where_nobody_recorded_it(own):
    roles = ("q", "dq", "tau", "command_position", "command_velocity")
    given = [tracks.Track(role, "a", T, 0.1 * T, "topic") for role in roles]
    given += [tracks.Track(role, "b", T, 0.0 * T, "other") for role in own]
    notes = []
    made = tracks.followed(given, Hand(), notes)[len(given) :]
    assert {t.role for t in made} == set(roles) - {"tau", *own}
    assert bool(notes) == ("q" not in own)
    for track in made:
        shift = 0.5 if track.role in ("q", "command_position") else 0.0
        assert track.place == "b"
        np.testing.assert_allclose(track.x, -0.2 * T + shift)


@pytest.mark.parametrize(("before", "after"), [("left_", ""), ("", "_joint"), ("ur5/", "/pos")])
def test_names_of_joints_differ_by_one_prefix_and_suffix(before, after):
    joints = ("hip", "knee", "knee_roll")
    named = {f"{before}{joint}{after}": joint for joint in joints}
    assert tracks.joint_names([*named, "wheel"], joints) == named
    back = {joint: name for name, joint in named.items()}  # the model has them
    assert tracks.joint_names(joints, tuple(named)) == back
    assert tracks.joint_names([*named][:2], joints) == {}  # one is lacking
    twice = [f"{side}_{joint}" for side in ("left", "right") for joint in joints]
    assert tracks.joint_names(twice, joints) == {}
