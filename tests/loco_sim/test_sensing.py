# SPDX-License-Identifier: Apache-2.0
"""Sensors say what mechanics says they should."""

import numpy as np
import pytest

from loco_control.exceptions import DivergedError
from loco_sim.geometry import rotation_matrix
from loco_sim.robot import FallLimits
from loco_sim.sensing import check_finite, fall_reason, ground_truth, robot_state, specific_force
from loco_sim.world import Base

LEVEL = (0.0, 0.0, 0.0, 1.0)
UP_SIDE = (np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4))  # rolled by 90 degrees


def base_at(z=0.6, orientation=LEVEL, velocity=(0, 0, 0), spin=(0, 0, 0)):
    return Base((0.0, 0.0, z), orientation, velocity, spin)


def test_at_rest_the_accelerometer_reads_gravity_along_the_worlds_up():
    still = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.004, (0.0, 0.0, -9.81))
    assert specific_force(rotation_matrix(LEVEL), *still) == pytest.approx((0, 0, 9.81))
    assert specific_force(rotation_matrix(UP_SIDE), *still) == pytest.approx((0, 9.81, 0))


def test_in_free_fall_it_reads_nothing():
    fall = ((0.0, 0.0, -1.0), (0.0, 0.0, -1.0 - 9.81 * 0.004), 0.004, (0.0, 0.0, -9.81))
    assert specific_force(rotation_matrix(UP_SIDE), *fall) == pytest.approx((0, 0, 0), abs=1e-12)


def test_fields_of_the_state_do_not_get_mixed_up():
    q, dq, tau = np.arange(12) + 0.0, np.arange(12) + 100.0, np.arange(12) + 200.0
    grf = np.arange(12) + 300.0
    base = base_at(orientation=UP_SIDE, spin=(0.0, 0.0, 2.0))
    rotation = rotation_matrix(UP_SIDE)
    state = robot_state(7, 0.028, (q, dq), tau, grf, base, (1.0, 2.0, 3.0), rotation, 1.0)
    assert (state.tick, state.t) == (7, 0.028)
    np.testing.assert_array_equal(state.q, q)
    np.testing.assert_array_equal(state.dq, dq)
    np.testing.assert_array_equal(state.tau, tau)
    np.testing.assert_array_equal(state.grf, grf.reshape(4, 3))
    np.testing.assert_array_equal(state.orientation, UP_SIDE)
    np.testing.assert_allclose(state.angular_velocity, [0.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(state.linear_acceleration, [1.0, 2.0, 3.0])


def test_contact_needs_more_than_the_threshold():
    grf = [0, 0, 0, 0, 0, 0.9, 0, 0, 1.1, 0.8, 0.8, 0.0]
    args = (0, 0.0, ([], []), [], grf, base_at(), (0, 0, 0), rotation_matrix(LEVEL), 1.0)
    assert robot_state(*args).contact.tolist() == [False, False, True, True]


def test_a_robot_without_feet_has_empty_forces():
    args = (0, 0.0, ([0.1], [0.0]), [0.0], [], base_at(), (0, 0, 0), rotation_matrix(LEVEL), 1.0)
    state = robot_state(*args)
    assert state.grf.shape == (0, 3)
    assert state.contact.shape == (0,)


def test_the_ground_truth_turns_velocities_into_the_base_frame():
    truth = ground_truth(3, 0.012, base_at(orientation=UP_SIDE, velocity=(0.0, 0.0, 2.0)))
    np.testing.assert_allclose(truth.linear_velocity, [0.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(truth.position, [0.0, 0.0, 0.6])


def rolled(angle, axis):
    turn = [0.0, 0.0, 0.0, np.cos(angle / 2)]
    turn[axis] = np.sin(angle / 2)
    return tuple(turn)


@pytest.mark.parametrize(
    ("base", "word"),
    [
        (base_at(), None),
        (base_at(z=0.34), "height"),
        (base_at(orientation=rolled(0.79, 0)), None),
        (base_at(orientation=rolled(0.81, 0)), "roll"),
        (base_at(orientation=rolled(-0.81, 1)), "pitch"),
        (base_at(orientation=rolled(2.0, 2)), None),
    ],
)
def test_a_fall_is_low_rolled_or_pitched(base, word):
    limits = FallLimits(height=0.35, roll=0.8, pitch=0.8)
    reason = fall_reason(base, rotation_matrix(base.orientation), limits)
    assert reason is None if word is None else word in reason


def test_without_limits_nothing_is_a_fall():
    base = base_at(z=-5.0, orientation=rolled(3.0, 0))
    assert fall_reason(base, rotation_matrix(base.orientation), FallLimits()) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_raises(bad):
    check_finite(0.0, [1.0], [2.0, 3.0])
    with pytest.raises(DivergedError, match="t = 1.500 s"):
        check_finite(1.5, [1.0], [2.0, bad])
