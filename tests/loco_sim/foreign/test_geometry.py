# SPDX-License-Identifier: Apache-2.0
"""Shapes that no engine takes are left out and named; no mesh is needed in the air."""

import numpy as np
import pytest

from loco_sim.foreign.tidy import Tidied
from loco_sim.mesh_files import mesh_path
from loco_sim.robot.urdf_check import problems

BODY = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
JOINT = '<joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint>'
POINTER = "version https://git-lfs\noid sha256:0\nsize 9\n"


def tidied(folder, *shapes, kind="collision"):
    """A base and an arm of some shapes."""
    parts = "".join(f"<{kind}><geometry>{shape}</geometry></{kind}>" for shape in shapes)
    links = f'<link name="base">{BODY}</link><link name="arm">{BODY}{parts}</link>'
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{links}{JOINT}</robot>')
    return Tidied(path)


def triangle(path):
    """A binary STL of one triangle."""
    corners = np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(80) + (1).to_bytes(4, "little") + corners.tobytes() + bytes(2))
    return path


def mesh(name):
    return f'<mesh filename="{name}"/>'


@pytest.mark.parametrize("kind", ["collision", "visual"])
@pytest.mark.parametrize(
    ("shape", "file", "reason"),
    [
        (mesh("nowhere.stl"), None, "its mesh is not there"),
        (mesh("package://a/b/c.dae"), None, "its mesh is not there"),
        (mesh("leg.stl"), POINTER.encode(), "pointer of Git LFS"),
        (mesh("leg.dae"), POINTER.encode(), "pointer of Git LFS"),
        (mesh("leg.stl"), bytes(80) + (9).to_bytes(4, "little") + bytes(50), "is cut off"),
        ('<box size="0 0 0"/>', None, "size or place is none"),
        ('<cylinder radius="0" length="1"/>', None, "size or place is none"),
        ('<box size="1 -1 1"/>', None, "size or place is none"),
        ("<cone/>", None, "size or place is none"),
    ],
)
def test_a_shape_that_is_none_is_left_out_and_named(tmp_path, kind, shape, file, reason):
    if file is not None:
        (tmp_path / ("leg.stl" if "leg.stl" in shape else "leg.dae")).write_bytes(file)
    made = tidied(tmp_path, shape, '<sphere radius="0.1"/>', kind=kind)
    assert len(made.link("arm").findall(kind)) == 1  # the other one stays
    note = " ".join(made.notes)
    assert reason in note and "arm" in note
    assert not list(problems(made.root, tmp_path, bolted=True))


@pytest.mark.parametrize("kind", [".glb", ".ply", ".msh"])
def test_kinds_of_meshes_that_no_engine_reads_touch_nothing_and_are_drawn(tmp_path, kind):
    (tmp_path / f"leg{kind}").write_bytes(b"anything")
    assert tidied(tmp_path, mesh(f"leg{kind}")).link("arm").find("collision") is None
    assert (
        tidied(tmp_path, mesh(f"leg{kind}"), kind="visual").link("arm").find("visual") is not None
    )


@pytest.mark.parametrize(
    ("shape", "key", "value"),
    [
        ('<box size="1 2 0"/>', "size", "1 2 0.001"),
        ('<box size="0 2 0"/>', "size", "0.001 2 0.001"),
        ('<cylinder radius="0.2" length="0"/>', "length", "0.001"),
    ],
)
def test_plates_and_discs_get_a_thickness(tmp_path, shape, key, value):
    made = tidied(tmp_path, shape)
    assert next(made.link("arm").iter(shape[1:].split()[0])).get(key) == value
    assert "a side of length 0 is read as 1 mm: arm" in made.notes


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("package://meshes/leg.stl", "meshes/leg.stl"),  # without the package's name
        ("package:///meshes/leg.stl", "meshes/leg.stl"),
        ("package://dog/meshes/leg.stl", "leg.stl"),  # copied beside the file
        ("package://dog/meshes/visual/leg.stl", "../meshes/visual/leg.stl"),
        ("package://dog/meshes/visual/leg.stl", "meshes/leg.stl"),
        ("/home/somebody/ws/src/dog/meshes/leg.stl", "../meshes/leg.stl"),
        ("file:///home/somebody/dog/leg.stl", "leg.stl"),
        ("..\\meshes\\leg.stl", "../meshes/leg.stl"),
    ],
)
def test_a_mesh_is_looked_for_near_the_robot(tmp_path, name, place):
    folder = tmp_path / "robots" / "urdf"
    folder.mkdir(parents=True)
    path = triangle((folder / place).resolve())
    assert mesh_path(name, folder).resolve() == path


@pytest.mark.parametrize(
    "name", ["package://dog/meshes/leg.stl", "https://host/meshes/leg.stl", "package://", ""]
)
def test_a_mesh_far_away_or_of_another_name_is_not_taken(tmp_path, name):
    folder = tmp_path / "a" / "b" / "c" / "d"
    folder.mkdir(parents=True)
    triangle(tmp_path / "elsewhere" / "leg.stl")
    triangle(folder / "arm.stl")
    assert mesh_path(name, folder) is None
