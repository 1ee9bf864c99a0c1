# SPDX-License-Identifier: Apache-2.0
"""Kinematic adjustment and push recovery: what leaves the gait alone, and signs and sizes else."""

import math

import numpy as np
import pytest

from loco_control.gait import recovery
from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.legs.geometry import HYQ
from loco_control.legs.kinematics import foot_position, jacobian
from loco_control.orientation import quaternion, rotation_base_to_horizontal

DT = 0.004
MIRROR = np.array([1, 0, 3, 2])  # rf lf rh lh
ON = {"adjustment": 1.0, "recovery": 1.0, "recovery_lag": 0.0}


def moving_trunk(q, velocity, spin=(0.0, 0.0, 0.0), roll=0.0, pitch=0.0):
    """Joint velocities [rad/s], (12,), while the trunk moves over feet that stand still."""
    R = rotation_base_to_horizontal(roll, pitch)
    feet = foot_position(q) @ R.T
    at_feet = np.asarray(velocity) + np.cross(spin, feet)
    return -np.linalg.solve(jacobian(q), (at_feet @ R)[..., None]).ravel()


def joints(gait, states):
    generator = TargetGenerator(GaitParams(start_time=0.0, **gait), DT)
    return np.array([generator.step(state).q for state in states])


def steps(state_at, standing, velocity=(0.0, 0.0, 0.0), **tilt):
    """Joint references (T, 12) of a trot in place, with all answers, and the same without."""
    dq = moving_trunk(standing, velocity)
    states = [state_at(tick, dq=dq, **tilt) for tick in range(300)]
    return joints({"speed": 0.0, **ON}, states), joints({"speed": 0.0}, states)


def test_upright_trunk_at_the_commanded_speed_changes_no_bit(state_at, standing):
    np.testing.assert_array_equal(*steps(state_at, standing))


def test_trunk_that_moves_as_commanded_shifts_no_step(state_at, standing):
    dq = moving_trunk(standing, (0.25, 0.1, 0.0))
    states = [state_at(tick, dq=dq) for tick in range(300)]
    gait = {"speed": 0.25, "lateral_speed": 0.1, "smoothing": 0.0}
    answered, open_loop = joints({**gait, **ON}, states), joints(gait, states)
    np.testing.assert_allclose(answered[200:], open_loop[200:], atol=1e-6)  # at tick 0 it stood


def test_answers_are_off_by_default(state_at, standing):
    dq = moving_trunk(standing, (0.5, 0.5, 0.0))
    tilted = [state_at(tick, roll=0.2, pitch=0.1, dq=dq) for tick in range(300)]
    level = [state_at(tick) for tick in range(300)]
    np.testing.assert_array_equal(joints({}, tilted), joints({}, level))


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_feet_turn_back_by_the_share_of_the_tilt(state_at, share):
    roll, pitch = 0.2, -0.1
    generator = TargetGenerator(GaitParams(start_time=0.0, adjustment=share), DT)
    R = rotation_base_to_horizontal(share * roll, share * pitch)
    for tick in range(300):
        target = generator.step(state_at(tick, roll=roll, pitch=pitch))
        np.testing.assert_allclose(foot_position(target.q) @ R.T, target.foot_position, atol=1e-9)
        turned = (jacobian(target.q) @ target.dq.reshape(4, 3, 1))[..., 0] @ R.T
        np.testing.assert_allclose(turned, target.foot_velocity, atol=1e-8)


def test_legs_on_the_high_side_become_longer(state_at, standing):
    left_high, level = (-foot_position(q[-1])[:, 2] for q in steps(state_at, standing, roll=0.1))
    assert (left_high[[0, 2]] > level[[0, 2]]).all() and (left_high[[1, 3]] < level[[1, 3]]).all()


