# SPDX-License-Identifier: Apache-2.0
"""Points that span the shapes of a link."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from loco_sim.foreign import shapes


def points(geometry: str, origin: str = "", kind: str = "collision") -> np.ndarray:
    shape = f"<{kind}>{origin}<geometry>{geometry}</geometry></{kind}>"
    return shapes.link_points(ET.fromstring(f"<link>{shape}</link>"), None, kind)


@pytest.mark.parametrize(
    ("geometry", "sides"),
    [
        ('<box size="0.2 0.4 0.6"/>', (0.2, 0.4, 0.6)),
        ('<sphere radius="0.3"/>', (0.6, 0.6, 0.6)),
        ('<cylinder radius="0.1" length="0.5"/>', (0.2, 0.2, 0.5)),
        ('<capsule radius="0.1" length="0.5"/>', (0.2, 0.2, 0.7)),
    ],
)
def test_a_shape_reaches_as_far_as_it_is_large(geometry, sides):
    found = points(geometry)
    assert np.ptp(found, axis=0) == pytest.approx(sides, rel=1e-3)
    assert found.max(0) == pytest.approx(-found.min(0), rel=1e-3)


def test_a_shape_is_turned_about_its_own_middle_and_then_moved():
    moved = points(
        '<box size="0.2 0.4 0.6"/>', '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
    )
    assert np.ptp(moved, axis=0) == pytest.approx((0.4, 0.2, 0.6))
    assert 0.5 * (moved.max(0) + moved.min(0)) == pytest.approx((1.0, 2.0, 3.0))


def test_all_shapes_of_the_kind_that_is_asked_for_count():
    link = ET.fromstring(
        '<link><collision><geometry><sphere radius="1"/></geometry></collision><collision><origin '
        'xyz="5 0 0"/><geometry><sphere radius="1"/></geometry></collision><visual><geometry><box '
        'size="9 9 9"/></geometry></visual></link>'
    )
    assert np.ptp(shapes.link_points(link, None), axis=0) == pytest.approx((7.0, 2.0, 2.0))
    assert np.ptp(shapes.link_points(link, None, "visual"), axis=0) == pytest.approx((9.0,) * 3)
    assert shapes.link_points(ET.fromstring("<link/>"), None).shape == (0, 3)


def test_a_mesh_counts_by_its_corners_and_scale_one_that_is_missing_does_not(tmp_path):
    (tmp_path / "tip.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 2\nf 1 2 3\nf 1 2 4\n")
    mesh = '<mesh filename="{}" scale="0.1 0.1 0.5"/>'
    link = "<link><collision><geometry>{}</geometry></collision></link>"

    def found(name: str) -> np.ndarray:
        return shapes.link_points(ET.fromstring(link.format(mesh.format(name))), tmp_path)

    assert np.ptp(found("tip.obj"), axis=0) == pytest.approx((0.1, 0.1, 1.0))
    assert found("gone.obj").shape == (0, 3)


@pytest.mark.parametrize("sides", [(0.2, 0.2, 0.2), (0.1, 0.3, 0.6)])
def test_a_box_has_the_moments_of_a_solid_one(sides):
    """By adding up small parts of it."""
    grid = [(np.arange(40) + 0.5) / 40 * side - 0.5 * side for side in sides]
    x, y, z = (axis.ravel() for axis in np.meshgrid(*grid))
    mass = 3.0 / len(x)
    wanted = [mass * np.sum(a * a + b * b) for a, b in ((y, z), (x, z), (x, y))]
    corners = points('<box size="{} {} {}"/>'.format(*sides))
    assert shapes.solid_inertia(3.0, corners) == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize(
    "flat", [np.zeros((0, 3)), np.zeros((1, 3)), np.array([[0, 0, 0], [1, 1, 0]])]
)
def test_what_has_no_thickness_still_has_moments_that_a_body_can_have(flat):
    moments = np.sort(shapes.solid_inertia(1.0, flat))
    assert moments[0] > 0.0 and moments[2] <= moments[0] + moments[1] + 1e-15
