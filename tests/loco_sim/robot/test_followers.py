# SPDX-License-Identifier: Apache-2.0
"""A joint that mimics another one is told what follows from its leader, on every road."""

import numpy as np
import pytest
import yaml

from loco_control.types import MotionCommand
from loco_sim.bolted.loop import Bolted
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots
from loco_sim.robot.description import Description

BODY = (
    '<inertial><origin xyz="0 0 -0.05"/><mass value="0.1"/><inertia ixx="1e-3" iyy="1e-3" '
    'izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
)


def urdf(*mimics):
    """Fingers a, b, c on a palm; of each the text of its mimic."""
    fingers = "".join(
        f'<link name="{name}">{BODY}</link><joint name="{name}_joint" type="continuous">'
        f'<parent link="palm"/><child link="{name}"/><axis xyz="0 1 0"/>{mimic}</joint>'
        for name, mimic in zip("abc", mimics, strict=True)
    )
    return f'<robot name="hand"><link name="palm">{BODY}</link>{fingers}</robot>'


def of(leader, factor="", offset=""):
    more = f' multiplier="{factor}"' if factor else ""
    more += f' offset="{offset}"' if offset else ""
    return f'<mimic joint="{leader}_joint"{more}/>'


@pytest.fixture
def hand(tmp_path):
    """Function that writes a hand and loads it."""

    def make(*mimics):
        (tmp_path / "hand.urdf").write_text(urdf(*mimics))
        drive = {"kind": "impedance", "kp": 2.0, "kd": 0.1}
        values = {"urdf": "hand.urdf", "fixed_base": True, "height": 1.0, "control_rate": 100,
                  "joints": [f"{n}_joint" for n in "abc"], "drives": {"*": drive}}  # fmt: skip
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(values))
        return robots.load(tmp_path)

    return make


@pytest.mark.parametrize(
    ("mimics", "expected"),
    [
        (("", of("a"), ""), {"b": ("a", 1.0, 0.0)}),
        (("", of("a", "-1", "0.2"), ""), {"b": ("a", -1.0, 0.2)}),
        ((of("c", "2"), "", ""), {"a": ("c", 2.0, 0.0)}),
        (("", of("a", "2", "0.1"), of("b", "3", "1")),
         {"b": ("a", 2.0, 0.1), "c": ("a", 6.0, 1.3)}),
        ((of("b"), of("a"), ""), {}),  # a ring follows nobody
        ((of("a"), "", ""), {}),
    ],
)  # fmt: skip
def test_leaders_of_leaders_lead(mimics, expected):
    found = Description(urdf(*mimics)).mimics()
    assert {k[0]: (v[0][0], *v[1:]) for k, v in found.items()} == pytest.approx(expected)


def test_who_follows_a_joint_that_is_not_there_follows_nobody(hand):
    assert hand("", of("z"), "").followers == {}


@pytest.mark.pybullet
def test_the_follower_goes_where_the_leader_sends_it_on_both_roads(hand):
    robot = hand("", of("a", "-0.5", "0.1"), "")
    told = 0.3 * np.sin(np.linspace(0.0, 6.0, 200))[:, None] * np.array([1.0, 0.0, 1.0])
    alone = Bolted(hand("", "", ""))
    coupled = told.copy()
    coupled[:, 1] = -0.5 * told[:, 0] + 0.1
    speed = np.gradient(told, 0.01, axis=0)
    fast = speed.copy()
    fast[:, 1] = -0.5 * speed[:, 0]
    expected = alone.run(coupled, fast, 0.0 * told)
    run = Bolted(hand("", of("a", "-0.5", "0.1"), "")).run(told, speed, 0.0 * told)
    np.testing.assert_array_equal(run.q, expected.q)
    assert np.ptp(run.q[:, 1]) > 0.1
    with Simulation(robot=robot) as plant:
        state = plant.reset()
        for k in range(len(told)):
            np.testing.assert_allclose(run.q[k], state.q, atol=1e-6)
            state = plant.step(MotionCommand(k, k * plant.dt, told[k], speed[k]))
