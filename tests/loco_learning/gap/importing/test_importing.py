# SPDX-License-Identifier: Apache-2.0
"""Measured sets through their mapping files alone, and folders and files of one's own."""

import gzip
import json

import numpy as np
import pytest

from loco_control.exceptions import LocoError, MissingFileError
from loco_learning.gap.importing import importing, tables
from loco_learning.gap.recordings import mapping, tracks
from loco_learning.gap.recordings.record import FIT, HELD_OUT
from loco_sim.robot import robot as robots


def load(path, robot, rules=None):
    return importing.load(path, robot, mapping.load(rules or path))


@pytest.fixture(scope="module")
def measured(repository):
    return repository / "bags/measured"


def test_silverbox(measured):
    found = load(measured / "silverbox", robots.load(measured / "silverbox"))
    by = {record.name: record for record in found}
    assert [r.name for r in found if r.role == FIT] == [f"multisine {i}" for i in (1, 2)]
    for record in found:
        assert 1.0 / record.dt == pytest.approx(1e7 / 2**14)
        assert record.command["torque"].shape == record.signals["q"].shape == (len(record.t), 1)
        assert record.overrides == {} and not record.inputs and record.ramps == ("torque",)
    fitted = max(np.abs(r.command["torque"]).max() for r in found if r.role == FIT)
    tail = by["arrow tail"]
    assert tail.role == HELD_OUT and np.abs(tail.command["torque"]).max() > 1.3 * fitted
    for name in ("multisine 1", "multisine 9"):  # begins at rest
        assert np.abs(by[name].signals["q"][:5]).max() < 0.02


def test_xl330(measured):
    found = load(measured / "bam_xl330", robots.load(measured / "bam_xl330"))
    assert len(found) == 16 and len({record.name for record in found}) == 16
    held = [record for record in found if record.role == HELD_OUT]
    assert len(held) == 4 and all("kp 200" in record.name for record in held)
    gains = {record.overrides["drives.servo_joint.kp"] for record in found}
    assert len(gains) == 4 and max(gains) == pytest.approx(8.0 * min(gains))
    assert min(gains) == pytest.approx(100 * 4096 / (2.0 * np.pi) / (256 * 885))
    for record in found:
        assert record.duration == pytest.approx(6.0, abs=0.02)
        assert record.step("q") == pytest.approx(2.0 * np.pi / 4096, rel=1e-3)
        assert 0.7 < record.inputs["supply"].min() < record.inputs["supply"].max() < 1.3
        dropped = record.name.startswith("lift_and_drop")
        assert (np.mean(record.inputs["enable"]) < 0.5) == dropped
        assert any("uneven stamps" in note for note in record.notes) and not record.has("dq")


def test_the_duty_of_the_xl330_is_that_of_its_own_log(measured):
    """The gain of the mapping times the error is the duty that the servo reports."""
    path = measured / "bam_xl330/2026-01-15_10h28m10.json.gz"
    table, rules = tables.read(path, "entries"), mapping.load(path.parent)
    gain = importing.overrides(rules, rules.records[0], table.header)["drives.servo_joint.kp"]
    load = next(column for column in rules.columns if column.column == "load")
    duty = tracks.values(load, table.column("load"), False) / 885.0
    error = table.column("goal_position") - table.column("position")
    assert np.polyfit(error, duty, 1)[0] == pytest.approx(gain, rel=0.01)


def test_dfki_pendulum(measured):
    robot = robots.load(measured / "dfki_pendulum")
    found = load(measured / "dfki_pendulum", robot)
    durations = {record.name: record.duration for record in found}
    assert durations == pytest.approx({"nominal": 3.5, "1 kg": 8.2}, abs=0.02)
    assert all(record.has("dq") and record.dt == pytest.approx(0.005) for record in found)
    path = measured / "dfki_pendulum/control_method_energy_shaping_data_measured_1kg.csv.gz"
    assert [r.name for r in load(path, robot, path.parent)] == ["1 kg"]


