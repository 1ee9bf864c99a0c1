# SPDX-License-Identifier: Apache-2.0
"""Energies of the benches agree with mechanics by hand and are conserved where nothing rubs."""

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot


def released(name, start, overrides, ticks=200):
    """Potential and kinetic energy [J] of a bench that starts at `start`, (ticks, 2)."""
    bench = robot.load(name, overrides)
    with Simulation(robot=bench, standing=np.array([start])) as plant:
        seen = []
        for k in range(ticks):
            plant.step(MotionCommand(k, k * plant.dt, bench.standing, np.zeros(1)))
            seen.append((plant.potential_energy(), plant.kinetic_energy()))
    return np.array(seen)


def test_a_spring_and_its_mass_pass_one_energy_to_and_fro():
    energy = released("spring_mass", 0.1, {"springs.*.damping": 0.0})
    assert np.ptp(energy.sum(axis=1)) < 0.02 * np.ptp(energy[:, 1])


def test_a_mass_on_a_spring_swings_at_its_natural_frequency():
    bench = robot.load("spring_mass", {"springs.*.damping": 0.0})
    with Simulation(robot=bench) as plant:
        path = []
        for k in range(600):
            plant.step(MotionCommand(k, k * plant.dt, bench.standing, np.zeros(1)))
            path.append(plant.true_q[0])
        low = np.flatnonzero(np.diff(np.sign(np.diff(path))) > 0)
        period = np.mean(np.diff(low)) * plant.dt
    assert 2.0 * np.pi / period == pytest.approx(10.0, rel=0.01)


def test_a_damper_only_takes_energy():
    total = released("spring_mass", 0.1, {}).sum(axis=1)
    assert total[-1] < total[0] - 0.1
    assert np.diff(total).max() < 0.005 * total[0]


def test_the_kinetic_energy_of_a_pendulum_is_that_of_the_book():
    bench = robot.load("pendulum")
    inertia = 0.00667 + 0.5 * 0.2**2
    with Simulation(robot=bench, standing=np.array([1.0])) as plant:
        high = plant.potential_energy()
        for k in range(40):
            plant.step(MotionCommand(k, k * plant.dt, bench.standing, np.zeros(1)))
        assert plant.kinetic_energy() == pytest.approx(0.5 * inertia * plant.true_dq[0] ** 2)
        fallen = 0.5 * 9.81 * 0.2 * (np.cos(plant.true_q[0]) - np.cos(1.0))
        assert high - plant.potential_energy() == pytest.approx(fallen, rel=1e-3)


def test_a_direct_drive_gives_the_torque_that_is_asked_for():
    bench = robot.load("pendulum")
    with Simulation(robot=bench) as plant:
        for k in range(300):
            trunk = TrunkTorque(k, 0.0, np.array([0.3]), np.zeros(6), np.zeros(0, dtype=bool))
            state = plant.step(MotionCommand(k, k * plant.dt, np.zeros(1), np.zeros(1)), trunk)
        assert state.tau[0] == pytest.approx(0.3)


def test_an_axis_under_impedance_reaches_its_target():
    bench = robot.load("linear_axis")
    with Simulation(robot=bench) as plant:
        for k in range(250):
            state = plant.step(MotionCommand(k, k * plant.dt, np.array([0.25]), np.zeros(1)))
        assert state.q[0] == pytest.approx(0.25, abs=1e-4)
