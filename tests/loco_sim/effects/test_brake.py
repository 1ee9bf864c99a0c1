# SPDX-License-Identifier: Apache-2.0
"""A braked joint stops as a rubbing one does: it holds, it slows down, it never runs back."""

from dataclasses import dataclass

import numpy as np
import pytest

from loco_sim.effects.base import EFFECTS, Effect
from loco_sim.robot import robot
from loco_sim.robot.description import Description
from loco_sim.world.world import make_world

ARM = """<robot name="arm"><link name="stand"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
{links}</robot>"""
LINK = """<link name="{child}"><inertial><origin xyz="0 0 -0.1"/><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/></joint>"""


@pytest.fixture
def arm(tmp_path, engine):
    """Two links in a row that hang from a stand, in every engine."""
    upper = LINK.format(name="a", parent="stand", child="one", z=0)
    lower = LINK.format(name="b", parent="one", child="two", z=-0.2)
    (tmp_path / "arm.urdf").write_text(ARM.format(links=upper + lower))
    (tmp_path / "robot.yaml").write_text("urdf: arm.urdf\njoints: [a, b]\nfixed_base: true\n")
    loaded = robot.load(tmp_path)
    made = make_world(loaded, loaded.sim.replace(engine=engine), 0.001)
    yield made
    made.close()


def speeds(world):
    """Velocities of the joints [rad/s]."""
    return np.array(world.joint_states()[1])


def motion(world, budget, tau=(0.0, 0.0), steps=1000, start=(1.0, -0.3)):
    """Positions, velocities and mechanical energy of the arm, (steps, 5)."""
    world.rebuild(start, height=0.0)
    seen = []
    for _ in range(steps):
        if budget is not None:
            world.brake(np.array(budget), speeds(world))
        world.step(list(tau))
        q, dq = world.joint_states()
        seen.append([*q, *dq, sum(world.energy())])
    return np.array(seen)


@pytest.mark.parametrize("moments", [(1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (2e-4, 1e-3, 3e-4)])
def test_added_inertia_is_one_that_a_body_can_have(arm, moments):
    """The engine drops inertias whose largest moment exceeds the sum of the others."""
    told = Description(arm.robot.urdf)
    told.add_inertia("two", moments)
    tensor = told.inertia_of("two")
    low, middle, high = np.linalg.eigvalsh(tensor)
    assert high <= low + middle
    assert np.all(np.diag(tensor) >= np.array(moments) + 1e-4 - 1e-12)


def test_no_budget_is_no_brake_to_the_last_bit(arm):
    np.testing.assert_array_equal(motion(arm, None), motion(arm, [0.0, 0.0]))


@pytest.mark.parametrize("tau", [(0.0, 0.0), (4.0, 0.0), (-4.0, 0.5)])
def test_a_load_below_the_budget_is_held(arm, tau):
    """But for a creep below 2 mrad/s, which more iterations of the solver take away."""
    seen = motion(arm, [5.0, 5.0], tau)
    assert np.abs(seen[:, :2] - [1.0, -0.3]).max() < 2e-3


def test_a_load_above_the_budget_moves_by_the_difference(arm):
    """About the vertical, where gravity has no arm: I a = tau - budget, both joints as one."""
    inertia = 2e-4 + 0.1 * (0.1**2 + 0.3**2)
    seen = motion(arm, [5.0, 1e3], (8.0, 0.0), steps=5, start=(0.0, 0.0))
    assert seen[-1, 2] == pytest.approx(3.0 / inertia * 0.005, rel=0.05)


def test_braking_only_ever_takes_energy(arm):
    free, braked = (motion(arm, budget)[:, 4] for budget in ([0.0, 0.0], [0.05, 0.01]))
    assert np.diff(braked).max() <= np.diff(free).max()  # what the integrator itself adds
    assert braked[-1] < free[-1] - 0.05


def test_a_swing_dies_away_and_does_not_start_again(arm):
    seen = motion(arm, [0.08, 0.08], steps=4000)
    assert np.abs(seen[-500:, 2:4]).max() < 1e-3


def test_a_lifted_brake_lets_go(arm):
    motion(arm, [5.0, 5.0], steps=10)
    arm.brake(np.zeros(2), speeds(arm))
    for _ in range(100):
        arm.step([0.0, 0.0])
    assert abs(arm.joint_states()[1][0]) > 0.5


def test_budgets_of_effects_add_up_between_their_times(plant, commands):
    @dataclass
    class Rub(Effect, name="test_rub"):
        def on_brake(self, budget, tau, q, dq, dt, t):
            seen.append((round(t, 4), float(budget[0])))
            return budget + 2.0

    seen = []
    try:
        run = plant([Rub(), Rub(start=0.004)])
        run.step(*commands(0))
        run.step(*commands(1))
    finally:
        del EFFECTS["test_rub"]
    assert seen[:4] == [(0.0, 0.0), (0.001, 0.0), (0.002, 0.0), (0.003, 0.0)]
    assert seen[4:6] == [(0.004, 0.0), (0.004, 2.0)]


def test_joints_are_found_by_pattern(hyq):
    world = make_world(hyq, hyq.sim, 0.001)
    assert world.joint_index("*_kfe_joint").tolist() == [2, 5, 8, 11]
    assert world.joint_index("lf_haa_joint").tolist() == [0]
    assert world.robot.driven.tolist() == list(range(12))
    with pytest.raises(KeyError, match="no joint named 'knee'"):
        world.joint_index("knee")
    world.close()


def test_gravity_may_lean(hyq):
    world = make_world(hyq, hyq.sim, 0.001)

    def slope(w):
        w.gravity = (-5.0, 0.0, -8.0)

    world.rebuild(hyq.standing, [slope], height=5.0)
    for _ in range(100):
        world.step([0.0] * 12)
    np.testing.assert_allclose(world.base().velocity, [-0.5, 0.0, -0.8], atol=1e-6)
    world.rebuild(hyq.standing)
    assert world.gravity == (0.0, 0.0, -9.81)
    world.close()


def test_the_engine_gets_what_a_description_is_told(arm):
    told = Description(arm.robot.urdf)
    told.set_damping("a", 0.3)
    told.add_inertia("two", (0.0, 1e-3, 0.0))
    told.shift_com("two", (0.01, 0.0, 0.0))
    told.set_mass("one", 0.2)
    assert told.damping("a") == 0.3
    assert told.mass_of("one") == 0.2

    def configure(world):
        world.description.add_inertia("two", (0.0, 1e-3, 0.0))

    arm.rebuild((0.0, 0.0), height=0.0)
    before = arm.joint_inertia((0.0, 0.0))
    arm.rebuild((0.0, 0.0), [configure], height=0.0)
    np.testing.assert_allclose(arm.joint_inertia((0.0, 0.0)) - before, 1e-3, atol=1e-9)
