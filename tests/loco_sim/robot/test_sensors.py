# SPDX-License-Identifier: Apache-2.0
"""Sensors hide the truth by their step, noise and rate, the same way for the same seed."""

import numpy as np
import pytest

from loco_control.types import MotionCommand
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot

KNEES = [1, 3, 5, 7]


def run(seed=0, ticks=60, **overrides):
    loaded = robot.load("tigrillo", {f"sensors.{k}": v for k, v in overrides.items()})
    said, true, counts = [], [], []
    with Simulation(robot=loaded, seed=seed) as plant:
        for k in range(ticks):
            q = loaded.standing + 0.3 * np.sin(0.06 * k)
            said.append(plant.step(MotionCommand(k, k * plant.dt, q, np.zeros(8))))
            true.append(plant.true_q)
            counts.append(plant.adc())
    return said, np.array(true), np.array(counts)


def test_hips_are_read_in_steps_of_the_encoder():
    said, true, _ = run()
    hips = np.array([state.q[0::2] for state in said])
    np.testing.assert_allclose(hips / 0.00506, np.round(hips / 0.00506), atol=1e-9)
    assert np.abs(hips - true[:, 0::2]).max() <= 0.5 * 0.00506 + 1e-12


def test_knees_are_read_from_the_counts():
    said, true, counts = run()
    assert counts.shape == (60, 4)
    assert counts.min() > 0
    knees = np.array([state.q[KNEES] for state in said])
    assert 0.0 < np.abs(knees - true[:, KNEES]).max() < 0.05


def test_velocities_are_differences_of_readings():
    said, _, _ = run()
    for before, after in zip(said[:-1], said[1:], strict=True):
        np.testing.assert_allclose(after.dq, (after.q - before.q) / 0.01, atol=1e-9)


def test_noise_depends_on_the_seed_and_on_nothing_else():
    first, again, other = (run(seed)[0] for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        assert a.q.tobytes() == b.q.tobytes()
        assert a.angular_velocity.tobytes() == b.angular_velocity.tobytes()
    assert any(np.any(a.q != b.q) for a, b in zip(first, other, strict=True))


def test_sensors_do_not_move_the_robot():
    np.testing.assert_array_equal(run(1)[1], run(2, **{"hall.noise": 20.0})[1])


def test_between_two_readings_the_last_one_is_held():
    said, _, _ = run(rate=20.0)
    knees = np.array([state.q for state in said])
    changes = np.flatnonzero(np.any(np.diff(knees, axis=0) != 0.0, axis=1))
    assert set(np.diff(changes)) <= {5, 10, 15}
    assert [state.tick for state in said] == list(range(1, 61))


def test_the_robot_of_the_controllers_measures_the_truth(plant, commands):
    hyq = plant()
    state = hyq.step(*commands(0))
    np.testing.assert_array_equal(state.q, hyq.true_q)
    np.testing.assert_array_equal(state.dq, hyq.true_dq)
    assert hyq.adc().size == 0


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_imu_has_the_noise_asked_for(noise):
    ideal, noisy = (
        np.array([state.angular_velocity for state in run(3, **{"imu.gyro_noise": value})[0]])
        for value in (0.0, noise)
    )
    assert np.std(noisy - ideal) == pytest.approx(noise, rel=0.2)
