# SPDX-License-Identifier: Apache-2.0
"""The limit of damping that is held over a step, and the steps that keep below it."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_sim.drives.servo_kernels import MEMORY, impedance_torque
from loco_sim.drives.stability import stability_ratio, substeps
from loco_sim.params import SimParams
from loco_sim.robot.servo import ImpedanceDrive


@pytest.mark.parametrize(("kd", "stable"), [(50.0, True), (54.0, False)])
def test_ratio_of_two_is_where_held_damping_diverges(kd, stable):
    inertia, dt, speed = 0.0262, 1e-3, 1.0  # HyQ's shank about its knee
    row, command, memory = (
        np.array(ImpedanceDrive(kd=kd).row(np.inf)),
        np.zeros(4),
        np.zeros(MEMORY),
    )
    for _ in range(2000):
        speed += dt * impedance_torque(0.0, speed, command, row, memory, dt) / inertia
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


def damped(kd, dt=0.001, **params):
    return substeps(np.full(12, kd), 0.02 * np.eye(12), dt, SimParams(**params))


def test_small_damping_needs_no_substeps():
    assert damped(10.0) == 1  # kd dt / I = 0.5


def test_substeps_keep_the_ratio_below_the_limit():
    for kd in (11.0, 30.0, 77.0, 150.0):
        count = damped(kd)
        assert kd * 0.001 / count / 0.02 <= 0.5 + 1e-9
        assert kd * 0.001 / (count - 1) / 0.02 > 0.5
    assert damped(30.0, damping_limit=1.5) == 1


def test_damping_beyond_reach_is_refused_with_the_way_out():
    with pytest.raises(ParameterError, match="max_substeps = 20.*lower kd"):
        damped(1000.0)
    assert damped(1000.0, max_substeps=200) == 100
