# SPDX-License-Identifier: Apache-2.0
"""Mesh files of every kind are read as they were written; one that is none is one line."""

import os
import struct

import numpy as np
import pytest
import trimesh

from loco_control.exceptions import LocoError
from loco_sim.meshes import collada, read
from loco_sim.meshes.read import READERS, load, mesh_points, read_mesh


def area(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces).area


@pytest.mark.parametrize("suffix", READERS)
def test_corners_and_area_are_those_that_were_written(tmp_path, suffix):
    path = tmp_path / f"part{suffix}"
    box = trimesh.creation.box(bounds=[[0.0, 0.0, -3.0], [1.0, 2.0, 0.5]])
    box.export(path)
    assert mesh_points(path) == pytest.approx(np.unique(box.vertices, axis=0))
    assert area(read_mesh(path)) == pytest.approx(box.area)


@pytest.mark.parametrize("suffix", READERS)
def test_what_is_written_for_an_engine_is_the_same_mesh(tmp_path, suffix):
    path = tmp_path / f"part{suffix}"
    trimesh.creation.icosphere(2, 0.3).export(path)
    end, content = read.rewritten(path)
    (tmp_path / f"again{end}").write_bytes(content)
    again = load(tmp_path / f"again{end}")
    assert again.triangles == pytest.approx(load(path).triangles, abs=1e-7)


def test_text_stl_polygons_negative_indices_and_objects_are_read(tmp_path):
    path = tmp_path / "part.obj"
    path.write_text("o a\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1/1 2//3 3 4 # square\n"
                    "g b\nf -4 -2 \\\n-1\n")  # fmt: skip
    mesh = load(path)
    assert mesh.groups.tolist() == [0, 0, 1]
    assert area(mesh) == pytest.approx(1.5)
    assert read.rewritten(path)[1].count(b"o part") == 2
    text = tmp_path / "part.stl"
    text.write_bytes(trimesh.exchange.stl.export_stl_ascii(trimesh.creation.box()).encode())
    assert area(load(text)) == pytest.approx(6.0)


def test_a_collada_scene_is_moved_turned_scaled_repeated_and_in_its_unit(tmp_path):
    node = (
        '<node id="one"><translate>1 0 0</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>'
        '<instance_geometry url="#g"/></node><node><matrix>1 0 0 0 0 1 0 0 0 0 1 7 0 0 0 1</matrix>'
        '<instance_node url="#one"/></node>'
    )
    path = dae(tmp_path, scene=node, unit='<unit meter="0.01"/>')
    corners = [[1, 0, 0], [1, 2, 0], [-1, 0, 0]]
    moved = np.add(corners, [0, 0, 7])
    expected = np.unique(0.01 * np.concatenate([corners, moved]), axis=0)
    assert load(path).vertices == pytest.approx(expected, abs=1e-12)


def test_a_shape_whose_material_is_missing_is_not_lost(tmp_path):
    path = tmp_path / "part.dae"
    trimesh.creation.box([1.0, 2.0, 3.0]).export(path)
    text = path.read_text()
    start, end = text.index("<library_materials>"), text.index("</library_materials>")
    path.write_text(text[:start] + "<library_materials>" + text[end:])
    assert area(read_mesh(path)) == pytest.approx(22.0)


def test_a_file_that_has_changed_is_read_again(tmp_path):
    path = tmp_path / "part.dae"
    for k, size in enumerate((1.0, 2.0)):
        trimesh.creation.box([size] * 3).export(path)
        os.utime(path, ns=(k, k))
        assert area(read_mesh(path)) == pytest.approx(6.0 * size**2)
        assert np.ptp(mesh_points(path)) == pytest.approx(size)


def test_a_file_that_is_no_mesh_has_no_corners_and_is_told_once(tmp_path, caplog):
    path = tmp_path / "part.dae"
    path.write_text("<COLLADA>")
    assert mesh_points(path).shape == (0, 3)
    assert read_mesh(path) is None
    assert caplog.text.count("part.dae") == 1


TRIANGLE = '<triangles><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'


def dae(folder, faces=TRIANGLE, numbers="0 0 0 1 0 0 0 1 0", scene=None, unit="", nodes=""):
    """A COLLADA file of one geometry."""
    if scene is None:
        scene = '<node><instance_geometry url="#g"/></node>'
    path = folder / "part.dae"
    path.write_text(
        f'<COLLADA xmlns="x"><asset>{unit}</asset><library_geometries><geometry id="g"><mesh>'
        f'<source id="s"><float_array>{numbers}</float_array></source>'
        f'<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>{faces}</mesh>'
        f"</geometry></library_geometries><library_nodes>{nodes}</library_nodes>"
        f'<library_visual_scenes><visual_scene id="all">{scene}</visual_scene>'
        '</library_visual_scenes><scene><instance_visual_scene url="#all"/></scene></COLLADA>'
    )
    return path


def stl(corners, count=1):
    return bytes(80) + struct.pack("<I", count) + struct.pack("<12f", *[0.0] * 3, *corners) + b"00"


CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
BAD = {
    "16 bytes": (".obj", b"v 1 2 3\nf 1 2 3\n", "names corner 1, counted from 0, of 1 corners"),
    "corner 0": (".obj", f"{CUBE}f 0 1 2".encode(), "names corner b'0' of 3"),
    "far back": (".obj", f"{CUBE}f -4 1 2".encode(), "names corner b'-4' of 3"),
    "large index": (".obj", f"{CUBE}f 1 2 {10**30}".encode(), "names corner"),
    "many digits": (".obj", f"{CUBE}f 1 2 {'9' * 9999}".encode(), "names corner"),
    "nan": (".obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "a coordinate is nan"),
    "inf": (".obj", b"v -inf 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "a coordinate is -inf"),
    "1e300": (".obj", b"v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3", "a coordinate is 1e+300"),
    "two numbers": (".obj", b"v 1 2\n", "a corner has 2 numbers"),
    "no number": (".obj", b"v 1 2 x\n", "b'x' is no number"),
    "two corners": (".obj", f"{CUBE}f 1 2".encode(), "has no faces"),
    "no faces": (".obj", CUBE.encode(), "has no faces"),
    "a long line": (".obj", CUBE.encode() + b"f" + b" 1" * 2**20, "has a line of more than"),
    "many objects": (".obj", CUBE.encode() + b"o\nf 1 2 3\n" * 1001, "has 1000 objects or more"),
    "binary": (".obj", bytes(range(256)) * 9, "has no faces"),
    "empty": (".stl", b"", "is cut off"),
    "huge count": (".stl", stl([0.0] * 9, 2**32 - 1), "is cut off"),
    "no triangle": (".stl", bytes(84), "has no faces"),
    "stl of nan": (".stl", stl([float("nan")] + [0.0] * 8), "a coordinate is nan"),
    "text cut": (".stl", b"solid\nfacet\nvertex 0 0 0\nendsolid", "has 1 corners, three for each"),
    "unknown kind": (".msh", bytes(16), "is of kind '.msh'"),
    "entities": (".dae", b'<!DOCTYPE a [<!ENTITY b "c">]><COLLADA>&b;</COLLADA>', "has a DOCTYPE"),
    "deep": (".dae", b"<COLLADA>" + b"<a>" * 99_999, "within each other"),
    "no COLLADA": (".dae", b"<a/>", "is not COLLADA"),
    "an encoding": (".dae", b'<?xml version="1.0" encoding="x"?><COLLADA/>', "is not XML"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_one_line_with_its_name(tmp_path, name):
    suffix, data, words = BAD[name]
    path = tmp_path / f"part{suffix}"
    path.write_bytes(data)
    assert words in refusal(path)


def refusal(path):
    with pytest.raises(LocoError) as raised:
        load(path)
    assert "\n" not in str(raised.value) and str(path) in str(raised.value)
    return str(raised.value)


def polylist(counts, indices):
    vertex = '<input semantic="VERTEX" source="#v" offset="0"/>'
    return f"<polylist>{vertex}<vcount>{counts}</vcount><p>{indices}</p></polylist>"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"numbers": "0 0 0 1 0 0 0 nan 0"}, "a coordinate is nan"),
        ({"numbers": "0 0 0 1 0 0"}, "names corner 2 of 2"),
        ({"numbers": "0 0 0 1 0 0 0 1 x"}, "'x' is no number"),
        ({"faces": TRIANGLE.replace("0 1 2", "0 1 -2")}, "names corner"),
        ({"faces": TRIANGLE.replace("0 1 2", "0 1")}, "are not those of its corners"),
        ({"faces": TRIANGLE.replace("0 1 2", "0 1 1e300")}, "indices"),
        ({"faces": TRIANGLE.replace('offset="0"', 'offset="9999999"')}, "whole number of 0 to 64"),
        ({"faces": TRIANGLE.replace("#v", "#w")}, "names '#w', which it does not hold"),
        ({"faces": TRIANGLE.replace("triangles", "tristrips")}, "<tristrips> is not read"),
        ({"faces": polylist("2000000000", "0 1 2")}, "too many"),
        ({"faces": polylist("2", "0 1")}, "fewer than 3 corners"),
        ({"faces": polylist("3 3", "0 1 2")}, "are not those of its corners"),
        ({"unit": '<unit meter="0"/>'}, "its unit is '0' m"),
        ({"scene": "<node><matrix>1 0 0</matrix></node>"}, "a <matrix> is not 16 numbers"),
        ({"scene": '<node id="a"><instance_node url="#a"/></node>'}, "within each other"),
        ({"scene": ""}, "has no faces"),
    ],
)
def test_a_bad_collada_file_is_one_line_with_its_name(tmp_path, values, words):
    assert words in refusal(dae(tmp_path, **values))


def test_nodes_that_double_each_other_have_an_end(tmp_path):
    nodes = "".join(
        f'<node id="n{k}"><instance_node url="#n{k + 1}"/><instance_node url="#n{k + 1}"/></node>'
        for k in range(40)
    )
    nodes += '<node id="n40"><instance_geometry url="#g"/></node>'
    path = dae(tmp_path, scene='<instance_node url="#n0"/>', nodes=nodes)
    assert f"more than {collada.MOST_NODES} nodes" in refusal(path)


def test_faces_are_counted_before_they_are_built(tmp_path, monkeypatch):
    monkeypatch.setattr(read, "MOST_FACES", 11)
    for suffix in READERS:
        path = tmp_path / f"part{suffix}"
        trimesh.creation.box().export(path)
        assert "at most 11" in refusal(path) or "more than 11" in refusal(path)


def test_other_files_that_a_mesh_names_are_not_opened(tmp_path):
    os.mkfifo(tmp_path / "trap.mtl")
    path = tmp_path / "part.obj"
    path.write_text("mtllib trap.mtl\nusemtl a\n" + CUBE + "f 1 2 3\n")
    assert len(load(path).faces) == 1


def test_a_pipe_a_circle_of_links_and_too_large_a_file_are_one_line(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "circle.stl").symlink_to("circle.stl")
    (tmp_path / "large.stl").write_bytes(bytes(1001))
    monkeypatch.setattr(read, "MOST_BYTES", 1000)
    assert "there is no mesh" in refusal(tmp_path / "pipe.stl")
    assert "circle.stl" in refusal(tmp_path / "circle.stl")
    assert "which is the limit" in refusal(tmp_path / "large.stl")