def test_larger_tilts_are_answered_up_to_the_limit():
    lean = recovery.lean_of(quaternion(0.5, -0.6, 1.0), 0.75, 0.35)
    np.testing.assert_allclose(lean, [0.35, -0.35])


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_swing_feet_step_where_the_trunk_goes(state_at, standing, axis, sign):
    velocity = np.zeros(3)
    velocity[axis] = 0.4 * sign
    pushed, calm = steps(state_at, standing, velocity)
    shift = np.array(
        [foot_position(a) - foot_position(b) for a, b in zip(pushed, calm, strict=True)]
    )
    expected = 0.4 * sign * math.sqrt(0.6 / recovery.GRAVITY)
    furthest = (sign * shift[..., axis]).max(axis=0)
    np.testing.assert_allclose(furthest, abs(expected), rtol=0.05)
    assert np.abs(shift[..., 1 - axis]).max() < 1e-9


def test_answers_of_left_and_right_mirror_each_other(state_at, standing):
    flip = np.array([1.0, -1.0, 1.0])
    left, _ = steps(state_at, standing, (0.1, 0.3, 0.0), roll=0.1, pitch=0.05)
    right, _ = steps(state_at, standing, (0.1, -0.3, 0.0), roll=-0.1, pitch=0.05)
    half = round(0.5 / 1.6934 / DT)  # left legs do what right legs did half a stride before
    a, b = foot_position(left[150 + half]), foot_position(right[150])
    np.testing.assert_allclose(a[MIRROR] * flip, b, atol=6e-3)


def test_a_pendulum_that_steps_to_the_capture_point_comes_to_rest():
    height, v = 0.6, 0.7
    x = -recovery.step_shift(np.array([v, 0.0]), height, 1.0, 10.0)[0]  # from the new foot
    assert v * v == pytest.approx(recovery.GRAVITY / height * x * x)  # orbital energy 0


def test_shift_keeps_its_direction_at_the_limit():
    shift = recovery.step_shift(np.array([3.0, -4.0]), 0.6, 1.0, 0.25)
    np.testing.assert_allclose(shift, [0.15, -0.2])


def test_velocity_of_the_trunk_is_that_of_feet_that_stand(standing):
    rng = np.random.default_rng(0)
    for _ in range(10):
        q, (roll, pitch) = standing + rng.uniform(-0.2, 0.2, 12), rng.uniform(-0.3, 0.3, 2)
        velocity, spin = rng.normal(size=3), rng.normal(size=3)
        dq = moving_trunk(q, velocity, spin, roll, pitch)
        dq[:3] += 1.0  # the foot in the air tells nothing
        gyroscope = spin @ rotation_base_to_horizontal(roll, pitch)
        found = recovery.trunk_velocity(
            *(q, dq, quaternion(roll, pitch, 0.7), gyroscope, np.array([False, True, True, True])),
            HYQ,
        )
        np.testing.assert_allclose(found, velocity[:2], atol=1e-9)


def test_without_a_foot_on_the_ground_the_last_velocity_remains(state_at, standing):
    generator = TargetGenerator(GaitParams(start_time=0.0, speed=0.0, **ON), DT)
    calm = TargetGenerator(GaitParams(start_time=0.0, speed=0.0), DT)
    dq = moving_trunk(standing, (0.0, 0.4, 0.0))
    for tick in range(400):
        flying = {"contact": np.zeros(4, dtype=bool)} if tick > 100 else {"dq": dq}
        pushed = generator.step(state_at(tick, **flying))
        still = calm.step(state_at(tick))
    swinging = foot_position(pushed.q)[:, 1] - foot_position(still.q)[:, 1]
    assert swinging[~pushed.stance] == pytest.approx(0.4 * math.sqrt(0.6 / 9.81), rel=0.05)


def test_reset_forgets_the_push(state_at, standing):
    generator = TargetGenerator(GaitParams(start_time=0.0, **ON), DT)
    pushed = state_at(dq=moving_trunk(standing, (0.0, 0.5, 0.0)))
    first = generator.step(pushed)
    for _ in range(50):
        generator.step(pushed)
    generator.reset()
    np.testing.assert_array_equal(generator.step(pushed).q, first.q)
