# SPDX-License-Identifier: Apache-2.0
"""Files of all kinds become the same columns; what is no table is refused in one line."""

import gzip
import json
import re

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_learning.gap.importing import tables


def written(folder, name, text):
    path = folder / name
    data = text.encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


SAME = {
    "plain.csv": "t,q\n0.0,1.5\n0.1,2.5\n",
    "packed.csv.gz": "t,q\n0.0,1.5\n0.1,2.5\n",
    "tail.csv": '"t","q",\n0.0,1.5,\n0.1,2.5,\n\n',
    "comma.csv": "t;q\n0,0;1,5\n0,1;2,5\n",
    "tabs.txt": "# logged by hand\nt\tq\n0.0\t1.5\n0.1\t2.5\n",
    "spaces.txt": "t q\n0.0 1.5\n0.1 2.5\n",
    "bom.csv": "\ufefft, q\n0.0, 1.5\n0.1, 2.5\n",
    "log.json": json.dumps({"kp": 3, "entries": [{"t": 0.0, "q": 1.5}, {"t": 0.1, "q": 2.5}]}),
    "list.json.gz": json.dumps([{"t": 0.0, "q": 1.5}, {"t": 0.1, "q": 2.5}]),
    "sides.json": json.dumps({"t": [0.0, 0.1], "q": [1.5, 2.5]}),
    "lines.jsonl": '{"t": 0.0, "q": 1.5}\n{"t": 0.1, "q": 2.5}\n',
}


@pytest.mark.parametrize("name", SAME)
def test_all_kinds_of_files_say_the_same(tmp_path, name):
    table = tables.read(written(tmp_path, name, SAME[name]))
    assert list(table.columns) == ["t", "q"]
    assert np.array_equal(table.column("t"), [0.0, 0.1])
    assert np.array_equal(table.column("q"), [1.5, 2.5])


def test_fields_around_the_samples_are_the_header(tmp_path):
    table = tables.read(written(tmp_path, "a.json", SAME["log.json"]))
    assert table.header == {"kp": 3}


def test_empty_fields_are_nan_and_truth_is_a_number(tmp_path):
    table = tables.read(written(tmp_path, "a.csv", "t,on,q\n0,true,\n1,False,3\n2,1\n"))
    assert np.array_equal(table.column("on"), [1.0, 0.0, 1.0])
    assert np.array_equal(table.column("q"), [np.nan, 3.0, np.nan], equal_nan=True)


def test_nested_samples_have_dotted_names(tmp_path):
    rows = [{"imu": {"gyro": [1, 2]}, "q": 0.0, "what": "x"}] * 2
    table = tables.read(written(tmp_path, "a.json", json.dumps(rows)))
    assert list(table.columns) == ["imu.gyro[0]", "imu.gyro[1]", "q"]


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("", ["1", "2", "3"]),
        ("# t q[1] dq\n", ["t", "q[1]", "dq"]),
        ("# bench 4, today\n#t, q, dq\n", ["t", "q", "dq"]),
        ("t q dq\n", ["t", "q", "dq"]),
        ("# a sentence of five words\n", ["1", "2", "3"]),
        ("# 1 2 3\n", ["1", "2", "3"]),
    ],
)
def test_names_stand_above_the_rows_in_a_comment_or_are_numbers(tmp_path, head, names):
    table = tables.read(written(tmp_path, "a.dat", f"{head}0.0 1.5 0\n0.1 2.5 -1\n# end\n"))
    assert [list(table.columns), len(table)] == [names, 2]
    assert table.column(names[1]).tolist() == [1.5, 2.5]


@pytest.mark.parametrize(
    ("head", "names", "told"),
    [
        ("t;q;dq\n[s];[deg];-\n", ["t [s]", "q [deg]", "dq"], 0),
        ("Device: bench\nkp;30\nt;q;dq\ns;rad;rad/s\n", ["t [s]", "q [rad]", "dq [rad/s]"], 1),
        ("Recorded on 2021-03-04\n\nt;q;dq\n", ["t", "q", "dq"], 1),
        ("% t;q;dq\n", ["t", "q", "dq"], 0),
        ("%;t;q;dq\n", ["t", "q", "dq"], 0),
        ("//;t;q;dq\n", ["t", "q", "dq"], 0),
        ("%t;q;dq\n", ["%t", "q", "dq"], 0),
        ("s;V;A\n", ["s", "V", "A"], 0),
    ],
)
def test_the_names_are_above_the_numbers_and_units_may_be_between(tmp_path, head, names, told):
    table = tables.read(written(tmp_path, "a.csv", f"{head}0,0;1,5;0\n0,1;2,5;-1\n"))
    assert [list(table.columns), len(table), len(table.notes)] == [names, 2, told]
    assert table.column(names[1]).tolist() == [1.5, 2.5]


