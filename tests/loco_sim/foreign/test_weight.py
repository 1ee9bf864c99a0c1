# SPDX-License-Identifier: Apache-2.0
"""Links that weigh nothing become part of their parents, or weigh a feather between two joints."""

import pytest

from loco_sim.foreign.tidy import Tidied
from loco_sim.new_robot.body import Body
from loco_sim.robot.description import Description

TENSOR = '<inertia ixx="{0}" iyy="{0}" izz="{0}" ixy="0" ixz="0" iyz="0"/>'


def body(mass, inertia):
    return f'<inertial><mass value="{mass}"/>{TENSOR.format(inertia)}</inertial>'


def chain(folder, *inertials, kind="revolute"):
    """A base and links that hang on one another by hinges j1, j2 ...; the base weighs 10 kg."""
    links = f'<link name="l0">{body(10, 0.1)}</link>'
    for k, inertial in enumerate(inertials, 1):
        links += (
            f'<link name="l{k}">{inertial}</link><joint name="j{k}" type="{kind}">'
            f'<parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="{k % 2} {1 - k % 2} 0"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{links}</robot>')
    return Tidied(path)


def kinds(made):
    return [joint.get("type") for joint in made.root.findall("joint")]


@pytest.mark.parametrize(
    ("last", "word"),
    [
        ("", "nothing"),
        (body(0, 0), "nothing"),
        (f"<inertial>{TENSOR.format(1)}</inertial>", "nothing"),  # an inertia without a mass
        (body(1e-5, 1e-9), "dust"),
        (body(1e-9, 1e-12), "dust"),
    ],
)
def test_what_weighs_nothing_at_the_end_is_part_of_its_parent(tmp_path, last, word):
    made = chain(tmp_path, body(1, 0.01), last)
    assert kinds(made) == ["revolute", "fixed"]
    assert f"locked, as what they move weighs {word}: j2" in made.notes
    assert Body(Description(text(made))).joints == ("j1",)


@pytest.mark.parametrize("last", ["", body(1e-6, 1e-9)])
def test_a_whole_limb_of_dust_is_part_of_its_parent(tmp_path, last):
    made = chain(tmp_path, body(1, 0.01), "", last)
    assert kinds(made) == ["revolute", "fixed", "fixed"]


@pytest.mark.parametrize("middle", ["", body(0, 0), body(1e-6, 1e-9)])
def test_what_is_massless_between_two_joints_weighs_a_feather(tmp_path, middle):
    made = chain(tmp_path, middle, body(1, 0.01))
    assert kinds(made) == ["revolute", "revolute"]
    assert any("between two joints" in note and "l1" in note for note in made.notes)
    assert made.mass() == pytest.approx(11.0, rel=2e-3)
    assert Body(Description(text(made))).joints == ("j1", "j2")


def many(folder, count, more=""):
    """A base, an arm, and a chain of frames that are fixed to it."""
    parts = f'<link name="base">{body(10, 0.1)}</link><link name="f0">{body(1, 0.01)}</link>'
    parts += '<joint name="j" type="continuous"><parent link="base"/><child link="f0"/></joint>'
    for k in range(1, count):
        parts += (
            f'<link name="f{k}">{more}</link><joint name="j{k}" type="fixed">'
            f'<parent link="f{k - 1 - k % 2}"/><child link="f{k}"/></joint>'
        )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{parts}</robot>')
    return Tidied(path)


def test_frames_go_where_there_are_more_than_an_engine_takes(tmp_path):
    made = many(tmp_path, 200)
    assert len(made.root.findall("link")) <= 127
    assert made.link("base") is not None and made.link("f0") is not None
    children = {joint.find("child").get("link") for joint in made.root.findall("joint")}
    links = {link.get("name") for link in made.root.findall("link")}
    assert children == links - {"base"}
    assert any("frames are left out" in note for note in made.notes)


@pytest.mark.parametrize(
    ("count", "more"), [(100, ""), (200, body(1e-3, 1e-6)),
                        (200, '<visual><geometry><sphere radius="1"/></geometry></visual>')]
)  # fmt: skip
def test_frames_stay_where_there_is_room_and_parts_stay_always(tmp_path, count, more):
    made = many(tmp_path, count, more)
    assert len(made.root.findall("link")) == count + 1


def test_light_parts_that_are_no_dust_keep_their_joints(tmp_path):
    made = chain(tmp_path, body(1, 0.01), body(1e-3, 1e-7))
    assert kinds(made) == ["revolute", "revolute"] and not made.notes


def text(made):
    import xml.etree.ElementTree as ET

    return ET.tostring(made.root, encoding="unicode")
