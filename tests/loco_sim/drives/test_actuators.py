# SPDX-License-Identifier: Apache-2.0
"""Drives and springs of all joints in one call give what each gives alone."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.drives.actuators import Actuators
from loco_sim.drives.servo_kernels import servo_torque, share
from loco_sim.drives.spring_kernels import spring_torque
from loco_sim.robot import robot

DT = 0.001


def states(q, dq):
    """As the engine gives them."""
    return [float(x) for x in q], [float(x) for x in dq]


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
    tau = drives.torque(*states(q, dq))
    for i, joint in enumerate(tigrillo.joints):
        if joint in tigrillo.drives:
            row = np.array(tigrillo.drives[joint].row(2.6))
            rotor = np.array([tigrillo.standing[i], 0.0])
            asked = share(q[i], tigrillo.standing[i] + 0.3, row)
            alone = servo_torque(q[i], dq[i], asked, row, rotor, DT)
        else:
            alone = spring_torque(q[i], dq[i], np.array(tigrillo.springs[joint].row()))
        assert tau[i] == pytest.approx(alone, abs=1e-12)


def gains(robot, stance):
    """Stiffness and damping of each joint with these feet standing, (n,) each."""
    kp, kd = [], []
    for joint, foot in zip(robot.joints, robot.foot_of, strict=True):
        drive = robot.drives[joint]
        now = (drive.kp, drive.kd) if foot < 0 or stance[foot] else drive.swing
        kp.append(now[0])
        kd.append(now[1])
    return np.array(kp), np.array(kd)


@pytest.mark.parametrize("stance", [[True] * 4, [False] * 4, [True, False, False, True]])
def test_the_torque_is_the_impedance_law_with_the_gains_of_the_stance(stance):
    hyq = robot.load("hyq", {"drives.*_kfe_joint.swing_kd": 1.5, "drives.lf_hfe_joint.swing_kp": 9})
    rng, stance = np.random.default_rng(3), np.array(stance)
    drives = Actuators(hyq, DT)
    drives.reset(np.zeros(12))
    q, dq, target, speed = rng.uniform(-0.1, 0.1, (4, 12))
    tau = rng.uniform(-5.0, 5.0, 12)
    trunk = TrunkTorque(0, 0.0, tau, np.zeros(6), stance)
    assert drives.accept(MotionCommand(0, 0.0, target, speed), trunk)
    kp, kd = gains(hyq, stance)
    law = kp * (target - q) + kd * (speed - dq) + tau  # thesis eq. (4.8), (4.9)
    np.testing.assert_allclose(drives.torque(*states(q, dq)), law, atol=1e-12)


def test_gains_of_hyq_follow_the_stance_of_each_leg():
    kp, kd = (x.reshape(4, 3) for x in gains(robot.load("hyq"), [True, False, False, True]))
    np.testing.assert_array_equal(kp[[0, 3]], [[150.0, 250.0, 150.0]] * 2)
    np.testing.assert_array_equal(kp[[1, 2]], [[150.0, 250.0, 250.0]] * 2)
    np.testing.assert_array_equal(kd[[0, 3]], [[10.0, 8.0, 6.0]] * 2)
    np.testing.assert_array_equal(kd[[1, 2]], [[12.0, 8.0, 6.0]] * 2)


def test_a_reset_drive_holds_the_pose_with_the_gains_of_stance():
    hyq = robot.load("hyq")
    drives, pose = Actuators(hyq, DT), hyq.standing
    swing = TrunkTorque(0, 0.0, np.ones(12), np.zeros(6), np.zeros(4, dtype=bool))
    drives.accept(MotionCommand(0, 0.0, pose + 1.0, pose), swing)
    drives.reset(pose)
    np.testing.assert_allclose(drives.torque(*states(pose, np.zeros(12))), 0.0, atol=1e-12)
    away = drives.torque(*states(pose + 0.01, np.zeros(12)))
    np.testing.assert_allclose(away, -0.01 * np.tile([150.0, 250.0, 150.0], 4))


def test_stance_flags_that_are_not_those_of_the_feet_are_refused():
    hyq = robot.load("hyq")
    drives = Actuators(hyq, DT)
    drives.reset(hyq.standing)
    with pytest.raises(ParameterError, match="has 4 feet, got 0 stance flags"):
        drives.accept(*command(hyq.standing))


def test_gains_that_do_not_differ_ask_nobody_who_stands():
    leg = robot.load("hyq_leg")
    drives = Actuators(leg, DT)
    drives.reset(leg.standing)
    assert drives.accept(*command(leg.standing))


def test_an_impedance_is_clipped_to_the_effort_limit():
    axis = robot.load("linear_axis")
    drives = Actuators(axis, DT)
    drives.reset(np.zeros(1))
    drives.accept(*command([0.01], np.array([3.0])))
    assert drives.torque(*states([0.0], [0.1]))[0] == pytest.approx(2000 * 0.01 - 60 * 0.1 + 3.0)
    drives.accept(*command([0.3]))
    assert drives.torque(*states([0.0], [0.0]))[0] == 60.0


def test_a_direct_drive_ignores_positions():
    pendulum = robot.load("pendulum")
    drives = Actuators(pendulum, DT)
    drives.reset(np.zeros(1))
    drives.accept(*command([9.0], np.array([0.7])))
    assert drives.torque(*states([0.1], [5.0])) == [0.7]


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
    assert drives.torque(*states([0.0], [0.0]))[0] == 0.0


def test_at_rest_the_only_energy_is_in_the_springs():
    tigrillo = robot.load("tigrillo")
    drives = Actuators(tigrillo, DT)
    slack = tigrillo.standing.copy()
    slack[1::2] = tigrillo.springs["lf_kfe_joint"].slack
    drives.reset(slack)
    assert drives.energy(slack) == pytest.approx((0.0, 0.0))
    assert drives.energy(tigrillo.standing)[0] > 0.0