def test_rows_of_events_above_the_numbers_are_no_names(tmp_path):
    table = tables.read(written(tmp_path, "a.csv", "t,event,q\n0.1,start,\n0.2,,5\n0.3,,6\n"))
    assert table.column("t").tolist() == [0.1, 0.2, 0.3]


SCOPE = (
    "Name\tTwo axes\nStart\t13377200\n\nName\tq\tName\tgoal\nSampleTime[ms]\t5\tSampleTime[ms]\t5\n"
)
LABVIEW = (
    "LabVIEW Measurement\nDecimal_Separator\t.\n***End_of_Header***\n\nChannels\t2\n"
    "Samples\t9\t9\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t0.005\t0.005\n"
    "***End_of_Header***\nX_Value\tq\tgoal\tComment\n"
)


@pytest.mark.parametrize(
    ("head", "row"),
    [(SCOPE, "{t}\t{q}\t{t}\t{goal}"), (LABVIEW, "{t}\t{q}\t{goal}\t"),
     ("Bench 4\nlogged by hand, twice\nt\tq\tgoal\n", "{t}\t{q}\t{goal}")],
)  # fmt: skip
@pytest.mark.parametrize("point", [".", ","])
def test_headers_of_programs_end_above_the_rows(tmp_path, head, row, point):
    rows = [row.format(t=0.5 * i, q=1.5 * i, goal=2.5 * i).replace(".", point) for i in range(9)]
    table = tables.read(written(tmp_path, "a.txt", head + "\n".join(rows) + "\n"))
    assert table.column("q").tolist() == [1.5 * i for i in range(9)]
    assert table.column("goal").tolist() == [2.5 * i for i in range(9)]
    assert "lines above the names are no samples" in table.notes[0]


def test_a_duration_is_a_time(tmp_path):
    for rows, times in (
        ("0 sec,1\n0.005 sec,2\n", [0.0, 0.005]),
        ("0 ms,1\n5 ms,2\n", [0.0, 0.005]),
    ):
        table = tables.read(written(tmp_path, "a.csv", "Time,q\n" + rows))
        assert table.column("Time").tolist() == pytest.approx(times) and table.clocks == ("Time",)


def test_lists_in_columns_of_a_json_log_are_columns(tmp_path):
    log = {"t": [0, 1, 2], "q": [[1, 2], [3, 4], [5]], "kp": [3]}
    table = tables.read(written(tmp_path, "a.json", json.dumps(log | {"kp": 3})))
    assert table.column("q[0]").tolist() == [1.0, 3.0, 5.0]
    np.testing.assert_array_equal(table.column("q[1]"), [2.0, 4.0, np.nan])


@pytest.mark.parametrize("head", ["", "Connecting to COM3 ...\nReady.\n"])
@pytest.mark.parametrize("row", ["t:{} q:{}", "t={},q={}", "t: {}, q: {}"])
def test_cells_may_have_their_names(tmp_path, head, row):
    text = head + "".join(row.format(i, 0.5 * i) + "\n" for i in range(4))
    if row == "t: {}, q: {}":
        text = text.replace(", ", ",")
    table = tables.read(written(tmp_path, "a.txt", text))
    assert table.column("q").tolist() == [0.0, 0.5, 1.0, 1.5] and list(table.columns) == ["t", "q"]


def test_columns_may_be_in_a_mapping_of_a_json_log(tmp_path):
    table = tables.read(written(tmp_path, "a.json", '{"of": {"t": [0, 1], "q": [2, 3]}, "kp": 3}'))
    assert table.column("of.q").tolist() == [2.0, 3.0] and table.header == {"kp": 3}
    with pytest.raises(ParameterError, match="must hold a list of samples or columns"):
        tables.read(written(tmp_path, "b.json", '{"kp": {"knee": 3}}'))


def test_a_last_row_may_be_cut_off(tmp_path):
    table = tables.read(written(tmp_path, "a.csv", "t,q,dq\n0,1,2\n1,2\n"))
    assert np.isnan(table.column("dq")[1]) and table.column("q").tolist() == [1.0, 2.0]


def test_columns_of_one_name_are_one_if_they_are_equal(tmp_path):
    table = tables.read(written(tmp_path, "a.csv", "t|q|q|u|u\n0|1|1|5|6\n1|2|2|5|7\n"))
    assert list(table.columns) == ["t", "q"]
    with pytest.raises(ParameterError, match="two columns named 'u', with different values"):
        table.column("u")


