# SPDX-License-Identifier: Apache-2.0
"""Target generator: start, changes at run time, and references that fit together."""

import subprocess
import sys

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait.generator import TWIST, GaitParams, TargetGenerator
from loco_control.legs.kinematics import foot_position, jacobian
from loco_control.params import from_dict, to_dict
from loco_control.stance.kernels import turning_rate

DT = 0.004


def stacked(targets, name):
    return np.array([getattr(target, name) for target in targets])


def test_robot_stands_on_its_foot_centres_before_the_start(targets):
    before = targets(0.5, start_time=0.5)
    for target in before:
        assert target.stance.all() and target.speed == 0.0
        np.testing.assert_allclose(np.abs(target.foot_position), [[0.375, 0.28, 0.6]] * 4)
        np.testing.assert_array_equal(target.dq, np.zeros(12))
    np.testing.assert_allclose(before[0].q[:3], [-0.1211, 0.6952, -1.4184], atol=5e-5)


def test_gait_starts_at_the_tick_of_start_time(targets):
    moving = np.abs(stacked(targets(0.6, start_time=0.5), "foot_velocity")).max(axis=(1, 2)) > 0
    assert moving.argmax() == 125 and moving[125:].all()


def test_diagonal_pairs_take_turns(targets):
    stance = stacked(targets(8.0), "stance")[500:]
    np.testing.assert_array_equal(stance[:, 0], stance[:, 3])
    np.testing.assert_array_equal(stance[:, 1], stance[:, 2])
    np.testing.assert_array_equal(stance[:, 0], ~stance[:, 1])
    np.testing.assert_allclose(stance.mean(axis=0), 0.5, atol=0.01)


def test_stance_is_the_first_part_of_the_phase(targets):
    run = targets(8.0, duty_factor=0.6)
    phase, stance = stacked(run, "phase"), stacked(run, "stance")
    assert phase.min() >= 0.0 and phase.max() < 1.0
    np.testing.assert_array_equal(phase[1:] < 0.6, stance[1:])


def test_joints_put_the_feet_on_their_paths(targets):
    for target in targets(2.0)[::17]:
        np.testing.assert_allclose(foot_position(target.q), target.foot_position, atol=1e-12)
        moved = (jacobian(target.q) @ target.dq.reshape(4, 3, 1))[..., 0]
        np.testing.assert_allclose(moved, target.foot_velocity, atol=1e-11)


def test_velocities_are_the_derivatives_of_positions(targets):
    run = targets(6.0)[1000:]
    for position, velocity in (("q", "dq"), ("foot_position", "foot_velocity")):
        slope = (stacked(run, position)[2:] - stacked(run, position)[:-2]) / (2.0 * DT)
        error = np.abs(slope - stacked(run, velocity)[1:-1]).max()
        assert error < 0.1 * np.abs(slope).max()


def test_set_changes_smoothly_and_arrives(state_at):
    generator = TargetGenerator(GaitParams(start_time=0.0), DT)
    run = [generator.step(state_at(tick)) for tick in range(750)]
    generator.set(speed=0.4, frequency=1.4, step_height=0.06)
    run += [generator.step(state_at(tick)) for tick in range(750, 1500)]
    speed, frequency = stacked(run, "speed"), stacked(run, "frequency")
    assert speed[749] == pytest.approx(0.25, rel=1e-3)
    assert speed[-1] == pytest.approx(0.4, rel=1e-3)
    assert frequency[-1] == pytest.approx(1.4, rel=1e-3)
    assert np.abs(np.diff(speed)).max() < 0.01 and np.abs(np.diff(frequency)).max() < 0.01
    assert np.abs(np.diff(stacked(run, "foot_position"), axis=0)).max() < 0.012
    height = stacked(run, "foot_position")[-300:, 0, 2].max() + 0.6
    assert height == pytest.approx(0.061, abs=0.002)


def test_change_is_two_lags_in_a_row(state_at):
    generator = TargetGenerator(GaitParams(start_time=0.0, smoothing=0.2), DT)
    speed = np.array([generator.step(state_at(tick)).speed for tick in range(300)])
    t = DT * np.arange(1, 301)
    np.testing.assert_allclose(speed, 0.25 * (1.0 - np.exp(-t / 0.2) * (1.0 + t / 0.2)), atol=3e-3)


