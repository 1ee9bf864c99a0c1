# SPDX-License-Identifier: Apache-2.0
"""The torque loop is the impedance law within limits, and knows when it is stable."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.impedance import ImpedanceParams, gains, impedance_torque
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.drive import Drive, limited, substeps
from loco_sim.params import SimParams

LIMITS = np.full(12, 150.0)


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def command_of(rng, stance):
    command = MotionCommand(0, 0.0, rng.uniform(-0.1, 0.1, 12), rng.uniform(-1.0, 1.0, 12))
    return command, TrunkTorque(0, 0.0, rng.uniform(-5.0, 5.0, 12), np.zeros(6), np.array(stance))


def joints_of(q, dq):
    return tuple((a, b, (), 0.0) for a, b in zip(q.tolist(), dq.tolist(), strict=True))


@pytest.mark.parametrize("stance", [[True] * 4, [False] * 4, [True, False, False, True]])
def test_the_torque_is_the_impedance_law_with_the_gains_of_the_stance(rng, stance):
    params = ImpedanceParams(swing_kp=(10, 20, 30), stance_kd=(1, 2, 3))
    drive = Drive(params, LIMITS, 4)
    drive.reset(np.zeros(12))
    command, trunk = command_of(rng, stance)
    assert drive.accept(command, trunk)
    q, dq = rng.uniform(-0.1, 0.1, 12), rng.uniform(-1.0, 1.0, 12)
    kp, kd = gains(params, trunk.stance)
    law = impedance_torque(command.q, command.dq, q, dq, kp, kd, trunk.tau)
    np.testing.assert_allclose(drive.torque(joints_of(q, dq)), law, atol=1e-12)


def test_a_reset_drive_holds_the_pose(rng):
    drive, pose = Drive(ImpedanceParams(), LIMITS, 4), rng.uniform(-1.0, 1.0, 12)
    drive.accept(*command_of(rng, [False] * 4))
    drive.reset(pose)
    np.testing.assert_allclose(drive.torque(joints_of(pose, np.zeros(12))), 0.0, atol=1e-12)
    away = drive.torque(joints_of(pose + 0.01, np.zeros(12)))
    np.testing.assert_allclose(away, -0.01 * np.tile([150.0, 250.0, 150.0], 4))


def test_a_command_that_is_not_finite_changes_nothing(rng):
    drive = Drive(ImpedanceParams(), LIMITS, 4)
    drive.reset(np.zeros(12))
    drive.accept(*command_of(rng, [True] * 4))
    joints = joints_of(np.zeros(12), np.zeros(12))
    before = drive.torque(joints)
    for bad in (np.nan, np.inf, -np.inf):
        for field in ("q", "dq"):
            command, trunk = command_of(rng, [False] * 4)
            getattr(command, field)[5] = bad
            assert not drive.accept(command, trunk)
        command, trunk = command_of(rng, [False] * 4)
        trunk.tau[0] = bad
        assert not drive.accept(command, trunk)
    assert drive.torque(joints) == before


def test_torques_stay_within_each_joints_limit(rng):
    limits = rng.uniform(1.0, 3.0, 12)
    drive = Drive(ImpedanceParams(), limits, 4)
    drive.reset(np.zeros(12))
    drive.follow(rng.uniform(-9.0, 9.0, 12), np.zeros(12))
    tau = np.array(drive.torque(joints_of(np.zeros(12), np.zeros(12))))
    np.testing.assert_allclose(np.abs(tau), limits)
    assert set(np.sign(tau)) == {-1.0, 1.0}


def test_limiting_leaves_small_torques_alone():
    assert limited([1.0, -2.0, 9.0, -9.0], [3.0] * 4) == [1.0, -2.0, 3.0, -3.0]


def damped(kd, dt=0.001, **params):
    impedance = ImpedanceParams(swing_kd=(kd, kd, kd), stance_kd=(kd, kd, kd))
    inertia = 0.02 * np.eye(12)
    return substeps(impedance, inertia, np.zeros(12), 4, dt, SimParams(**params))


def test_small_damping_needs_no_substeps():
    assert damped(10.0) == 1  # kd dt / I = 0.5


def test_substeps_keep_the_ratio_below_the_limit():
    for kd in (11.0, 30.0, 77.0, 150.0):
        count = damped(kd)
        assert kd * 0.001 / count / 0.02 <= 0.5 + 1e-9
        assert kd * 0.001 / (count - 1) / 0.02 > 0.5
    assert damped(30.0, damping_limit=1.5) == 1


def test_passive_damping_counts_as_well():
    args = (ImpedanceParams(), 0.02 * np.eye(12))
    assert substeps(*args, np.full(12, 100.0), 4, 0.001, SimParams()) > 10


def test_damping_beyond_reach_is_refused_with_the_way_out():
    with pytest.raises(ParameterError, match="max_substeps = 20.*lower kd"):
        damped(1000.0)
    assert damped(1000.0, max_substeps=200) == 100