def test_a_first_row_of_a_message_is_no_line_of_names(tmp_path):
    table = tables.read(written(tmp_path, "a.csv", "0,5,,knee,0.0,0.0\n1,6,,knee,0.1,0.2\n"))
    assert table.column("5").tolist() == [0.0, 0.1] and "4" in table.texts


def test_names_in_a_comment_may_have_spaces_between_tabs(tmp_path):
    table = tables.read(written(tmp_path, "a.txt", "# time [s]\tangle, motor\n0\t1\n1\t2\n"))
    assert list(table.columns) == ["time [s]", "angle, motor"]


def test_runs_of_a_json_log_are_episodes_and_samples_of_joints_are_not(tmp_path):
    runs = [{"kind": kind, "tags": ["a"], "q": [[i, -i] for i in range(size)],
             "u": [None, *range(1, size)]} for kind, size in (("chirp", 7), ("step", 5))]  # fmt: skip
    file = written(tmp_path, "a.json", json.dumps({"rate": 50, "data": runs}))
    table = tables.read(file)
    first, second = tables.episodes(table)
    assert (len(first), len(second), first.header["rate"]) == (7, 5, 50)
    assert second.column("q[1]").tolist() == [0, -1, -2, -3, -4]
    assert np.isnan(first.column("u")[0]) and first.column("u")[6] == 6
    assert table.notes == ("shorter lists of its runs are left out: tags",)
    samples = written(tmp_path, "b.json", json.dumps([{"q": x} for x in runs[0]["q"]]))
    assert list(tables.read(samples).columns) == ["q[0]", "q[1]"]


@pytest.mark.parametrize(
    ("cells", "asked", "why"),
    [
        (("high", "low"), "state", "column 'state' has 'high' in row 0"),
        (("1.0", "2026-11-27 10:00:00"), "state", "has '2026-11-27 10:00:00' in row 1"),
        (('"[1, 2]"', '"[1]"'), "state[0]", "'state' lists 1 numbers in row 1, 2 before"),
    ],
)
def test_a_column_of_texts_is_in_nobodys_way_until_it_is_asked_for(tmp_path, cells, asked, why):
    rows = "".join(f"{i},{cell},{2 * i}\n" for i, cell in enumerate(cells))
    table = tables.read(written(tmp_path, "a.csv", f"t,state,q\n{rows}"))
    assert table.column("q").tolist() == [0.0, 2.0]
    with pytest.raises(ParameterError, match=re.escape(why)):
        table.column(asked)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "", "empty"),
        ("a.csv", "t,q\n", "no samples"),
        ("a.csv", "t,q\n0.0,1.0,2.0\n", "line 2: 3 fields under 2"),
        ("a.csv", "q,q\n0.0,1.0\n", "two columns named 'q'"),
        ("a.csv", "t,q,dq\n0,1\n1,2\n", "3 names of columns above 2 values in a row"),
        ("a.txt", "time [s] angle\n0 1\n1 2\n", "3 names of columns above 2 values in a row"),
        ("a.txt", "% t q dq\n0 1\n1 2\n", "3 names of columns above 2 values in a row"),
        ("a.json", "{", "not JSON"),
        ("a.json", "3", "list of samples"),
        ("a.json", '{"t": [1, 2], "q": [1]}', r"have \[1, 2\] samples"),
        ("a.json", '[{"q": [1, 2, 3]}, {"q": [1, 2, 3], "u": [1, 2]}]', r"run 1: .* \[2, 3\]"),
        ("a.json", '[{"q": 1}, 2]', "must hold a list of samples"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, name, text, said):
    with pytest.raises(ParameterError, match=said) as error:
        tables.read(written(tmp_path, name, text))
    assert "\n" not in str(error.value)


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(MissingFileError):
        tables.read(tmp_path / "none.csv")
    with pytest.raises(NameUnknownError, match="available: q, t"):
        tables.read(written(tmp_path, "a.csv", SAME["plain.csv"])).column("angle")
    with pytest.raises(NameUnknownError, match="list of samples"):
        tables.read(written(tmp_path, "a.json", SAME["log.json"]), "rows")
    (tmp_path / "b.csv.gz").write_bytes(b"no gzip")
    with pytest.raises(ParameterError, match="is not a gzip file: it does not begin as one"):
        tables.read(tmp_path / "b.csv.gz")