def test_without_smoothing_a_change_is_immediate(state_at):
    generator = TargetGenerator(GaitParams(start_time=0.0, smoothing=0.0), DT)
    assert generator.step(state_at(0)).speed == 0.25


def test_a_standing_robot_takes_a_new_frequency_at_once(state_at):
    generator = TargetGenerator(GaitParams(), DT)
    generator.set(frequency=1.4)
    assert generator.step(state_at(0)).frequency == 1.4


def test_schedule_is_set_at_its_time(state_at):
    planned = TargetGenerator(GaitParams(schedule=[{"time": 1.6, "speed": 0.1}]), DT)
    steered = TargetGenerator(GaitParams(), DT)
    for tick in range(600):
        if tick == 400:
            steered.set(speed=0.1)
        a, b = planned.step(state_at(tick)), steered.step(state_at(tick))
        np.testing.assert_array_equal(a.q, b.q)
    assert a.speed < 0.2


def test_reset_repeats_the_run_bit_by_bit(state_at):
    generator = TargetGenerator(GaitParams(schedule=[{"time": 1.2, "frequency": 1.5}]), DT)
    runs = []
    for _ in range(2):
        generator.reset()
        runs.append(stacked([generator.step(state_at(tick)) for tick in range(500)], "q"))
        generator.set(speed=-0.1)
    np.testing.assert_array_equal(*runs)


def test_targets_do_not_share_arrays_with_the_generator(targets):
    run = targets(0.1)
    kept = [run[10].q.copy(), run[10].foot_position.copy(), run[10].stance.copy()]
    for target in run[11:]:
        target.q += 1.0
        target.foot_position += 1.0
        assert not np.shares_memory(target.foot_position, run[10].foot_position)
    np.testing.assert_array_equal(run[10].q, kept[0])
    np.testing.assert_array_equal(run[10].foot_position, kept[1])
    np.testing.assert_array_equal(run[10].stance, kept[2])


def test_walking_backwards_mirrors_the_foot_path(targets):
    forward, backward = (stacked(targets(4.0, speed=v), "foot_position") for v in (0.2, -0.2))
    centre = np.array([0.375, 0.375, -0.375, -0.375])
    np.testing.assert_allclose(forward[..., 0] - centre, centre - backward[..., 0], atol=1e-12)
    np.testing.assert_allclose(forward[..., 2], backward[..., 2], atol=1e-12)


def test_in_place_the_feet_only_go_up_and_down(targets):
    feet = stacked(targets(4.0, speed=0.0), "foot_position")
    np.testing.assert_allclose(np.ptp(feet[..., 0], axis=0), 0.0, atol=1e-12)
    assert np.ptp(feet[500:, :, 2], axis=0).min() > 0.1


@pytest.mark.parametrize("pattern", ["walk", "bound", "pace"])
def test_every_pattern_keeps_its_feet_in_reach(targets, pattern):
    for target in targets(4.0, pattern=pattern, duty_factor=0.7)[::10]:
        np.testing.assert_allclose(foot_position(target.q), target.foot_position, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"speed": 3.0}, ParameterError, r"speed must be in \[-1, 1\] m/s, got 3"),
        ({"sped": 0.1}, NameUnknownError, "did you mean 'speed'"),
        ({"pattern": "walk"}, NameUnknownError, "changes at run time named 'pattern'"),
        ({"frequency": float("nan")}, ParameterError, "frequency"),
        ({"speed": 1.0, "frequency": 0.3}, ParameterError, "out of reach"),
    ],
)
def test_set_refuses_and_leaves_the_gait_alone(state_at, change, error, text):
    generator = TargetGenerator(GaitParams(start_time=0.0, smoothing=0.0), DT)
    with pytest.raises(error, match=text):
        generator.set(**change)
    assert generator.step(state_at(0)).speed == 0.25


