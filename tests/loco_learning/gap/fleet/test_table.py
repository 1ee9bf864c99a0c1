# SPDX-License-Identifier: Apache-2.0
"""The table of a fleet: days in order, and one line for every mistake."""

import pytest

from loco_control.exceptions import LocoError
from loco_learning.gap.fleet import table

HEAD = "file,robot,day\n"


@pytest.fixture
def folder(tmp_path):
    for robot in ("r10", "r2"):
        for day in ("day 10", "day 9"):
            for name in ("b.csv", "a.csv"):
                path = tmp_path / robot / day / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("t\n0\n")
    return tmp_path


def test_folders_give_a_draft_that_reads_back_in_order(folder):
    found = table.scan(folder, lambda path: path.suffix == ".csv")
    path = folder / table.FILE
    path.write_text(table.dumps(table.COLUMNS, found[::-1]))
    rows = table.load(path, folder)
    assert sorted(rows) == sorted(found)
    assert list(table.by_day(rows)) == [
        ("r2", "day 9"), ("r2", "day 10"), ("r10", "day 9"), ("r10", "day 10"),
    ]  # fmt: skip
    assert [row.file for row in rows][:2] == ["r2/day 9/a.csv", "r2/day 9/b.csv"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("file,day\n", "has no column robot"),
        (HEAD, "lists no recording"),
        (HEAD + "r2/day 9/a.csv,,day 9\n", "row 2, names no robot"),
        (HEAD + "r2/day 9/a.csv,r2\n", "row 2, names no day"),
        (HEAD + "r2/day 9/c.csv,r2,day 9\n", "row 2: there is no recording 'r2/day 9/c.csv'"),
        (HEAD + 2 * "r2/day 9/a.csv,r2,day 9\n", "lists 'r2/day 9/a.csv' twice"),
    ],
)
def test_each_mistake_is_one_line(folder, text, says):
    path = folder / table.FILE
    path.write_text(text)
    with pytest.raises(LocoError, match=says) as error:
        table.load(path, folder)
    assert "\n" not in str(error.value)


def test_a_folder_without_recordings_says_what_it_needs(tmp_path):
    with pytest.raises(LocoError, match="ROBOT/DAY/FILE"):
        table.scan(tmp_path, lambda path: True)


def test_a_changed_file_has_another_stamp(folder):
    path = folder / "r2/day 9/a.csv"
    before = table.stamp(path)
    assert table.stamp(path) == before
    path.write_text("t\n0\n1\n")
    assert table.stamp(path) != before != table.stamp(path.parent)