TIMES = {
    "iso": ["2026-03-01T23:59:59", "2026-03-01T23:59:59.500000", "2026-03-02T00:00:00"],
    "zone": ["2026-03-01T23:59:59Z", "2026-03-02T01:59:59.5+02:00", "2026-03-02T00:00:00Z"],
    "space": ["2026-03-01 23:59:59.000", "2026-03-01 23:59:59.500", "2026-03-02 00:00:00.000"],
    "day": ["23:59:59.0", "23:59:59.5", "00:00:00.0"],
    "comma": ['"23:59:59,0"', '"23:59:59,5"', '"0:00:00,0"'],
    "any order": ["28/02/2026 23:59:59.0", "28/02/2026 23:59:59.5", "01/03/2026 00:00:00.0"],
}


@pytest.mark.parametrize("kind", TIMES)
@pytest.mark.parametrize("ending", ["csv", "jsonl"])
def test_dates_and_times_of_day_are_seconds(tmp_path, kind, ending):
    text = "when,q\n" + "".join(f"{cell},{i}\n" for i, cell in enumerate(TIMES[kind]))
    if ending == "jsonl":
        text = "".join(
            json.dumps({"when": cell.strip('"'), "q": 0.0}) + "\n" for cell in TIMES[kind]
        )
    table = tables.read(written(tmp_path, f"a.{ending}", text))
    assert np.diff(table.column("when")) == pytest.approx([0.5, 0.5])
    assert table.clocks == ("when",)


@pytest.mark.parametrize(
    ("first", "second", "name"),
    [
        ("header.stamp.sec", "header.stamp.nanosec", "header.stamp"),
        ("stamp_secs", "stamp_nsecs", "stamp"),
        ("sec", "nanosec", "sec + nanosec"),
    ],
)
def test_seconds_and_nanoseconds_are_one_time(tmp_path, first, second, name):
    rows = f"{first},{second},q\n7,900000000,1\n8,0,2\n"
    table = tables.read(written(tmp_path, "a.csv", rows))
    assert table.column(name) == pytest.approx([7.9, 8.0]) and table.clocks == (name,)


@pytest.mark.parametrize("text", ["--", "n.a.", "#N/A", "error 7"])
def test_a_text_among_numbers_is_told_with_its_rows_and_the_key(tmp_path, text):
    cells = [str(i) for i in range(9)]
    cells[3] = cells[5] = text
    rows = "t,q\n" + "".join(f"{i},{cell}\n" for i, cell in enumerate(cells))
    table = tables.read(written(tmp_path, "a.csv", rows))
    why = f"column 'q' has the text {text!r} in 2 of 9 rows, the first in row 3"
    with pytest.raises(ParameterError, match=re.escape(why) + f'.*missing: "{re.escape(text)}"'):
        table.column("q")
    assert np.flatnonzero(np.isnan(table.column("q", (text,)))).tolist() == [3, 5]


@pytest.mark.parametrize(
    ("line", "said"),
    [("end of log,,", "row 2 has only the text 'end of log'"), (",,*** stop ***", "'*** stop ***'"),
     ("t,q,goal", "row 2 repeats the header"), ("t, q, goal", "row 2 repeats the header")],
)  # fmt: skip
def test_rows_that_are_no_samples_are_left_out_and_told(tmp_path, line, said):
    rows = f"t,q,goal\n0,1,1\n1,2,2\n{line}\n2,3,3\n"
    table = tables.read(written(tmp_path, "a.csv", rows))
    assert table.column("q").tolist() == [1.0, 2.0, 3.0]
    assert len(table.notes) == 1 and said in table.notes[0]


@pytest.mark.parametrize("name", ["a.csv", "a.tsv"])
def test_a_comma_in_a_number_is_a_decimal_point_unless_there_is_a_point(tmp_path, name):
    mark = "\t" if name == "a.tsv" else ","
    rows = [["t", "q", "big"], ['"0,5"', '"-1,25"', '"1,234"'], ["1", '"2,5e-1"', "0.5"]]
    table = tables.read(written(tmp_path, name, "\n".join(mark.join(row) for row in rows)))
    assert table.column("t").tolist() == [0.5, 1.0] and table.column("q").tolist() == [-1.25, 0.25]
    with pytest.raises(ParameterError, match="'1,234' in row 0"):
        table.column("big")


def test_a_table_in_latin_1_is_read_and_told(tmp_path):
    """As written by older programs, with degrees and micrometres in the names."""
    path = tmp_path / "log.csv"
    path.write_bytes("t,Winkel [°],Weg [µm]\n0,1,2\n1,2,3\n2,3,5\n".encode("latin-1"))
    table = tables.read(path)
    assert [*table.columns] == ["t", "Winkel [°]", "Weg [µm]"]
    assert table.notes == ("log.csv is no UTF-8 text and was read as Latin-1",)
    path.write_bytes(b"t,q\n0,1\n\x00\x01\xff\xfe")
    with pytest.raises(ParameterError, match="not UTF-8"):
        tables.read(path)
