# SPDX-License-Identifier: Apache-2.0
"""Drives whose torque is sampled and held: laws, and the same on every plant."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand
from loco_sim.bolted.loop import Bolted, Segments
from loco_sim.drives.actuators import Actuators
from loco_sim.effects.base import make
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.servo import ImpedanceDrive, ServoParams, TorqueDrive

DT = 0.001
HELD = {"drives.*.torque": "held", "drives.*.period": 0.004}
AVERAGED = {**HELD, "drives.*.torque": "averaged"}
BENCHES = ("hyq_leg", "linear_axis", "servo_pendulum", "pendulum")


def torques(plant, motion, steps=12, tau=None):
    """Torques of a robot's drives along a motion (q, dq of a step), (steps, n)."""
    drives, n = Actuators(plant, DT), len(plant.joints)
    drives.reset(plant.standing)
    if tau is not None:
        drives._command[2] = tau
    given = []
    for k in range(steps):
        q, dq = motion(k)
        given.append(drives.torque(list(q + np.zeros(n)), list(dq + np.zeros(n))))
    return np.array(given)


def moving(plant):
    return lambda k: (plant.standing + 0.001 * k * k, 0.002 * k)


@pytest.mark.parametrize("name", ["hyq_leg", "linear_axis"])
def test_a_held_torque_is_constant_within_a_period_and_that_of_its_sample(name):
    free, held = robot.load(name), robot.load(name, HELD)
    whole, kept = (torques(each, moving(each)) for each in (free, held))
    assert not np.any(np.diff(kept.reshape(3, 4, -1), axis=1))
    np.testing.assert_array_equal(kept[::4], whole[::4])
    assert np.all(whole[1:4] != kept[1:4])


def test_an_averaged_torque_is_the_mean_over_the_period_before():
    free, averaged = robot.load("hyq_leg"), robot.load("hyq_leg", AVERAGED)
    whole, kept = (torques(each, moving(each)) for each in (free, averaged))
    means = whole.reshape(3, 4, -1).mean(axis=1)
    np.testing.assert_allclose(kept[4::4], means[:2], rtol=1e-13)
    np.testing.assert_array_equal(kept[:4], np.tile(whole[:1], (4, 1)))


def test_a_servo_holds_its_share_of_the_voltage_while_its_motor_slows_at_once():
    servo = robot.load("servo_pendulum", {**HELD, "drives.*.rotor_inertia": 0.0})
    drive = servo.drives[servo.joints[0]]
    kept = torques(servo, lambda k: (servo.standing, 0.1 * k))[:, 0]
    slope = drive.stall_torque / drive.no_load_speed
    np.testing.assert_allclose(kept, -slope * 0.1 * np.arange(12), atol=1e-12)
    turned = torques(servo, lambda k: (servo.standing + 0.01 * k, 0.0))[:, 0]
    assert len(np.unique(turned[4:8])) == 1 and turned[3] != turned[4]


def test_a_period_that_is_no_multiple_of_the_step_is_kept_on_average():
    plant = robot.load("hyq_leg", {**HELD, "drives.*.period": 0.0025})
    kept = torques(plant, moving(plant), 20)[:, 0]
    assert np.flatnonzero(np.diff(kept)).tolist() == [2, 4, 7, 9, 12, 14, 17]


@pytest.mark.parametrize("period", [DT, 0.5 * DT])
@pytest.mark.parametrize("name", BENCHES)
def test_with_a_period_of_a_step_it_is_continuous(name, period):
    way = {**HELD, "drives.*.period": period}
    free, kept = robot.load(name), robot.load(name, way)
    extra = np.linspace(0.1, 0.3, len(free.joints))
    np.testing.assert_array_equal(
        torques(free, moving(free), tau=extra), torques(kept, moving(kept), tau=extra)
    )


def test_energy_that_sampling_injects_grows_with_damping():
    """A flywheel whose drive damps it: the continuous one stops it, the held one drives it."""
    rest = []
    for kd in (20.0, 40.0, 60.0, 80.0):
        plant = robot.load("hyq_leg", {**HELD, "drives.*.kp": 0.0, "drives.*.kd": kd})
        drives, speed, inertia = Actuators(plant, DT), 0.01, 0.1
        drives.reset(plant.standing)
        for _ in range(16):
            speed += DT * drives.torque([0.0] * 3, [speed] * 3)[0] / inertia
        rest.append(abs(speed) / 0.01)
    # each period turns v into (1 - kd period / inertia) v
    np.testing.assert_allclose(rest, [(1.0 - 0.04 * kd) ** 4 for kd in (20, 40, 60, 80)], rtol=1e-9)
    assert rest[0] < 1.0 < rest[2] < rest[3]


def test_a_switch_or_a_lower_limit_acts_at_once():
    plant = robot.load("hyq_leg", HELD)
    drives = Actuators(plant, DT)
    drives.reset(plant.standing)
    pose, still = (plant.standing + 0.1).tolist(), [0.0] * 3
    assert np.all(np.abs(drives.torque(pose, still)) > 1.0)
    drives.limit(np.full(3, 0.5))
    assert np.abs(drives.torque(pose, still)).max() == 0.5
    drives.on = 0.0
    assert not np.any(drives.torque(pose, still))


def commanded(plant, rows=100):
    t = np.arange(rows) * 0.004
    wave = np.sin(2.0 * np.pi * np.outer(t, 1.0 + 0.3 * np.arange(len(plant.joints))))
    return plant.standing + 0.2 * wave, 0.1 * wave


