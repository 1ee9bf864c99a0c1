# SPDX-License-Identifier: Apache-2.0
"""Robots come from URDF, xacro and MJCF; what a file says beside the standard is named."""

import stat

import pytest

from loco_control.exceptions import ParameterError
from loco_sim.foreign import read as reading
from loco_sim.foreign.tidy import Tidied

BODY = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
ARM = f'<link name="base">{BODY}</link><link name="arm">{BODY}</link>'
JOINT = '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint>'
XACRO = (
    '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    f'<xacro:property name="a" value="1"/>{ARM}{JOINT}</robot>'
)


def written(folder, text, name="robot.urdf"):
    path = folder / name
    path.write_text(text)
    return path


def tool(folder, monkeypatch, script):
    """A program named xacro, alone on the path."""
    path = written(folder, f"#!/bin/sh\n{script}\n", "xacro")
    path.chmod(path.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setattr(reading.shutil, "which", lambda name: str(path))


def test_a_xacro_is_expanded_where_xacro_is_there(tmp_path, monkeypatch):
    expanded = written(tmp_path, f'<robot name="r">{ARM}{JOINT}</robot>', "expanded.urdf")
    tool(tmp_path, monkeypatch, f'echo "about $1" >&2; cat {expanded}')
    made = Tidied(written(tmp_path, XACRO, "robot.urdf.xacro"))
    assert [e.get("name") for e in made.root.findall("link")] == ["base", "arm"]
    assert made.notes == ["expanded by xacro"]


def test_without_xacro_the_command_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(reading.shutil, "which", lambda name: None)
    monkeypatch.setattr(reading.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(ParameterError, match=r"is xacro.*: xacro .*a\.xacro > robot\.urdf"):
        Tidied(written(tmp_path, XACRO, "a.xacro"))


def test_the_reason_of_xacro_is_told(tmp_path, monkeypatch):
    tool(
        tmp_path, monkeypatch, 'echo "no such package: dog" >&2; echo "when processing" >&2; exit 2'
    )
    with pytest.raises(ParameterError, match="xacro: no such package: dog; xacro .*a.xacro >"):
        Tidied(written(tmp_path, XACRO, "a.xacro"))


@pytest.mark.parametrize(
    ("place", "xacro"),
    [
        ("dog_description", "dog_description/urdf/a.xacro"),  # by the name of the folder
        ("clone", "clone/urdf/a.xacro"),  # by its package.xml
        ("dog_description", "bringup/urdf/a.xacro"),  # beside the package of the xacro
    ],
)
def test_packages_near_a_xacro_are_found_without_ros(tmp_path, monkeypatch, place, xacro):
    package = tmp_path / place
    (package / "urdf").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name> dog_description </name></package>")
    (tmp_path / xacro).parent.mkdir(parents=True, exist_ok=True)
    ask = "from ament_index_python.packages import get_package_share_directory as g"
    ask += '; print(f\'<robot name=\\"{g(\\"dog_description\\")}\\"/>\')'
    tool(tmp_path, monkeypatch, f'"{reading.sys.executable}" -c "{ask}"')
    notes = reading.Notes()
    written((tmp_path / xacro).parent, XACRO, "a.xacro")
    root, _ = reading.read(tmp_path / xacro, notes)
    assert root.get("name") == str(package)


def test_a_package_that_is_nowhere_is_named(tmp_path, monkeypatch):
    ask = "from ament_index_python.packages import get_package_share_directory as g; g('cat')"
    tool(tmp_path, monkeypatch, f'"{reading.sys.executable}" -c "{ask}"')
    with pytest.raises(ParameterError, match="there is no package cat near"):
        Tidied(written(tmp_path, XACRO, "a.xacro"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<sdf/>", "is an SDF"),
        ("<mujocoinclude/>", "name the file that includes it"),
        ("<mujoco><worldbody><body/></mujoco>", "is not XML"),
        ("<mujoco><worldbody><bodi/></worldbody></mujoco>", "MuJoCo: .*bodi"),
        ("<html/>", "starts with <robot>"),
    ],
)
def test_what_is_no_robot_is_one_line(tmp_path, text, words):
    with pytest.raises(ParameterError, match=words) as caught:
        Tidied(written(tmp_path, text, "a.xml"))
    assert "\n" not in str(caught.value) and "a.xml" in str(caught.value)


@pytest.mark.parametrize(
    "extra",
    [
        '<loop_joint name="rod" type="revolute"/>',
        '<gazebo><joint name="rod" type="revolute"><parent>a</parent></joint></gazebo>',
        '<loop_joint name="rod"><parent link="base"/><child link="arm"/></loop_joint>',
    ],
)
def test_joints_that_close_a_chain_are_named(tmp_path, extra):
    made = Tidied(written(tmp_path, f'<robot name="r">{ARM}{JOINT}{extra}</robot>'))
    assert made.notes == ["a closed chain stays open, as robots here are trees; without: rod"]


@pytest.mark.parametrize(
    "extra",
    [
        "<drake:contact/>",
        '<link name="x"><sphere:radius value="1"/></link>',
        '<transmission gz:kind="simple"/>',
    ],
)
def test_prefixes_that_nobody_declared_are_no_fault(tmp_path, extra):
    made = Tidied(written(tmp_path, f'<robot name="r">{ARM}{JOINT}{extra}</robot>'))
    assert made.link("arm") is not None


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_joints_that_no_drive_moves_are_one_line_each(tmp_path, kind):
    more = f'<joint name="k" type="{kind}"><parent link="arm"/><child link="tip"/></joint>'
    tip = f'<link name="tip">{BODY}</link>'
    made = Tidied(written(tmp_path, f'<robot name="r">{ARM}{tip}{JOINT}{more}</robot>'))
    assert made.notes == [f"locked, as no drive moves a {kind} joint: k"]
    assert [j.get("type") for j in made.root.findall("joint")] == ["continuous", "fixed"]


@pytest.mark.parametrize(
    ("limits", "kind", "note"),
    [
        ('effort="1" velocity="2"', "continuous", "turn without limits, as they name none: j"),
        ('lower="0" upper="0" effort="1"', "continuous", "turn without limits, as they are 0: j"),
        ('upper="1.2"', "revolute", "a limit that is not named is read as 0 (0 to 1.2): j"),
        ('lower="-0.5"', "revolute", "a limit that is not named is read as 0 (-0.5 to 0): j"),
    ],
)
def test_what_was_taken_for_a_limit_is_told(tmp_path, limits, kind, note):
    joint = JOINT.replace("continuous", "revolute").replace(
        "</joint>", f"<limit {limits}/></joint>"
    )
    made = Tidied(written(tmp_path, f'<robot name="r">{ARM}{joint}</robot>'))
    assert made.root.find("joint").get("type") == kind and made.notes == [note]
