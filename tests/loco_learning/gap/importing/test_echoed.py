# SPDX-License-Identifier: Apache-2.0
"""Messages that ROS prints, and arrays as programs write them into cells, are the same table."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.drafting.draft import of_table
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.importing import echoed, tables
from loco_learning.gap.recordings import mapping

JOINTS = ("hip", "knee")
T = 1700000000 + np.arange(9) * 0.01
Q, DQ = np.random.default_rng(0).normal(size=(2, 9, 2)).round(4)


def block(values):
    return "".join(f"\n- {x}" for x in values)


def inline(values):
    return f" [{', '.join(map(str, values))}]"


def echo(stamp, listed, indent="    "):
    """Text of JointStates, with efforts that were not measured."""
    text = ""
    for t, q, dq in zip(T, Q, DQ, strict=True):
        text += f"header:\n  stamp:\n{indent}{stamp[0]}: {int(t)}\n{indent}{stamp[1]}: "
        text += f"{round(t % 1 * 1e9)}\n  frame_id: ''\nname:{listed(JOINTS)}\n"
        text += f"position:{listed(q)}\nvelocity:{listed(dq)}\neffort:{listed(['.nan'] * 2)}\n---\n"
    return text


def cells(write):
    """Rows of a table whose cells are arrays."""
    rows = [f'{float(t)!r},"{write(JOINTS)}","{write(q)}","{write(dq)}"'
            for t, q, dq in zip(T, Q.tolist(), DQ.tolist(), strict=True)]  # fmt: skip
    return "\n".join(["time,name,position,velocity", *rows]) + "\n"


def csv_of_echo():
    rows = [f"{int(t)},{round(t % 1 * 1e9)},,hip,knee," + ",".join(map(str, [*q, *dq, 0.5, 0.5]))
            for t, q, dq in zip(T, Q, DQ, strict=True)]  # fmt: skip
    return "\n".join(rows) + "\n"


KINDS = {
    "ros2": echo(("sec", "nanosec"), block),
    "ros1": echo(("secs", "nsecs"), inline),
    "windows": echo(("sec", "nanosec"), block).replace("\n", "\r\n"),
    "warned": "A message was lost!!!\n\ttotal count change:1\n" + echo(("sec", "nanosec"), block),
    "cut off": echo(("sec", "nanosec"), block) + "header:\n  stamp:\n    sec: 1700000000\n",
    "csv": csv_of_echo(),
    "tuples": cells(lambda x: str(tuple(x))),
    "lists": cells(lambda x: str(list(x))),
    "arrays": cells(lambda x: f"array('d', {list(x)})"),
    "numpy": cells(lambda x: str(np.array(x)).replace("\n", "")),
}


@pytest.mark.parametrize("kind", KINDS)
def test_all_texts_of_joint_states_are_positions_of_the_joints_that_they_name(tmp_path, kind):
    path = tmp_path / "states.txt"
    path.write_bytes(KINDS[kind].encode())
    table = tables.read(path)
    rules = mapping.loads(of_table(table, Joints(JOINTS[::-1])))
    found = {(c.role, c.place): table.columns[c.column][:9] for c in rules.columns}
    for i, joint in enumerate(JOINTS):
        assert np.array_equal(found["q", joint], Q[:, i])
        assert np.array_equal(found["dq", joint], DQ[:, i])
    assert np.diff(table.columns[rules.time][:9]) == pytest.approx(0.01, abs=1e-6)
    efforts = {joint for role, joint in found if role == "command_torque"}
    assert efforts == (set(JOINTS) if kind == "csv" else set())  # those of NaN were not measured


def test_messages_in_lists_and_nested_fields_have_paths():
    text = """points:
- positions:
  - 1.5
  time:
    sec: 2
- positions: [2.5, 3.5]
ok: true
---
"""
    (values,) = echoed.messages(text)
    assert values == {
        "points[0].positions[0]": "1.5",
        "points[0].time.sec": "2",
        "points[1].positions[0]": "2.5",
        "points[1].positions[1]": "3.5",
        "ok": "true",
    }


@pytest.mark.parametrize(
    "row",
    ["1,2,,hip,knee,0.1", "1,2,,hip,hip,0.1,0.2", "1,2,3,0.1,0.2", "1.5,2,,hip,0.1", "t,q",
     "1,2,,a,b", "1,2,,hip,knee,0.1,0.2,0.3,0.4"],
)  # fmt: skip
def test_rows_that_are_no_joint_states_have_no_names(row):
    assert echoed.names_of_joint_states(row.split(",")) == []


def test_a_cell_that_opens_many_brackets_is_read_in_no_time(tmp_path):
    (tmp_path / "a.csv").write_text("t,q\n" + f'0,"{"[" * 100_000}x"\n' * 2)
    with pytest.raises(ParameterError, match="column 'q"):
        tables.read(tmp_path / "a.csv").column("q")
