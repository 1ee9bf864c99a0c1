# SPDX-License-Identifier: Apache-2.0
"""Mesh files of every kind that engines take are read; one that is none is told once."""

import os

import numpy as np
import pytest
import trimesh

from loco_sim.robot.meshes import mesh_points, read_mesh
from loco_sim.robot.urdf_check import MESHES


@pytest.mark.parametrize("suffix", MESHES)
def test_corners_and_area_are_those_that_were_written(tmp_path, suffix):
    path = tmp_path / f"part{suffix}"
    box = trimesh.creation.box(bounds=[[0.0, 0.0, -3.0], [1.0, 2.0, 0.5]])
    box.export(path)
    assert mesh_points(path) == pytest.approx(np.unique(box.vertices, axis=0))
    assert read_mesh(path).area == pytest.approx(box.area)


def test_a_shape_whose_material_is_missing_is_not_lost(tmp_path):
    path = tmp_path / "part.dae"
    trimesh.creation.box([1.0, 2.0, 3.0]).export(path)
    text = path.read_text()
    start, end = text.index("<library_materials>"), text.index("</library_materials>")
    path.write_text(text[:start] + "<library_materials>" + text[end:])
    assert read_mesh(path).area == pytest.approx(22.0)


def test_a_file_that_has_changed_is_read_again(tmp_path):
    path = tmp_path / "part.dae"
    for k, size in enumerate((1.0, 2.0)):
        trimesh.creation.box([size] * 3).export(path)
        os.utime(path, ns=(k, k))
        assert read_mesh(path).volume == pytest.approx(size**3)
        assert np.ptp(mesh_points(path)) == pytest.approx(size)


def test_a_file_that_is_no_mesh_has_no_corners_and_is_told_once(tmp_path, caplog):
    path = tmp_path / "part.dae"
    path.write_text("<COLLADA>")
    assert mesh_points(path).shape == (0, 3)
    assert read_mesh(path) is None
    assert caplog.text.count("part.dae") == 1
