# SPDX-License-Identifier: Apache-2.0
"""A servo obeys its torque-speed line, reaches its target and takes no finer commands."""

import numpy as np
import pytest

from loco_sim.drives.servo_kernels import rounded, servo_torque, share
from loco_sim.robot.servo import ServoParams

RX24F = ServoParams(resolution=0.00506, rotor_inertia=0.003, gear_stiffness=30.0)
EFFORT, DT = 2.6, 1e-3


def row(params=RX24F, effort=EFFORT, **changes):
    return np.array(params.replace(**changes).row(effort))


def turn(servo, target, seconds, inertia=2e-4, load=0.0, dt=DT):
    """Joint positions and speeds of a free inertia [kg·m²] on the servo, semi-implicit Euler."""
    q = dq = 0.0
    rotor, path = np.zeros(2), []
    for _ in range(round(seconds / dt)):
        dq += dt * (servo_torque(q, dq, share(q, target, servo), servo, rotor, dt) + load) / inertia
        q += dt * dq
        path.append((q, dq))
    return np.array(path)


@pytest.mark.parametrize("rotor_inertia", [0.0, 0.003])
def test_held_fast_it_gives_its_stall_torque(rotor_inertia):
    servo, rotor = row(rotor_inertia=rotor_inertia), np.zeros(2)
    for _ in range(3000):
        tau = servo_torque(0.0, 0.0, share(0.0, 3.0, servo), servo, rotor, DT)
    assert tau == pytest.approx(2.6, rel=1e-3)


def test_free_it_runs_at_its_no_load_speed():
    speed = turn(row(), 1e3, 1.0)[-1, 1]
    assert speed == pytest.approx(13.2, rel=1e-3)


def test_half_the_speed_leaves_half_the_torque():
    speed = turn(row(), 1e3, 2.0, load=-1.3)[-1, 1]
    assert speed == pytest.approx(6.6, rel=1e-3)


def test_it_settles_within_a_step_of_its_encoder():
    q = turn(row(), 0.7, 2.0)[:, 0]
    assert abs(q[-1] - 0.7) < 0.00506
    assert q.max() < 0.9


def test_under_load_it_yields_by_load_over_stiffness():
    yielded = 0.5 - turn(row(resolution=0.0), 0.5, 3.0, load=-0.1)[-1, 0]
    loop, gear = 0.1 / (6.2 * 2.6), 0.1 / 30.0
    # The loop measures the joint, so what the gear gives is made up for.
    assert yielded == pytest.approx(loop, rel=0.02)
    assert yielded < loop + gear


def test_commands_within_a_step_of_the_encoder_are_the_same_command():
    path = [turn(row(), target, 0.3) for target in (0.5059, 0.5061, 0.5099)]
    np.testing.assert_array_equal(path[0], path[1])
    assert np.any(path[1] != path[2])


def test_the_motion_does_not_depend_on_the_step():
    coarse, fine = (turn(row(resolution=0.0), 0.7, 0.3, dt=dt)[-1, 0] for dt in (1e-3, 1e-4))
    assert coarse == pytest.approx(fine, abs=0.002)


@pytest.mark.parametrize("step", [0.0, 0.25])
def test_rounding_moves_by_at_most_half_a_step(step):
    for x in np.linspace(-1.0, 1.0, 41):
        assert abs(rounded(x, step) - x) <= 0.5 * step + 1e-12
