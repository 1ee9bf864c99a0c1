# SPDX-License-Identifier: Apache-2.0
"""Numbers in other units are told by the rest of the file; right ones never are."""

import numpy as np
import pytest
import trimesh

from loco_sim.foreign.tidy import Tidied

from ...quadrupeds import DATA

SIDES = (0.1, 0.06, 0.3)
RODS = 4


LIMIT = '<limit lower="{}" upper="{}" effort="9" velocity="9"/>'


def rods(folder, mass=1.0, inertia=1.0, shape=True, filler=None, length=1.0, hinge=""):
    """A chain of rods of 30 cm; masses, inertias and lengths are multiplied by factors."""
    a, b, c = SIDES
    moments = np.array([b * b + c * c, a * a + c * c, a * a + b * b]) / 12.0
    box = f'<box size="{a * length} {b * length} {c * length}"/>' if shape is True else shape
    parts = ""
    for k in range(RODS):
        kilos = 1.5 - 0.2 * k
        values = kilos * moments * inertia
        if filler is not None:
            values = np.full(3, filler)
        ixx, iyy, izz = values
        form = f"<collision><geometry>{box}</geometry></collision>" if box else ""
        parts += (
            f'<link name="l{k}"><inertial><mass value="{kilos * mass}"/><inertia ixx="{ixx}" '
            f'iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial>{form}</link>'
        )
        if k:
            parts += (
                f'<joint name="j{k}" type="{"revolute" if hinge else "continuous"}">{hinge}'
                f'<parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="0 0 {0.3 * length}"/>'
                "</joint>"
            )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="r">{parts}</robot>')
    return Tidied(path)


@pytest.mark.parametrize("shape", [True, ""])
@pytest.mark.parametrize(
    ("mass", "inertia", "masses", "unit"),
    [
        (1.0, 1.0, False, ""),
        (1.0, 1e3, False, "g·m²"),
        (1.0, 1e4, False, "kg·cm²"),
        (1.0, 1e6, False, "kg·mm²"),
        (1.0, 1e9, False, "g·mm²"),
        (1e3, 1e3, True, "g·m²"),  # both in g
        (1e3, 1e9, True, "g·mm²"),
        (1e3, 1.0, True, ""),
        (0.2, 0.2, False, ""),  # of foam
        (7.0, 7.0, False, ""),  # of steel
    ],
)
def test_units_of_masses_and_inertias_are_told(tmp_path, shape, mass, inertia, masses, unit):
    notes = rods(tmp_path, mass, inertia, shape).notes
    assert any(note.startswith("masses in g?") for note in notes) == masses
    told = [note for note in notes if note.startswith("inertias in ")]
    assert [note.split("?")[0] for note in told] == ([f"inertias in {unit}"] if unit else [])


@pytest.mark.parametrize("shape", [True, ""])
@pytest.mark.parametrize(
    ("length", "mass", "inertia", "told"),
    [
        (1e3, 1.0, 1.0, ["lengths in mm"]),
        (1e3, 1.0, 1e6, ["lengths in mm", "inertias in kg·mm²"]),
        (1e3, 1e3, 1e9, ["lengths in mm and masses in g", "inertias in g·mm²"]),
        (1e2, 1.0, 1.0, ["lengths in cm"]),
        (1e2, 1.0, 1e4, ["lengths in cm", "inertias in kg·cm²"]),
    ],
)
def test_units_of_lengths_are_told_first(tmp_path, shape, length, mass, inertia, told):
    """With those of masses, and of inertias in view of both."""
    suspects = rods(tmp_path, mass, inertia, shape, length=length).suspects
    assert [note.split("?")[0] for note in suspects] == told


@pytest.mark.parametrize(
    ("low", "high", "told"),
    [
        (-90, 180, True),
        (0, 145, True),
        (-6.3, 6.3, False),
        (-12.5, 12.5, False),
        (-1e4, 1e4, False),
    ],
)
def test_joint_limits_in_degrees_are_told(tmp_path, low, high, told):
    suspects = rods(tmp_path, hinge=LIMIT.format(low, high)).suspects
    assert [note.split("?")[0] for note in suspects] == ["joint limits in degrees"] * told


def test_a_joint_that_mimics_none_moves_alone(tmp_path):
    made = rods(tmp_path, hinge=LIMIT.format(-1, 1) + '<mimic joint="gone"/>')
    assert made.notes == ["moved alone, as its <mimic> names 'gone', which is no joint: j1, j2, j3"]
    assert not list(made.root.iter("mimic"))


@pytest.mark.parametrize("value", [1.0, 0.5, 10.0])
def test_one_inertia_for_all_links_is_told(tmp_path, value):
    notes = rods(tmp_path, filler=value).notes
    assert notes == [
        f"an inertia of {value:g} kg·m² about each axis fills a gap of the file: l0, l1, l2, l3"
    ]


def test_an_inertia_of_one_is_right_on_a_large_link(tmp_path):
    path = tmp_path / "gate.urdf"
    body = '<mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    path.write_text(
        f'<robot name="gate"><link name="post"/><link name="leaf"><inertial>{body.format(20)}'
        '</inertial><visual><geometry><box size="0.8 0.04 1.2"/></geometry></visual></link>'
        '<joint name="hinge" type="continuous"><parent link="post"/><child link="leaf"/></joint>'
        "</robot>"
    )
    assert Tidied(path).notes == []


@pytest.mark.parametrize("kind", ["stl", "obj"])
@pytest.mark.parametrize("size", [SIDES, (0.02, 0.02, 0.05)])
def test_meshes_in_mm_are_scaled_and_told(tmp_path, kind, size):
    trimesh.creation.box(1e3 * np.array(size)).export(tmp_path / f"rod.{kind}")
    made = rods(tmp_path, shape=f'<mesh filename="rod.{kind}"/>')
    assert next(made.root.iter("mesh")).get("scale") == "0.001 0.001 0.001"
    assert [note for note in made.notes if "taken to be in mm" in note and "l0" in note]


@pytest.mark.parametrize("scale", ["0.001 0.001 0.001", ""])
def test_meshes_of_the_right_size_stay(tmp_path, scale):
    factor = 1e3 if scale else 1.0
    trimesh.creation.box(factor * np.array(SIDES)).export(tmp_path / "rod.stl")
    more = f' scale="{scale}"' if scale else ""
    made = rods(tmp_path, shape=f'<mesh filename="rod.stl"{more}/>')
    assert next(made.root.iter("mesh")).get("scale", "") == scale and not made.notes


@pytest.mark.parametrize(
    "name", ["a1/a1", "kuka_iiwa/model", "r2d2", "pendulum5", "cartpole", "husky/husky"]
)
def test_nothing_is_told_of_robots_in_si_units(name):
    words = ("in mm", "masses in g", "inertias in")
    assert not [n for n in Tidied(DATA / f"{name}.urdf").notes if any(w in n for w in words)]


@pytest.mark.parametrize("factor", [15.0, 40.0])
def test_an_error_far_from_any_unit_accuses_none(tmp_path, factor):
    """As of the arm HyA without meshes: 4 to 12 times m d²/4 is not a thousand."""
    assert not [note for note in rods(tmp_path, inertia=factor).notes if "inertias in" in note]
