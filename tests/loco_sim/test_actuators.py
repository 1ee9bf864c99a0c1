# SPDX-License-Identifier: Apache-2.0
"""Drives and springs of all joints in one call give what each gives alone."""

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import robot
from loco_sim.actuators import Actuators
from loco_sim.servo_kernels import servo_torque
from loco_sim.spring_kernels import spring_torque

DT = 0.001


def states(q, dq):
    """As the engine gives them."""
    return tuple((float(x), float(v), (), 0.0) for x, v in zip(q, dq, strict=True))


def command(q, tau=None):
    n, tick = len(q), 0
    tau = np.zeros(n) if tau is None else tau
    trunk = TrunkTorque(tick, 0.0, tau, np.zeros(6), np.zeros(0, dtype=bool))
    return MotionCommand(tick, 0.0, np.array(q, dtype=float), np.zeros(n)), trunk


def test_every_joint_gets_the_torque_of_its_own_drive_or_spring():
    tigrillo = robot.load("tigrillo")
    drives = Actuators(tigrillo, DT)
    drives.reset(tigrillo.standing)
    q, dq = tigrillo.standing + 0.1, np.linspace(-1.0, 1.0, 8)
    assert drives.accept(*command(tigrillo.standing + 0.3))
    tau = drives.torque(states(q, dq))
    for i, joint in enumerate(tigrillo.joints):
        if joint in tigrillo.drives:
            row = np.array(tigrillo.drives[joint].row(2.6))
            rotor = np.array([tigrillo.standing[i], 0.0])
            alone = servo_torque(q[i], dq[i], tigrillo.standing[i] + 0.3, row, rotor, DT)
        else:
            alone = spring_torque(q[i], dq[i], np.array(tigrillo.springs[joint].row()))
        assert tau[i] == pytest.approx(alone, abs=1e-12)


def test_an_impedance_is_clipped_to_the_effort_limit():
    axis = robot.load("linear_axis")
    drives = Actuators(axis, DT)
    drives.reset(np.zeros(1))
    drives.accept(*command([0.01], np.array([3.0])))
    assert drives.torque(states([0.0], [0.1]))[0] == pytest.approx(2000 * 0.01 - 60 * 0.1 + 3.0)
    drives.accept(*command([0.3]))
    assert drives.torque(states([0.0], [0.0]))[0] == 60.0


def test_a_direct_drive_ignores_positions():
    pendulum = robot.load("pendulum")
    drives = Actuators(pendulum, DT)
    drives.reset(np.zeros(1))
    drives.accept(*command([9.0], np.array([0.7])))
    assert drives.torque(states([0.1], [5.0])) == [0.7]


def test_a_command_that_is_not_finite_changes_nothing():
    servo = robot.load("servo_pendulum")
    drives = Actuators(servo, DT)
    drives.reset(np.zeros(1))
    assert drives.accept(*command([0.2]))
    assert not drives.accept(*command([np.nan]))
    assert drives.q[0] == 0.2


def test_a_late_reference_is_followed_instead_of_the_command():
    servo = robot.load("servo_pendulum")
    drives = Actuators(servo, DT)
    drives.reset(np.zeros(1))
    drives.accept(*command([0.5]))
    drives.follow(np.zeros(1), np.zeros(1))
    assert drives.torque(states([0.0], [0.0]))[0] == 0.0


def test_at_rest_the_only_energy_is_in_the_springs():
    tigrillo = robot.load("tigrillo")
    drives = Actuators(tigrillo, DT)
    slack = tigrillo.standing.copy()
    slack[1::2] = tigrillo.springs["lf_kfe_joint"].slack
    drives.reset(slack)
    assert drives.energy(slack) == pytest.approx((0.0, 0.0))
    assert drives.energy(tigrillo.standing)[0] > 0.0
