# SPDX-License-Identifier: Apache-2.0
"""Sensors say what mechanics says they should."""

import numpy as np
import pytest

from loco_sim.geometry import roll_pitch, rotation_matrix
from loco_sim.plant.sensing import BROKEN, FALL, FINE, fall_reason, ground_truth, readings
from loco_sim.plant.sensing import robot_state as state_of
from loco_sim.robot.robot import FallLimits

LEVEL = (0.0, 0.0, 0.0, 1.0)
UP_SIDE = (np.sin(np.pi / 4), 0.0, 0.0, np.cos(np.pi / 4))  # rolled by 90 degrees
STILL = (0.0, 0.0, 0.0)
NEVER = FallLimits()


def base_at(z=0.6, orientation=LEVEL, velocity=STILL, spin=STILL):
    return [0.0, 0.0, z, *orientation, *velocity, *spin]


def read(base, before=None, joints=(), forces=(), limits=NEVER):
    """First row of what the kernel says of joints (q, dq, tau in turn), forces and base."""
    now = np.array([*joints, *forces, *base])
    then = np.array([*joints, *forces, *(before or base)])
    fall = limits.height, limits.roll, limits.pitch
    gravity, n = (0.0, 0.0, -9.81), len(joints) // 3
    values, touches, verdicts = readings(np.stack([then, now]), n, 0.004, gravity, 1.0, fall)
    return values[0], touches[0], verdicts[0]


def state(base, **more):
    values, touches, _ = read(base, **more)
    return state_of(7, 0.028, values, touches)


def test_at_rest_the_accelerometer_reads_gravity_along_the_worlds_up():
    assert state(base_at()).linear_acceleration == pytest.approx((0, 0, 9.81))
    on_side = state(base_at(orientation=UP_SIDE)).linear_acceleration
    assert on_side == pytest.approx((0, 9.81, 0))


def test_in_free_fall_it_reads_nothing():
    before = base_at(orientation=UP_SIDE, velocity=(0.0, 0.0, -1.0))
    now = base_at(orientation=UP_SIDE, velocity=(0.0, 0.0, -1.0 - 9.81 * 0.004))
    felt = state(now, before=before).linear_acceleration
    assert felt == pytest.approx((0, 0, 0), abs=1e-12)


def test_fields_of_the_state_do_not_get_mixed_up():
    joints, forces = np.arange(36) + 100.0, np.arange(12) + 300.0
    base = base_at(orientation=UP_SIDE, spin=(0.0, 0.0, 2.0))
    found = state(base, joints=joints, forces=forces)
    assert (found.tick, found.t) == (7, 0.028)
    np.testing.assert_array_equal(found.q, joints[:12])
    np.testing.assert_array_equal(found.dq, joints[12:24])
    np.testing.assert_array_equal(found.tau, joints[24:])
    np.testing.assert_array_equal(found.grf, forces.reshape(4, 3))
    np.testing.assert_array_equal(found.orientation, UP_SIDE)
    np.testing.assert_allclose(found.angular_velocity, [0.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.linear_acceleration, [0.0, 9.81, 0.0], atol=1e-12)


def test_contact_needs_more_than_the_threshold():
    forces = [0, 0, 0, 0, 0, 0.9, 0, 0, 1.1, 0.8, 0.8, 0.0]
    assert state(base_at(), forces=forces).contact.tolist() == [False, False, True, True]


def test_a_robot_without_feet_has_empty_forces():
    found = state(base_at(), joints=[0.1, 0.0, 0.0])
    assert found.grf.shape == (0, 3)
    assert found.contact.shape == (0,)


def test_the_ground_truth_turns_velocities_into_the_base_frame():
    values, _, _ = read(base_at(orientation=UP_SIDE, velocity=(0.0, 0.0, 2.0)))
    truth = ground_truth(3, 0.012, values)
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
    values, _, verdict = read(base, limits=limits)
    reason = fall_reason(values, limits)
    assert verdict == (FINE if word is None else FALL)
    assert reason is None if word is None else word in reason


def test_without_limits_nothing_is_a_fall():
    base = base_at(z=-5.0, orientation=rolled(3.0, 0))
    values, _, verdict = read(base)
    assert fall_reason(values, FallLimits()) is None
    assert verdict == FINE


def test_kernel_and_message_agree_on_what_a_fall_is():
    limits, rng = FallLimits(height=0.35, roll=0.8, pitch=0.8), np.random.default_rng(1)
    for _ in range(300):
        turn = rng.normal(size=4) * [0.4, 0.4, 1.0, 1.0]
        turn = (turn / np.linalg.norm(turn)).tolist()
        values, _, verdict = read(base_at(rng.uniform(0.3, 1.0), turn), limits=limits)
        assert (verdict == FALL) == bool(fall_reason(values, limits))
        far = np.abs(roll_pitch(rotation_matrix(turn))) > 0.8
        assert (verdict == FALL) >= bool(far.any())


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", [0, 2, 5, 10])
def test_a_state_that_is_not_finite_is_told(bad, where):
    row = [0.1, 0.2, 0.3, *base_at()]
    assert read(row[3:], joints=row[:3])[2] == FINE
    row[where] = bad
    assert read(row[3:], joints=row[:3])[2] == BROKEN