def driven(plant, engine, told, effects=(), compiled=True):
    params = plant.sim.replace(engine=engine)
    with Simulation(params, effects, dt=0.004, robot=plant) as sim:
        if not compiled:
            sim._slow_reason = "a test"
        rows, state = [], sim.reset()
        for k, (q, dq) in enumerate(zip(*told, strict=True)):
            rows.append(np.concatenate([state.q, state.dq, state.tau]))
            state = sim.step(MotionCommand(k, 0.004 * k, q, dq))
        return np.array(rows)


@pytest.mark.parametrize("way", [HELD, AVERAGED, {**HELD, "drives.*.period": 0.006}])
@pytest.mark.parametrize("name", ["hyq_leg", "servo_pendulum"])
def test_every_plant_holds_alike(name, way):
    plant = robot.load(name, way)
    plant = dataclasses.replace(plant, sensors=None)
    told = commanded(plant)
    bolted = np.concatenate(Bolted(plant, dt=0.004).run(*told), axis=1)
    step_by_step = driven(plant, "mujoco", told, compiled=False)
    np.testing.assert_array_equal(driven(plant, "mujoco", told), step_by_step)
    np.testing.assert_allclose(driven(plant, "pybullet", told), bolted, rtol=0.0, atol=1e-6)
    n = len(plant.joints)  # MuJoCo differs as much from the others with continuous torques
    np.testing.assert_allclose(step_by_step[:, :n], bolted[:, :n], rtol=0.0, atol=1e-4)
    free = dataclasses.replace(robot.load(name), sensors=None)
    far = np.concatenate(Bolted(free, dt=0.004).run(*told), axis=1)
    assert np.abs(far - bolted).max() > 0.01


def test_pieces_that_begin_between_samples_meet_the_next_one():
    plant = robot.load("hyq_leg", {**HELD, "drives.*.period": 0.016})
    q, dq = commanded(plant, 40)
    machine = Bolted(plant, dt=0.004)
    whole = machine.run(q, dq)
    first = 18  # a sample is due at 20
    start = np.array([[whole.q[first], whole.dq[first], np.zeros(len(plant.joints))]])
    piece = machine.run(q, dq, segments=Segments(np.array([[first, 40]]), start))
    jumps = np.abs(np.diff(piece.tau[first + 1 :, 0]))
    assert np.all(jumps[[1, 5, 9]] > 1e-6) and np.all(jumps[[0, 2, 3, 4, 6, 7, 8]] < 1e-9)


def test_damping_that_is_held_is_not_solved_with_the_step():
    """Continuous, any damping stops a joint; held for 4 ms, much of it shakes it."""
    energy = []
    for way in ({}, HELD):
        plant = robot.load("hyq_leg", {"drives.*.kd": 200.0, **way})
        told = plant.standing + np.zeros((50, 3)), np.zeros((50, 3))
        energy.append(np.square(driven(plant, "mujoco", told)[25:, 3:6]).sum())
    assert energy[0] < 1e-2 < 1.0 < energy[1]


def test_effects_on_a_drive_act_on_what_it_holds():
    plant = robot.load("hyq_leg", HELD)
    told = commanded(plant)
    weak = [make("torque_limit", reduction=0.95)]
    rows = driven(plant, "mujoco", told, weak)
    assert np.abs(rows[:, 6:]).max() <= 0.05 * plant.effort.max() + 1e-9
    late = driven(plant, "pybullet", told, [make("actuation_delay", delay=0.004)])
    bolted = Bolted(plant, [make("actuation_delay", delay=0.004)], dt=0.004).run(*told)
    np.testing.assert_allclose(late[:, :3], bolted.q, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("kind", [ImpedanceDrive, ServoParams, TorqueDrive])
@pytest.mark.parametrize("torque", ["held", "averaged"])
def test_a_sampled_drive_needs_a_period(kind, torque):
    with pytest.raises(ParameterError, match=rf"{torque} needs a period above 0 s, got 0"):
        kind(torque=torque)


@pytest.mark.parametrize("rate", [250.0, 100.0])
def test_in_robot_yaml_the_default_period_is_the_control_period(rate):
    way = {"drives.*.torque": "held", "control_rate": rate}
    plant = robot.load("hyq_leg", way)
    assert {drive.period for drive in plant.drives.values()} == {1.0 / rate}
    assert {d.period for d in robot.load("hyq_leg", {**way, **HELD}).drives.values()} == {0.004}
    assert {d.period for d in robot.load("hyq_leg").drives.values()} == {0.0}
    with pytest.raises(ParameterError, match="needs a period above 0 s, got 0"):
        robot.load("hyq_leg", {**way, "drives.*.period": 0.0})


@pytest.mark.parametrize("period", [0.003, 0.004])
def test_the_effect_that_holds_torques_is_a_drive_that_holds_them(period):
    plant = robot.load("hyq_leg", {"sim.implicit_damping": False})
    other = robot.load("hyq_leg", {**HELD, "drives.*.period": period})
    told, effect = commanded(plant), [make("torque_hold", period=period)]
    np.testing.assert_array_equal(
        np.array(Bolted(plant, effect, dt=0.004).run(*told)),
        np.array(Bolted(other, dt=0.004).run(*told)),
    )
    for engine in ("mujoco", "pybullet"):
        one, two = driven(plant, engine, told, effect), driven(other, engine, told)
        np.testing.assert_array_equal(one, two)