@pytest.mark.parametrize(
    ("schedule", "error"),
    [
        ([{"speed": 0.1}], ParameterError),
        ([{"time": 1.0, "speed": 9.0}], ParameterError),
        ([{"time": 1.0, "colour": 1.0}], NameUnknownError),
        (["soon"], ParameterError),
        ([{"time": float("nan"), "speed": 0.1}], ParameterError),
        (3.0, ParameterError),
        ({"time": 1.0, "speed": 0.1}, ParameterError),
    ],
)
def test_bad_schedule_is_refused(schedule, error):
    with pytest.raises(error):
        from_dict(GaitParams, {"schedule": schedule})


def test_schedule_out_of_reach_is_refused_before_it_runs():
    schedule = [{"time": 2.0, "frequency": 0.3}, {"time": 1.0, "speed": 1.0}]
    with pytest.raises(ParameterError, match="out of reach"):
        TargetGenerator(GaitParams(schedule=schedule), DT)


def test_foot_centre_out_of_reach_is_refused():
    with pytest.raises(ParameterError, match="out of reach"):
        TargetGenerator(GaitParams(origin=(0.375, 0.28, -0.8)), DT)


def test_parameters_survive_a_round_trip():
    params = GaitParams(pattern="walk", schedule=[{"time": 2.0, "speed": 0.1}])
    assert from_dict(GaitParams, to_dict(params)) == params


def test_reading_parameters_does_not_load_numba():
    code = (
        "import sys, loco_control.gait.generator, loco_control.stance.trunk; "
        "import loco_control.stance.controller, loco_control.stance.trunk; "
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("twist", [(0.2, 0.1, 0.0), (0.0, 0.0, 0.4), (0.1, -0.1, -0.3)])
def test_stance_feet_move_as_the_ground_does_under_a_trunk_with_that_twist(targets, twist):
    speed, lateral, yaw = twist
    run = targets(6.0, speed=speed, lateral_speed=lateral, yaw_rate=yaw)[-600:]
    feet, velocity = stacked(run, "foot_position"), stacked(run, "foot_velocity")
    phase = stacked(run, "phase")
    deep = (phase > 0.15) & (phase < 0.35)  # of 0.5 in stance: away from the soft switch
    ground = -np.stack([speed - yaw * feet[..., 1], lateral + yaw * feet[..., 0]], axis=-1)
    assert deep.sum() > 200
    np.testing.assert_allclose(velocity[deep][:, :2], ground[deep], atol=2e-3)
    rates = [turning_rate(t.foot_position, t.foot_velocity, t.stance) for t in run]
    assert np.median(rates) == pytest.approx(yaw, abs=0.02)


def test_straight_on_is_to_the_bit_without_a_sideways_part(targets):
    run = targets(3.0)
    sideways = stacked(run, "foot_velocity")[..., 1]
    assert sideways.tobytes() == np.zeros_like(sideways).tobytes()  # no negative zero either
    assert {turning_rate(t.foot_position, t.foot_velocity, t.stance) for t in run} == {0.0}


def test_a_twist_in_reach_is_followed_and_one_beyond_it_is_cut_in_its_direction():
    generator = TargetGenerator(GaitParams(), DT)
    assert generator.follow(0.2, -0.1, 0.3) == dict(zip(TWIST, (0.2, -0.1, 0.3), strict=True))
    for asked in ((5.0, 0.0, 0.0), (3.0, 2.0, 0.5), (-0.4, 0.0, -8.0)):
        followed = np.array(list(generator.follow(*asked).values()))
        share = followed @ asked / np.dot(asked, asked)
        assert 0.0 < share < 1.0
        np.testing.assert_allclose(followed, share * np.array(asked), atol=1e-12)
        GaitParams(**dict(zip(TWIST, followed, strict=True)))  # within the ranges
        again = generator.follow(*followed)
        np.testing.assert_allclose(list(again.values()), followed)
    with pytest.raises(ParameterError, match="finite"):
        generator.follow(np.nan, 0.0, 0.0)


def test_slow_strides_reach_less_far_than_the_range_of_the_speed():
    generator = TargetGenerator(GaitParams(frequency=0.5, duty_factor=0.8), DT)
    speed = generator.follow(1.0, 0.0, 0.0)["speed"]
    assert 0.2 < speed < 0.9
    with pytest.raises(ParameterError, match="out of reach"):
        generator.set(speed=1.02 * speed)
