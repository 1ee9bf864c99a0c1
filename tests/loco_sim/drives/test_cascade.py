# SPDX-License-Identifier: Apache-2.0
"""Loops with integrators, cascades and motors without a loop: laws, and the same on every plant."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.bolted.loop import Bolted, Segments
from loco_sim.drives.actuators import Actuators
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot
from loco_sim.robot.description import Description
from loco_sim.robot.servo import ImpedanceDrive

DT = 0.001
LAWS = {
    "pid": {"ki": 4000.0},
    "cascade": {"kp": 0.0, "position_gain": 30.0, "speed_ki": 900.0, "speed_feed": 0.0},
    "held cascade": {"kp": 0.0, "position_gain": 30.0, "speed_ki": 900.0, "torque": "held",
                     "period": 0.002},
    "averaged": {"ki": 4000.0, "integral_limit": 3.0, "torque": "averaged", "period": 0.002},
}  # fmt: skip


def axis(**drive):
    """The linear axis with another drive."""
    plant = robot.load("linear_axis", {f"drives.*.{key}": value for key, value in drive.items()})
    return dataclasses.replace(plant, sensors=None)


def along(plant, motion, target=0.0, speed=0.0):
    """Torques of a drive along positions and velocities [(q, dq), ...], with a command held."""
    drives = Actuators(plant, DT)
    drives.reset(np.zeros(1))
    one = np.zeros(1)
    trunk = TrunkTorque(0, 0.0, one, np.zeros(6), np.zeros(0, dtype=bool))
    assert drives.accept(MotionCommand(0, 0.0, one + target, one + speed), trunk)
    return np.array([drives.torque([q], [dq])[0] for q, dq in motion])


def test_a_cascade_is_the_law_of_p_around_pi():
    plant = axis(kp=0.0, kd=45.0, speed_ki=180.0, position_gain=20.0, speed_feed=0.0)
    rng = np.random.default_rng(2)
    motion, total, law = rng.uniform(-0.01, 0.01, (40, 2)), 0.0, []
    for q, dq in motion:
        error = 20.0 * (0.02 - q) - dq
        law.append(45.0 * error + 180.0 * total)
        total += error * DT
    np.testing.assert_allclose(along(plant, motion, 0.02, 5.0), law, rtol=1e-12)


def test_an_integrator_stops_at_its_limit_and_comes_back_at_once():
    plant = axis(kp=0.0, kd=0.0, ki=1000.0, integral_limit=2.0)
    tau = along(plant, [(-0.5, 0.0)] * 20 + [(0.5, 0.0)] * 4)
    np.testing.assert_allclose(tau[:4], [0.0, 0.5, 1.0, 1.5], atol=1e-12)
    np.testing.assert_allclose(tau[4:21], 2.0)
    np.testing.assert_allclose(tau[21:], [1.5, 1.0, 0.5], atol=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_does_not_wind_up_while_the_torque_is_limited(side):
    plant = axis(kp=1000.0, kd=0.0, ki=5000.0)
    limit = plant.effort[0]
    motion = [(-side, 0.0)] * 200 + [(0.0, 0.0)] * 2
    tau = along(plant, motion)
    np.testing.assert_allclose(tau[:200], side * limit)
    assert abs(tau[-1]) < 1e-9  # nothing was gathered
    half = along(plant, [(-0.01 * side, 0.0)] * 100 + [(0.0, 0.0)])
    assert half[-1] == pytest.approx(side * 5000.0 * 0.01 * 0.1)


def test_a_drive_that_is_off_gathers_nothing():
    plant = axis(kp=0.0, kd=0.0, ki=1000.0)
    drives = Actuators(plant, DT)
    drives.reset(np.ones(1))
    drives.on = 0.0
    for _ in range(50):
        drives.torque([0.0], [0.0])
    drives.on = 1.0
    assert drives.torque([0.0], [0.0]) == [0.0]


@pytest.mark.parametrize("law", LAWS)
def test_every_plant_has_the_same_loop(law):
    plant = axis(**LAWS[law])
    t = np.arange(120) * 0.004
    q, dq = 0.05 * np.sin(6.0 * t)[:, None], 0.3 * np.cos(6.0 * t)[:, None]
    runs = []
    for engine, compiled in (("mujoco", True), ("mujoco", False), ("pybullet", False)):
        params = plant.sim.replace(engine=engine)
        with Simulation(params, dt=0.004, robot=plant) as sim:
            if not compiled:
                sim._slow_reason = "a test"
            state, rows = sim.reset(), []
            for k in range(len(t)):
                rows.append([*state.q, *state.dq, *state.tau])
                state = sim.step(MotionCommand(k, t[k], q[k], dq[k]))
            runs.append(np.array(rows))
    bolted = np.concatenate(Bolted(plant, dt=0.004).run(q, dq), axis=1)
    np.testing.assert_array_equal(runs[0], runs[1])
    np.testing.assert_allclose(runs[2], bolted, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(runs[0][:, 0], bolted[:, 0], rtol=0.0, atol=1e-4)


def test_an_integrator_is_the_same_where_damping_is_solved_with_the_step():
    """Too much damping to be held, so that the engine solves it: against a tenth of the step."""
    ends = []
    for rate, implicit in ((1000.0, True), (10000.0, False)):
        plant = robot.load("hyq_leg", {"drives.*.kd": 90.0, "drives.*.ki": 600.0,
                                       "sim.physics_rate": rate,
                                       "sim.implicit_damping": implicit})  # fmt: skip
        with Simulation(plant.sim, dt=0.004, robot=plant) as sim:
            sim.reset()
            goal = plant.standing + 0.1
            for k in range(250):
                state = sim.step(MotionCommand(k, 0.004 * k, goal, np.zeros(3)))
            ends.append(state.q - goal)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.01)  # of first order in the step
    assert np.all(np.abs(ends[0]) < 0.05)


def test_an_integrator_takes_away_what_weight_leaves():
    errors = []
    for ki in (0.0, 500.0):
        plant = robot.load("hyq_leg", {"drives.*.ki": ki})
        told = np.tile(plant.standing, (1500, 1))
        errors.append(np.abs(Bolted(plant, dt=0.004).run(told).q[-1] - plant.standing).max())
    assert errors[0] > 5e-3 and errors[1] < 1e-3 * errors[0]


def test_a_motor_that_is_told_a_voltage_runs_at_a_speed():
    """Torque at rest per volt, and what its own speed takes away."""
    plant = robot.load("pendulum", {"drives.*.gain": 0.5, "drives.*.slope": 0.25,
                                    "sim.gravity": 0.0})  # fmt: skip
    volts = np.full((3000, 1), 0.2)
    run = Bolted(plant, dt=1.0 / plant.control_rate).run(np.zeros((3000, 1)), None, volts)
    slope = 0.25 + Description(plant.urdf).damping(plant.joints[0])
    assert run.dq[-1, 0] == pytest.approx(0.5 * 0.2 / slope, rel=1e-3)
    assert plant.damping[0] == 0.25


@pytest.mark.parametrize(
    ("drive", "command"),
    [({"kp": 3.0, "kd": 1.0}, "position"), ({"kd": 1.0}, "velocity"), ({}, "position"),
     ({"kd": 1.0, "position_gain": 2.0}, "position"), ({"speed_ki": 1.0}, "velocity")],
)  # fmt: skip
def test_a_loop_without_a_gain_on_the_position_follows_velocities(drive, command):
    assert ImpedanceDrive(**drive).command == command


@pytest.mark.parametrize("engine", ["bolted", "mujoco"])
def test_an_integrator_that_holds_the_weight_keeps_the_robot_still(engine):
    """Begun with the torque that the weight needs, no joint sags, at once and without a rest."""
    gains = {f"drives.*.{key}": value for key, value in {"kp": 60.0, "kd": 6.0, "ki": 90.0}.items()}
    plant = dataclasses.replace(
        robot.load("hyq_leg", {**gains, "sim.engine": "mujoco"}), sensors=None
    )
    q, none = plant.standing, np.zeros(len(plant.joints))
    machine = Bolted(plant)
    weight = machine.needed(q[None], none[None], none[None])[1][0] @ machine.gravity
    moved = []
    for integral in (weight, none):
        if engine == "bolted":
            told = np.tile(q, (50, 1))
            start = Segments(np.array([[0, 50]]), np.array([[q, none, integral]]))
            moved.append(np.ptp(machine.run(told, segments=start).q, axis=0).max())
        else:
            with Simulation(None, (), 0, None, plant) as sim:
                sim.place(q, none, integral=integral)
                states = [sim.step(MotionCommand(k, 0.0, q, none)).q for k in range(50)]
            moved.append(np.ptp(states, axis=0).max())
    assert moved[0] < 1e-4 < 1e-2 < moved[1]
