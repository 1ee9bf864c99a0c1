# SPDX-License-Identifier: Apache-2.0
"""What is cured in a URDF is named, and what is right is left as it is."""

import math

import numpy as np
import pytest

from loco_sim.foreign.tidy import Tidied
from loco_sim.foreign.weight import possible
from loco_sim.robot.frames import origin_of
from loco_sim.robot.urdf_check import TENSOR, inertia_fault

BODY = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial>"
)
ENDS = '<parent link="base"/><child link="arm"/>'


def tidied(tmp_path, joint, arm=BODY, more=""):
    """A base and an arm that hang together by a joint."""
    path = tmp_path / "robot.urdf"
    links = f'<link name="base">{BODY}</link><link name="arm">{arm}</link>'
    path.write_text(f'<robot name="r">{links}{joint}{more}</robot>')
    return Tidied(path)


def joints(made):
    return {j.get("name"): j for j in made.root.findall("joint")}


@pytest.mark.parametrize(
    ("kind", "limit", "becomes", "note"),
    [
        ("revolute", '<limit lower="-1" upper="1"/>', "revolute", ""),
        (
            "revolute",
            '<limit lower="0.5" upper="0.5"/>',
            "fixed",
            "locked, as the limits are equal",
        ),
        ("revolute", "", "continuous", "turn without limits"),
        ("revolute", '<limit lower="1" upper="-1"/>', "continuous", "turn without limits"),
        ("prismatic", "", "prismatic", "slide ±1 m"),
        ("prismatic", '<limit effort="3"/>', "prismatic", "slide ±1 m"),
        ("revolute", '<limit lower="wide" upper="1"/>', "revolute", ""),  # urdf_check names it
        ("planar", "", "fixed", "no drive moves a planar joint"),
        ("prismatic", '<dynamics damping="1e11"/>', "fixed", "no drive overcomes"),
    ],
)
def test_a_joint_has_a_range_it_can_move_in(tmp_path, kind, limit, becomes, note):
    made = tidied(tmp_path, f'<joint name="j" type="{kind}">{ENDS}{limit}</joint>')
    joint = joints(made)["j"]
    assert joint.get("type") == becomes
    assert bool(made.notes) == bool(note)
    assert note in " ".join(made.notes)
    if becomes == "prismatic":
        limit = joint.find("limit")
        assert (limit.get("lower"), limit.get("upper")) == ("-1.0", "1.0")


def test_a_ball_joint_is_three_hinges_about_three_axes(tmp_path):
    old = '<axis xyz="1 0 0"/><limit lower="0" upper="1"/>'
    made = tidied(tmp_path, f'<joint name="j" type="spherical">{ENDS}{old}</joint>')
    chain = joints(made)
    assert list(chain) == ["j_x", "j_y", "j_z"]
    axes = [[float(v) for v in j.find("axis").get("xyz").split()] for j in chain.values()]
    np.testing.assert_array_equal(axes, np.eye(3))
    assert all(len(j.findall("limit")) == len(j.findall("axis")) == 1 for j in chain.values())
    at = "base"
    for joint in chain.values():
        assert joint.find("parent").get("link") == at
        at = joint.find("child").get("link")
    assert at == "arm"
    assert made.mass() == pytest.approx(2.0, rel=0.01)  # feathers in between weigh next to nothing


def test_a_ball_joint_without_a_child_is_left_to_the_check(tmp_path):
    made = tidied(tmp_path, '<joint name="j" type="spherical"><parent link="base"/></joint>')
    assert list(joints(made)) == ["j"]


def test_a_floating_joint_under_an_empty_root_goes(tmp_path):
    float_ = '<joint name="f" type="floating"><parent link="world"/><child link="base"/></joint>'
    joint = f'<joint name="j" type="continuous">{ENDS}</joint>'
    made = tidied(tmp_path, joint, more=f'<link name="world"/>{float_}')
    assert list(joints(made)) == ["j"]
    assert [e.get("name") for e in made.root.findall("link")] == ["base", "arm"]
    assert "as a base that stands floats without it" in " ".join(made.notes)


def test_an_inertia_that_no_body_has_is_raised_and_one_that_is_no_number_is_left(tmp_path):
    joint = f'<joint name="j" type="continuous">{ENDS}</joint>'
    long = BODY.replace('izz="0.1"', 'izz="0.5"')
    tensor = tidied(tmp_path, joint, long).link("arm").find("inertial/inertia")
    assert not inertia_fault([float(tensor.get(key)) for key in TENSOR])
    for wrong in ("much", "nan"):
        made = tidied(tmp_path, joint, BODY.replace('izz="0.1"', f'izz="{wrong}"'))
        assert made.link("arm").find("inertial/inertia").get("izz") == wrong and not made.notes


@pytest.mark.parametrize("wrong", [
    'ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0.2"',  # a moment below 0
    'ixx="0" iyy="0" izz="0" ixy="0" ixz="2.4e-35"',
    'ixx="-0.1" iyy="-0.1" izz="-0.1" ixy="0" ixz="0"',
])  # fmt: skip
@pytest.mark.parametrize("kind", ["continuous", "fixed"])
def test_an_inertia_that_is_not_positive_is_mended(tmp_path, wrong, kind):
    right = 'ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0"'
    assert right in BODY
    joint = f'<joint name="j" type="{kind}">{ENDS}</joint>'
    made = tidied(tmp_path, joint, BODY.replace(right, wrong))
    tensor = [float(made.link("arm").find("inertial/inertia").get(key)) for key in TENSOR]
    assert not any(tensor) if kind == "fixed" and "0.2" not in wrong else not inertia_fault(tensor)
    assert "inertia" in " ".join(made.notes) and "arm" in " ".join(made.notes)


def test_possible_tensors_keep_their_axes_and_largest_moment():
    rng = np.random.default_rng(0)
    for _ in range(100):
        axes, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        wild = axes @ np.diag(rng.uniform(0.0, 1.0, 3)) @ axes.T
        made = possible(list(wild[np.triu_indices(3)]))
        low, middle, high = np.linalg.eigvalsh(made)
        assert low + middle >= high - 1e-12
        assert high == pytest.approx(np.linalg.eigvalsh(wild)[2])
        np.testing.assert_allclose(made @ wild, wild @ made, atol=1e-9)  # the same axes


@pytest.mark.parametrize("pitch", [0.3, math.pi / 2, -math.pi / 2])
def test_a_root_that_is_turned_leaves_everything_where_it_was(tmp_path, pitch):
    here = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0 0.2"/>'
    made = tidied(tmp_path, f'<joint name="j" type="continuous">{here}{ENDS}</joint>')
    before = origin_of(joints(made)["j"])
    c, s = math.cos(pitch), math.sin(pitch)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    way, offset = before
    turn = turn @ way.T  # the joint then is pitched alone: straight up, where roll and yaw are one
    made.turn_root("base", turn)
    after = origin_of(joints(made)["j"])
    np.testing.assert_allclose(after[1], turn @ offset, atol=1e-9)
    np.testing.assert_allclose(after[0], turn @ way, atol=1e-9)