def test_their_files_are_small(measured):
    files = [path for path in measured.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 2.5e6
    assert not [path for path in files if "truth" in path.name]


RULES = """
files: "*.csv"
time: {column: t}
columns:
  - {column: q, role: q, joint: hinge}
  - {column: goal, role: command_position, joint: hinge}
"""


@pytest.fixture
def folder(tmp_path):
    """Two files of a hinge, and the mapping."""
    (tmp_path / mapping.FILE).write_text(RULES)
    t = np.arange(200) * 0.01
    for name, size in (("a.csv", 1.0), ("b.csv", 0.5)):
        rows = np.stack([t, size * np.sin(5.0 * t), size * np.sin(5.0 * t + 0.1)], axis=1)
        np.savetxt(tmp_path / name, rows, "%.6f", ",", header="t,q,goal", comments="")
    return tmp_path


def test_each_file_is_a_record(folder, hinge):
    assert [(r.name, r.role, len(r.t)) for r in load(folder, hinge)] == [
        ("a", FIT, 200),
        ("b", FIT, 200),
    ]
    assert [r.name for r in load(folder / "b.csv", hinge, folder)] == ["b"]


def test_an_empty_cell_is_no_reading(tmp_path, hinge):
    t = np.arange(400) * 0.005
    q, goal, tau = np.sin(5.0 * t), np.sin(5.0 * t + 0.1), 0.3 * np.cos(5.0 * t)
    full = np.stack([t, q, goal, tau], axis=1).astype(object)
    full[1::2, 1] = full[::2, 2] = ""  # two topics that speak in turn
    full[np.arange(400) % 10 > 0, 3] = ""
    lines = [",".join(str(cell) for cell in row) + ",walking" for row in full]
    (tmp_path / "a.csv").write_text("\n".join(["t,q,goal,tau,state", *lines]))
    rules = RULES + "  - {column: tau, role: tau, joint: hinge}\n"
    (tmp_path / mapping.FILE).write_text(rules)
    (made,) = load(tmp_path, hinge)
    assert 1.0 / made.dt == pytest.approx(100.0)
    at = made.t + 0.005  # the first command
    assert np.allclose(made.signals["q"][:, 0], np.sin(5.0 * at), atol=1e-6)
    known = np.isfinite(made.signals["tau"][:, 0])
    assert known.sum() == 39  # the first came before the first command
    words = "tau of hinge: 40 readings, each on its own stamp; 360 empty cells are none"
    assert words in made.notes


@pytest.mark.parametrize(
    ("column", "row", "cell", "why"),
    [
        (1, 7, "inf", "q of hinge has 1 values of 200 .* row 7"),
        (0, 9, "", "q of hinge has 1 stamps of 200 .* row 9"),
        (2, slice(None), "", "command_position of hinge has only NaN"),
    ],
)
def test_a_cell_that_spoils_a_reading_is_refused(folder, hinge, column, row, cell, why):
    rows = np.array([line.split(",") for line in (folder / "a.csv").read_text().split()], object)
    rows[1:][row, column] = cell
    (folder / "a.csv").write_text("\n".join(",".join(line) for line in rows))
    with pytest.raises(LocoError, match=why):
        load(folder / "a.csv", hinge, folder)


def test_rules_cut_and_choose(folder, hinge):
    (folder / mapping.FILE).write_text(
        RULES
        + """
overrides: {height: 1.0}
physics_step: 0.002
records:
  - {file: a.csv, from: 0, to: 1.2}
  - {file: a.csv, from: 1.2, to: 2, role: held-out, overrides: {height: 2.0}}
"""
    )
    first, second = load(folder, hinge)
    assert (first.name, second.name) == ("a 1", "a 2") and second.role == HELD_OUT
    assert first.duration == pytest.approx(1.2) and second.duration == pytest.approx(0.79)
    assert (first.overrides, second.overrides) == ({"height": 1.0}, {"height": 2.0})
    assert second.t[0] == 0.0 and (first.stepped, second.stepped) == (0.002, 0.002)
    with pytest.raises(LocoError, match="no record of .* fits"):
        load(folder / "b.csv", hinge, folder)


def test_columns_may_have_files_and_clocks_of_their_own(folder, hinge):
    t = np.arange(0.05, 2.0, 0.02)
    rows = np.stack([t, np.cos(t)], axis=1)
    np.savetxt(folder / "goals.txt", rows, header="when;goal", delimiter=";", comments="")
    text = RULES.replace("column: goal,", "column: goal, file: goals.txt, time: when,")
    (folder / mapping.FILE).write_text(text.replace("*.csv", "a.csv"))
    (made,) = load(folder, hinge)
    assert np.array_equal(made.command["position"][:4:2, 0], np.cos(t[:2]))
    assert len(made.t) == 195


def test_a_header_names_records_and_sets_values(tmp_path, hinge):
    entries = [{"t": 0.01 * k, "q": np.sin(0.05 * k), "goal": 0.0} for k in range(100)]
    log = {"kp": 4, "what": "swing", "entries": entries}
    (tmp_path / "x.json.gz").write_bytes(gzip.compress(json.dumps(log).encode()))
    rules = RULES.replace("*.csv", "*.json.gz")
    rules += "header: {kp: {override: drives.hinge.kp, scale: 0.5}}\n"
    (tmp_path / mapping.FILE).write_text(rules + "records: [{name: '{what} {kp}', where: {kp: 4}}]")
    (made,) = load(tmp_path, hinge)
    assert made.name == "swing 4" and made.overrides == {"drives.hinge.kp": 2.0}
    for old, new, said in (
        ("kp: {", "gain: {", "header field 'gain' must be a number"),
        ("{what}", "{who}", r"may have \{field\} for fields of the header \(kp, what\)"),
        ("{kp: 4}", "{kp: 5}", "no record of"),
    ):
        text = rules + "records: [{name: '{what} {kp}', where: {kp: 4}}]"
        (tmp_path / mapping.FILE).write_text(text.replace(old, new))
        with pytest.raises(LocoError, match=said):
            load(tmp_path, hinge)


def test_what_is_not_there_is_said(folder, hinge):
    with pytest.raises(MissingFileError, match="no recording"):
        load(folder / "c.csv", hinge, folder)
    (folder / mapping.FILE).write_text(RULES.replace("*.csv", "*.json"))
    with pytest.raises(MissingFileError, match=r"no file like \*.json"):
        load(folder, hinge)
    (folder / mapping.FILE).write_text(RULES.replace("time: {column: t}", ""))
    with pytest.raises(LocoError, match="must say time: .* a.csv has t, q, goal"):
        load(folder, hinge)
    (folder / mapping.FILE).write_text(RULES.replace("column: q,", "column: angle,"))
    with pytest.raises(LocoError, match="no column in a.csv named 'angle'"):
        load(folder, hinge)


@pytest.mark.parametrize("text", ["--", "lost"])
def test_texts_that_mean_no_reading_are_left_out_by_the_users_word(folder, hinge, text):
    rows = [line.split(",") for line in (folder / "a.csv").read_text().split()]
    for row in (7, 8, 30):
        rows[row][1] = text
    (folder / "a.csv").write_text("\n".join(",".join(row) for row in rows))
    with pytest.raises(LocoError, match=f"the text '{text}' in 3 of 200 rows.*missing: "):
        load(folder / "a.csv", hinge, folder)
    for missing in (f'"{text}"', f'[-1000, "{text}"]'):
        said = RULES.replace("role: q,", f"role: q, missing: {missing},")
        (folder / mapping.FILE).write_text(said)
        (record,) = load(folder / "a.csv", hinge, folder)
        words = f"q: 3 of 200 cells are '{text}', which the mapping calls missing: left out"
        assert words in record.notes and len(record.t) == 200
    (folder / mapping.FILE).write_text(RULES.replace("role: q,", "role: q, missing: [1, 2],"))
    with pytest.raises(LocoError, match="missing of column 'q' may have one number"):
        load(folder / "a.csv", hinge, folder)


@pytest.mark.parametrize("text", ["--", "stopped by hand"])
def test_a_row_with_a_text_for_its_time_is_no_reading_and_told(folder, hinge, text):
    rows = (folder / "a.csv").read_text().split("\n")
    rows[200] = f"{text},0.5,0.5"
    (folder / "a.csv").write_text("\n".join(rows))
    (record,) = load(folder / "a.csv", hinge, folder)
    assert len(record.t) == 199
    assert f"t: row 199 has the text '{text}' for its time: no reading" in record.notes
