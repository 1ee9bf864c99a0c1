# SPDX-License-Identifier: Apache-2.0
"""Triangles of simple solids: closed, with the outside outside, and of the right size."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from loco_sim.meshes import solids


@pytest.mark.parametrize(
    ("triangles", "volume", "extent"),
    [
        (solids.box([0.2, 0.1, 0.3]), 0.2 * 0.1 * 0.3, [0.2, 0.1, 0.3]),
        (solids.cylinder(0.1, 0.3), math.pi * 0.01 * 0.3, [0.2, 0.2, 0.3]),
        (solids.capsule(0.1), math.pi * 4e-3 / 3.0, [0.2, 0.2, 0.2]),
        (solids.capsule(0.1, 0.2), math.pi * (4e-3 / 3.0 + 2e-3), [0.2, 0.2, 0.4]),
    ],
)
def test_a_solid_is_closed_and_has_its_volume(triangles, volume, extent):
    solid = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    assert solid.is_watertight and solid.is_winding_consistent
    assert 0.94 * volume < solid.volume <= volume * (1.0 + 1e-9)  # corners lie on the surface
    np.testing.assert_allclose(solid.extents, extent, rtol=0.011)
    np.testing.assert_allclose(solid.bounds.mean(axis=0), 0.0, atol=1e-12)
