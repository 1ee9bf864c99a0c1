# SPDX-License-Identifier: Apache-2.0
"""Springs pull towards where they are slack and store what they take."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_sim.drives.spring_kernels import spring_energy, spring_torque
from loco_sim.robot.spring import COLUMNS, SPRING_TYPES, SpringParams

KNEES = np.linspace(0.6, 2.0, 8)  # [rad]


def row(**values):
    return np.array(SpringParams(**values).row())


@pytest.mark.parametrize("kind", SPRING_TYPES)
def test_the_torque_is_minus_the_slope_of_the_energy(kind):
    spring, h = row(kind=kind, stiffness=181.6, rest=0.9), 1e-6
    for q in KNEES:
        slope = (spring_energy(q + h, spring) - spring_energy(q - h, spring)) / (2.0 * h)
        assert spring_torque(q, 0.0, spring) == pytest.approx(-slope, abs=1e-6)


@pytest.mark.parametrize("kind", SPRING_TYPES)
def test_a_slack_spring_gives_no_torque_and_a_stretched_one_pulls_back(kind):
    params = SpringParams(kind=kind, stiffness=181.6, rest=0.5)
    spring = np.array(params.row())
    assert spring_torque(params.slack, 0.0, spring) == pytest.approx(0.0, abs=1e-12)
    assert all(spring_torque(q, 0.0, spring) < 0.0 for q in KNEES)


def test_the_damper_takes_energy_whichever_way_it_moves():
    spring = row(damping=0.3)
    for speed in (-2.0, 0.0, 5.0):
        assert spring_torque(1.0, speed, spring) == pytest.approx(-0.3 * speed)


def test_the_geometry_of_tigrillo_gives_the_published_angle_and_rate():
    """Facts of gurbain/tigrillo2, exp/model.py: slack at 33.557 degrees, k_t = 1.4865e-3 k."""
    params = SpringParams(kind="torsion", stiffness=181.6)
    assert np.rad2deg(params.slack) == pytest.approx(33.557, abs=0.001)
    assert params.rate == pytest.approx(0.270, abs=0.0005)


def test_the_linear_equivalent_is_far_from_the_exact_spring_at_large_angles():
    """Between 50 and 120 degrees the exact torque saturates; the line does not."""
    exact, line = (row(kind=kind, stiffness=181.6) for kind in ("pretension", "torsion"))
    low, high = np.deg2rad([50.0, 120.0])
    ratio = [spring_torque(q, 0.0, exact) / spring_torque(q, 0.0, line) for q in (low, high)]
    assert ratio[1] < 0.6 * ratio[0]


def test_no_spring_is_a_row_of_zeros():
    assert spring_torque(1.0, 1.0, np.zeros(COLUMNS)) == 0.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stiffness": -1.0}, "stiffness must be in"),
        ({"damping": -1.0}, "damping must be in"),
        ({"kind": "rubber"}, "rubber"),
        ({"length": 0.2}, "fits no triangle"),
    ],
)
def test_springs_that_cannot_be_are_refused(values, message):
    with pytest.raises((ParameterError, KeyError), match=message):
        SpringParams(**values)
