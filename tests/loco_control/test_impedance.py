# SPDX-License-Identifier: Apache-2.0
"""Impedance law and the limit of its damping."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_control.impedance import ImpedanceParams, gains, impedance_torque, stability_ratio


def test_gains_follow_the_stance_of_each_leg():
    kp, kd = (x.reshape(4, 3) for x in gains(ImpedanceParams(), np.array([1, 0, 0, 1], bool)))
    np.testing.assert_array_equal(kp[[0, 3]], [[150.0, 250.0, 150.0]] * 2)
    np.testing.assert_array_equal(kp[[1, 2]], [[150.0, 250.0, 250.0]] * 2)
    np.testing.assert_array_equal(kd[[0, 3]], [[10.0, 8.0, 6.0]] * 2)
    np.testing.assert_array_equal(kd[[1, 2]], [[12.0, 8.0, 6.0]] * 2)


def test_torque_is_zero_on_the_reference_and_linear_in_the_error():
    rng = np.random.default_rng(0)
    q, dq, e, de, kp, kd, tau = rng.normal(size=(7, 12))
    np.testing.assert_allclose(impedance_torque(q, dq, q, dq, kp, kd), 0.0)
    np.testing.assert_allclose(impedance_torque(q, dq, q, dq, kp, kd, tau), tau)
    one = impedance_torque(q + e, dq + de, q, dq, kp, kd)
    two = impedance_torque(q + 2 * e, dq + 2 * de, q, dq, kp, kd)
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-12)


def test_torque_pulls_back_to_the_reference():
    assert impedance_torque(0.0, 0.0, 0.1, 0.0, 100.0, 5.0) == pytest.approx(-10.0)
    assert impedance_torque(0.0, 0.0, 0.0, 0.1, 100.0, 5.0) == pytest.approx(-0.5)


@pytest.mark.parametrize(("kd", "stable"), [(50.0, True), (54.0, False)])
def test_ratio_of_two_is_where_held_damping_diverges(kd, stable):
    inertia, dt, speed = 0.0262, 1e-3, 1.0  # HyQ's shank about its knee
    for _ in range(2000):
        speed += dt * impedance_torque(0.0, 0.0, 0.0, speed, 0.0, kd) / inertia
    assert (stability_ratio(np.array([kd]), dt, np.array([inertia])) < 2.0) == stable
    assert (abs(speed) < 1.0) == stable


def test_ratio_of_coupled_joints_is_the_spectral_radius():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(5, 5))
    M, kd, dt = A @ A.T + 0.1 * np.eye(5), rng.uniform(1.0, 9.0, 5), 1e-3
    wanted = np.abs(np.linalg.eigvals(dt * np.linalg.solve(M, np.diag(kd)))).max()
    assert stability_ratio(kd, dt, M) == pytest.approx(wanted)
    inertia = rng.uniform(0.1, 1.0, 5)
    assert stability_ratio(kd, dt, np.diag(inertia)) == pytest.approx(
        stability_ratio(kd, dt, inertia)
    )


def test_negative_gain_is_refused():
    with pytest.raises(ParameterError, match=r"swing_kd\[1\]"):
        ImpedanceParams(swing_kd=(10.0, -1.0, 6.0))
