# SPDX-License-Identifier: Apache-2.0
"""Damping that is solved with the step: stable however large, and the torque that is told acted."""

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand
from loco_sim.effects.base import make
from loco_sim.params import SimParams
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.world.world import Base, make_world

LEGS = ("*_haa_joint", "*_hfe_joint", "*_kfe_joint")


def damped_hyq(kd, kp=300.0):
    gains = {"kp": kp, "kd": kd, "swing_kp": kp, "swing_kd": kd}
    return robot.load(
        "hyq", {f"drives.{joint}.{key}": value for joint in LEGS for key, value in gains.items()}
    )


def plant_of(robot, engine, dt=None, effects=(), **params):
    return Simulation(robot.sim.replace(engine=engine, **params), effects, dt=dt, robot=robot)


def stepping(k, robot):
    wave = np.sin(0.04 * k) * np.tile([0.0, 0.1, -0.2], 4) * np.repeat([1, -1, -1, 1], 3)
    return MotionCommand(k, 0.004 * k, robot.standing + wave, np.zeros(12))


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize(("gain", "passive"), [(30.0, 0.0), (1000.0, 0.0), (0.0, 1000.0)])
def test_energy_never_grows_by_damping(hyq, engine, fixed, gain, passive):
    """Drives and springs that only damp, on a robot that swings its legs and touches nothing."""
    bench = dataclasses.replace(hyq, fixed_base=fixed)
    world = make_world(bench, SimParams(engine=engine, gravity=0.0), 0.001)
    world.damped = True
    world.rebuild(hyq.standing, height=5.0)
    rng = np.random.default_rng(3)
    turning = () if fixed else ((0.3, -0.2, 0.0), (0.3, 0.2, -0.4))
    base = Base((0.0, 0.0, 5.0), (0.0, 0.0, 0.0, 1.0), *turning)
    world.put(hyq.standing, rng.uniform(-6.0, 6.0, 12), base)
    law = np.zeros((4, 12))
    law[1], law[2], law[3] = gain, np.inf if gain else 0.0, passive
    energy, work = [world.energy()[1]], []
    for _ in range(150):
        drive, speed = world.damped_step([0.0] * 12, law)
        work.append((drive - passive * speed) @ np.array(world.joint_states()[1]))
        energy.append(world.energy()[1])
    world.close()
    assert max(work) <= 0.0
    assert np.diff(energy).max() < 1e-7 * energy[0]  # of a body that only turns, by rounding
    legs = 0.01 if fixed else 0.6  # a free body keeps its momentum
    assert energy[-1] < legs * energy[0]


@pytest.mark.parametrize("kd", [60.0, 1000.0])
def test_it_is_what_fine_steps_find(engine, kd):
    """On the ground: the same motion and torque as with damping held over hundredths of a step."""
    bench, seen = damped_hyq(kd), []
    for way in ({}, {"implicit_damping": False, "max_substeps": 1000}):
        with plant_of(bench, engine, **way) as plant:
            ratio = 0.001 / plant.physics_dt
            states = [plant.step(stepping(k, bench)) for k in range(25)]
            seen.append((plant.true_q, np.mean([state.tau for state in states[5:]], axis=0)))
    assert ratio > 5.0
    moved = np.abs(seen[1][0] - bench.standing).max()
    np.testing.assert_allclose(seen[0][0], seen[1][0], atol=0.03 * moved)
    np.testing.assert_allclose(seen[0][1], seen[1][1], atol=0.03 * np.abs(seen[1][1]).max())


def test_it_needs_no_sub_steps(engine):
    with plant_of(damped_hyq(1000.0), engine) as plant:
        assert plant.physics_dt == pytest.approx(0.001)
        for k in range(50):
            plant.step(stepping(k, plant.robot))
        assert plant.fallen is None


def test_the_torque_told_is_the_one_that_moved_the_joint(engine):
    """Mass times acceleration of a sledge on a rail is the torque of its drive less friction."""
    bench = robot.load("linear_axis", {"drives.slide.kd": 20000.0, "sim.physics_rate": 1000})
    with plant_of(bench, engine, dt=0.001) as plant:
        mass = plant._world.joint_inertia([0.0])[0, 0]
        speed, found = plant.true_dq, []
        for k in range(40):
            state = plant.step(MotionCommand(k, 0.0, np.array([0.2]), np.array([0.5])))
            moved = mass * (plant.true_dq - speed) / 0.001 + 1.0 * plant.true_dq
            found.append((state.tau[0], moved[0]))
            speed = plant.true_dq
    told, moved = np.array(found).T
    assert np.abs(told).max() > 5.0
    np.testing.assert_allclose(told, moved, rtol=1e-6, atol=1e-6 * np.abs(told).max())


def test_drives_keep_to_their_limits(engine):
    """A step of a target that asks for ten times the effort, against large damping."""
    bench = damped_hyq(300.0, kp=5000.0)
    with plant_of(bench, engine) as plant:
        told = [
            plant.step(MotionCommand(k, 0.004 * k, bench.standing + 0.4, np.zeros(12))).tau
            for k in range(20)
        ]
    share = np.abs(told) / bench.effort
    assert share.max() == pytest.approx(1.0)
    assert share.max() <= 1.0 + 1e-12


def test_small_damping_is_held_as_before(engine, as_bytes, hyq):
    seen = []
    for on in (True, False):
        with plant_of(hyq, engine, implicit_damping=on) as plant:
            seen.append(as_bytes([plant.step(stepping(k, hyq)) for k in range(10)]))
    assert seen[0] == seen[1]


def test_an_effect_on_the_torque_has_sub_steps_as_before(engine):
    lag = make("actuator_lag", time=0.005)
    with plant_of(damped_hyq(100.0), engine, effects=[lag]) as plant:
        assert plant.physics_dt < 0.0002
    off = make("actuator_lag", time=0.0)
    with plant_of(damped_hyq(100.0), engine, effects=[off]) as plant:
        assert plant.physics_dt == pytest.approx(0.001)
    with pytest.raises(
        ParameterError, match="max_substeps = 20.*sim.implicit_damping is on and no"
    ):
        plant_of(damped_hyq(1000.0), engine, effects=[lag])
