# SPDX-License-Identifier: Apache-2.0
"""The pool of experiments to choose the next one from."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.prediction import running
from loco_learning.gap.proposals import pool
from loco_learning.gap.proposals.excitation import library
from loco_sim.plant.model import Model
from loco_sim.robot.spring import SpringParams


@pytest.fixture(scope="module")
def experiments():
    return library(Model("tigrillo"))


def named(experiments):
    return {e.name for e in experiments}


def robot(overrides):
    return Model("tigrillo", overrides).make_robot()


def test_the_next_experiment_is_held_as_the_recordings_were(experiments):
    model = Model("tigrillo")
    air, ground = robot({"fixed_base": True, "height": 1.0}), robot({})
    on_stand = pool.usable(model, experiments, [air])
    free = pool.usable(model, experiments, [ground])
    assert {"chirp_large_air", "steps_air"} <= named(on_stand)
    assert {"bound_fast", "chirp_large_ground"} <= named(free)
    assert not named(on_stand) & named(free)
    assert named(pool.usable(model, experiments, [air, ground])) == named(experiments)


def test_a_robot_that_is_always_bolted_keeps_all_of_its_experiments():
    model = Model("servo_pendulum")
    made = library(model)
    assert pool.usable(model, made, [model.make_robot()]) == made


def test_where_none_is_held_alike_all_are_left(experiments):
    on_stand = [e for e in experiments if e.overrides.get("fixed_base")]
    assert pool.usable(Model("tigrillo"), on_stand, [robot({})]) == on_stand


@pytest.mark.parametrize(("asked", "reason"), [(0.0, ""), (2.0, "pivot meets its torque limit")])
def test_a_spring_is_none_of_the_torque_that_a_drive_is_limited_to(asked, reason):
    spring = SpringParams(kind="linear", stiffness=30.0)
    plant = replace(Model("pendulum").make_robot(), springs={"pivot": spring})
    q = np.linspace(-0.5, 0.5, 11)[:, None]
    log = SimpleNamespace(q=q, dq=0.0 * q, tau=asked - 30.0 * q, fall="",
                          experiment=SimpleNamespace(plant=plant))  # fmt: skip
    assert plant.effort[0] < 15.0
    assert pool.limit_violation(log) == reason


TURNING = """<robot name="r"><link name="base"/>
  <link name="a"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="one" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
  <joint name="two" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 -0.2"/></joint>
</robot>"""  # no limits of speed
POSITION, VELOCITY, TORQUE = (
    "{kind: impedance, kp: 9, kd: 1}",
    "{kind: impedance, kd: 1}",
    "{kind: torque}",
)


@pytest.mark.parametrize("two", [POSITION, VELOCITY, TORQUE])
@pytest.mark.parametrize("one", [POSITION, VELOCITY, TORQUE])
def test_an_experiment_gives_each_drive_the_command_that_it_takes(tmp_path, one, two):
    """Whatever the speeds of the joints are limited to, and of drives of several kinds."""
    (tmp_path / "r.urdf").write_text(TURNING)
    (tmp_path / "robot.yaml").write_text(
        "urdf: r.urdf\njoints: [one, two]\nfixed_base: true\nheight: 1.0\n"
        f"drives: {{one: {one}, two: {two}}}\n"
    )
    model = Model(str(tmp_path))
    (record,) = pool.records(model, [pool.choose(library(model), "chirp_small")], ideal=True)
    told = running.sequence(record, model.make_robot())
    moved = [("q", POSITION), ("dq", VELOCITY), ("tau", TORQUE)]
    for i, drive in enumerate((one, two)):
        assert [bool(np.ptp(getattr(told, key)[:, i])) for key, kind in moved if drive == kind] == [
            True
        ]
