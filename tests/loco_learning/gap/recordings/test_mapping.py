# SPDX-License-Identifier: Apache-2.0
"""mapping.yaml: what it says arrives, and each mistake in it has one clear line."""

import math

import pytest

from loco_control.exceptions import LocoError, MissingFileError
from loco_learning.gap.recordings import mapping
from loco_learning.gap.recordings.record import HELD_OUT

WHOLE = """
format: 1
files: ["a*.csv", b.csv]
time: {column: t, unit: ms}
rate: 200
columns:
  - {column: angle, role: q, joint: hinge, unit: deg, sign: -1, scale: 2, offset: pi/2, wrap: 2pi}
  - {column: volts, role: supply, unit: V, scale: 1/12}
header: {kp: {override: drives.hinge.kp, scale: 0.5}}
overrides: {fixed_base: true}
records:
  - {where: {kp: 2}, from: 1, to: 4.5, rest: -0.5, role: held-out}
  - {file: "a*", rows: [10, null]}
"""


def test_all_that_is_said_arrives():
    found = mapping.loads(WHOLE)
    assert found.files == ("a*.csv", "b.csv") and found.time == "t" and found.rate == 200.0
    assert found.time_unit == 1e-3
    assert [rule.rest for rule in found.records] == [-0.5, 0.0]
    angle, volts = found.columns
    assert angle.gain == pytest.approx(-2.0 * math.pi / 180.0) and angle.wrap == "2pi"
    assert angle.offset == pytest.approx(math.pi / 2.0) and angle.place == "hinge"
    assert volts.gain == pytest.approx(1.0 / 12.0)
    assert found.header["kp"].override == "drives.hinge.kp"
    first, second = found.records
    assert (first.start, first.end, first.role, first.where) == (1.0, 4.5, HELD_OUT, {"kp": (2,)})
    assert second.rows == (10, None) and second.file == "a*" and second.start == -math.inf


def test_little_need_be_said():
    found = mapping.loads("time: {rate: 100}")
    assert found.records == (mapping.Rule(),) and found.time_rate == 100.0


def test_a_folder_stands_for_its_mapping(tmp_path):
    (tmp_path / mapping.FILE).write_text(WHOLE)
    assert mapping.load(tmp_path) == mapping.load(tmp_path / mapping.FILE)
    with pytest.raises(MissingFileError):
        mapping.load(tmp_path / "other.yaml")


@pytest.mark.parametrize(("unit", "size"), [("A", 0.38), ("mA", 0.38e-3), ("count", 0.38)])
def test_a_scale_is_of_the_si_unit(unit, size):
    column = f"{{column: i, role: tau, joint: knee, unit: {unit}, scale: 0.38}}"
    assert mapping.loads(f"columns:\n  - {column}\n").columns[0].gain == pytest.approx(size)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("role: q,", "role: angle,", "no role in columns"),
        ("role: q, ", "", "no role in columns"),
        ("column: angle, ", "", "names no column"),
        (" joint: hinge,", "", "must name its joint"),
        ("deg, sign: -1, scale: 2", "A", "a unit of current, not of angle or length"),
        ("unit: V, scale: 1/12", "unit: V", "give a scale that converts"),
        ("unit: deg", "unit: dg", "did you mean 'deg'"),
        ("sign: -1", "sign: 2", "must be 1 or -1"),
        ("scale: 2,", "scale: two,", "scale of column 'angle' must be a number"),
        ("wrap: 2pi", "between: line", "between of column 'angle' must be hold or line"),
        ("wrap: 2pi", "wrap: pi", "no wrap of column 'angle' named 'pi'"),
        ("unit: ms", "unit: mm", "time is in mm"),
        ("rate: 200", "rate: -1", r"rate \[Hz\] must be 0 to"),
        ("rate: 200", "physics_step: 1", r"physics_step \[s\] must be 0 to 0.1, got 1"),
        ("rate: 200", "speed: 200", "no key in mapping.yaml named 'speed'"),
        ("format: 1", "format: 9", "this version reads 1"),
        ("rows: [10, null]", "rows: [10, 5]", r"rows must be \[first, stop\]"),
        ("role: held-out", "role: test", "available: fit, held-out"),
        ("override: drives.hinge.kp, ", "", "must name the override"),
        ("columns:", "columns: 3 #", "columns|YAML"),
        ("{fixed_base: true}", "[1]", "must be a mapping"),
        ("records:", "trust_units: maybe\nrecords:", "true or false"),
        ("format: 1", "format: [", "not YAML"),
        ("rest: -0.5,", "rest: 1,", "came to rest before the record begins"),
    ],
)
def test_each_mistake_has_one_line(old, new, said):
    assert old in WHOLE
    with pytest.raises(LocoError, match=said) as error:
        mapping.loads(WHOLE.replace(old, new))
    assert "\n" not in str(error.value)


def test_one_entry_for_a_list_of_joints_is_a_column_for_each_and_null_leaves_one_out():
    said = "columns:\n  - {column: pos, role: q, joint: [hip, null, knee], unit: deg}"
    hip, knee = mapping.loads(said).columns
    assert (hip.column, hip.place, knee.column, knee.place) == ("pos[0]", "hip", "pos[2]", "knee")
    assert hip.gain == knee.gain == pytest.approx(math.pi / 180.0)


def test_an_unused_column_may_be_in_any_unit_and_one_without_a_unit_is_in_si():
    unused, plain = mapping.loads(
        "columns: [{column: i, role: unused, unit: A}, {column: q, role: q, joint: a}]"
    ).columns
    assert (unused.gain, unused.unit) == (1.0, "A")
    assert (plain.gain, plain.unit, plain.offset) == (1.0, "", 0.0)


@pytest.mark.parametrize("rows", ["[0, 10]", "[null, 10]", "[0, null]", "[null, null]"])
def test_rows_begin_at_nothing_and_may_be_open(rows):
    (rule,) = mapping.loads(f"records: [{{rows: {rows}}}]").records
    assert rule.rows == tuple(None if r == "null" else int(r) for r in rows[1:-1].split(", "))


@pytest.mark.parametrize(
    "rows", ["[-1, 10]", "[5, 5]", "[1]", "[0, 1, 2]", "7", "[0.5, 9]", "[no, 9]"]
)
def test_rows_that_are_none_are_one_line(rows):
    with pytest.raises(LocoError, match="rows must be .first, stop., rows from 0, got"):
        mapping.loads(f"records: [{{rows: {rows}}}]")


def test_a_header_sets_its_override_as_it_is_where_nothing_else_is_said():
    header = mapping.loads("header: {kp: {override: drives.hinge.kp}}").header["kp"]
    assert (header.override, header.scale, header.offset) == ("drives.hinge.kp", 1.0, 0.0)


@pytest.mark.parametrize("time", ["{rate: 50, scale: 0.5}", "{column: t, scale: 0}",
                                  "{column: t, scale: -1}", "{column: t, scale: 1e300}"])  # fmt: skip
def test_a_scale_of_times_is_a_factor_for_a_column(tmp_path, time):
    path = tmp_path / "mapping.yaml"
    path.write_text(f"time: {time}\ncolumns:\n  - {{column: q, role: q, joint: knee}}\n")
    with pytest.raises(LocoError, match="time.scale must be 0.001 to 1000, and needs time.column"):
        mapping.load(path)
