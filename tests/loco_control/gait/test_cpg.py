# SPDX-License-Identifier: Apache-2.0
"""Oscillators: frequency, foot paths and phase patterns."""

import numpy as np
import pytest

from loco_control.gait import cpg
from loco_control.gait.generator import PATTERNS, GaitParams, foot_centres

DT = 0.004
# Speed, frequency, duty factor, step height, speed to the left, turning rate.
GAIT = np.array([0.25, 1.7, 0.5, 0.10, 0.0, 0.0])
CENTRE = foot_centres(GaitParams().origin)
SHAPE = np.array([getattr(GaitParams(), name) for name in cpg.SHAPE])


def run(duration, pattern="trot", gait=GAIT, state=None, substeps=20, **shape):
    """States (T, 4, 2), feet (T, 4, 3) and phases (T, 4) of the oscillators."""
    offsets = np.array(PATTERNS[pattern])
    coupling = cpg.coupling_matrices(offsets)
    state = cpg.seed_state(offsets) if state is None else state.copy()
    values = dict(zip(cpg.SHAPE, SHAPE, strict=True))
    vector = np.array(list({**values, **shape}.values()))
    foot, states, feet, phases = np.zeros((4, 3)), [], [], []
    for _ in range(round(duration / DT)):
        cpg.advance(state, foot, gait, *coupling, vector, DT, substeps, CENTRE, np.zeros(2))
        states.append(state.copy())
        feet.append(foot.copy())
        phases.append(cpg.stride_phase(state, gait[cpg.DUTY]))
    return np.array(states), np.array(feet), np.array(phases)


def frequency(phases, skip=5.0):
    """Mean stride frequency [Hz] of leg 0."""
    turns = np.unwrap(2.0 * np.pi * phases[round(skip / DT) :, 0]) / (2.0 * np.pi)
    return (turns[-1] - turns[0]) / ((len(turns) - 1) * DT)


def lead(phases, skip=10.0):
    """Mean phase of each leg over leg 0, in strides, in [0, 1)."""
    difference = phases[round(skip / DT) :] - phases[round(skip / DT) :, :1]
    return np.angle(np.exp(2j * np.pi * difference).mean(axis=0)) / (2.0 * np.pi) % 1.0


def apart(a, b):
    """Largest distance on the circle of strides."""
    return np.abs((np.asarray(a) - b + 0.5) % 1.0 - 0.5).max()


def test_coupled_trot_has_the_frequency_of_the_author_s_recordings():
    assert frequency(run(35.0)[2]) == pytest.approx(1.693, abs=0.001)


@pytest.mark.parametrize("substeps", [10, 20, 100])
def test_uncoupled_oscillator_keeps_the_frequency_asked_for(substeps):
    assert frequency(run(25.0, coupling=0.0, substeps=substeps)[2]) == pytest.approx(1.7, abs=5e-4)


def test_coupling_slows_the_trot_down():
    strong = [frequency(run(25.0, coupling=K)[2]) for K in (1.0, 5.0)]
    np.testing.assert_allclose(strong, [1.677, 1.19], atol=0.006)  # K = 1 and 5


def test_real_robot_gait():
    states, feet, phases = run(25.0, gait=np.array([0.25, 1.4, 0.6, 0.10, 0.0, 0.0]))
    assert frequency(phases) == pytest.approx(1.394, abs=0.003)
    assert (states[2500:, :, 1] <= 0.0).mean() == pytest.approx(0.598, abs=0.003)
    assert np.ptp(feet[2500:, 0, 0]) == pytest.approx(0.1071, abs=0.001)


def test_foot_range_of_the_filtered_trot():
    x, z, y = run(15.0)[1][1250:, 0].T
    assert not y.any()
    assert np.abs([x.min(), x.max()]) == pytest.approx(0.0369, abs=3e-4)
    assert z.min() == pytest.approx(-0.0005, abs=2e-4)
    assert z.max() == pytest.approx(0.1018, abs=2e-4)


def test_stance_foot_moves_straight_back_with_the_speed_of_the_trunk():
    states, feet, _ = run(15.0)
    deep = states[:, 0, 1] < -0.3
    steps = np.diff(feet[:, 0], axis=0)[deep[1:] & deep[:-1]][500:] / DT
    np.testing.assert_allclose(steps[:, 0], -0.25, atol=1e-3)
    np.testing.assert_allclose(steps[:, 1], 0.0, atol=1e-3)


@pytest.mark.parametrize("duty", [0.5, 0.6, 0.75])
@pytest.mark.parametrize("pattern", sorted(PATTERNS))
def test_pattern_is_found_again_after_a_disturbance(pattern, duty):
    offsets = np.array(PATTERNS[pattern])
    disturbed = cpg.seed_state(offsets + np.array([0.0, 0.08, -0.07, 0.05])) / cpg.SEED_RADIUS
    phases = run(40.0, pattern, np.array([0.25, 1.7, duty, 0.1, 0.0, 0.0]), disturbed)[2]
    assert apart(lead(phases[:250], skip=0.0), offsets) > 0.02  # it was disturbed
    assert apart(lead(phases, skip=30.0), offsets) < 0.002


def test_uncoupled_legs_do_not_find_the_pattern():
    offsets = np.array(PATTERNS["trot"])
    disturbed = cpg.seed_state(offsets + np.array([0.0, 0.08, -0.07, 0.05])) / cpg.SEED_RADIUS
    assert apart(lead(run(20.0, state=disturbed, coupling=0.0)[2]), offsets) > 0.05


def test_trot_matrix_is_that_of_the_rcf():
    cosine, sine = cpg.coupling_matrices(np.array(PATTERNS["trot"]))
    rcf = [[0, -1, -1, 1], [-1, 0, 1, -1], [-1, 1, 0, -1], [1, -1, -1, 0]]
    np.testing.assert_array_equal(cosine, rcf)
    np.testing.assert_array_equal(sine, np.zeros((4, 4)))


def test_bound_matrix_is_symmetric():
    cosine, sine = cpg.coupling_matrices(np.array(PATTERNS["bound"]))
    rcf = [[0, 1, -1, -1], [1, 0, -1, -1], [-1, -1, 0, 1], [-1, -1, 1, 0]]
    np.testing.assert_array_equal(cosine, rcf)
    np.testing.assert_array_equal(sine, np.zeros((4, 4)))


def test_cycle_is_the_unit_circle_and_phase_runs_evenly_in_time():
    gait = np.array([0.25, 1.7, 0.6, 0.1, 0.0, 0.0])
    states, _, phases = run(10.0, gait=gait, coupling=0.0)
    np.testing.assert_allclose(np.hypot(*states[500:, 0].T), 1.0, atol=2e-3)
    steps = np.diff(np.unwrap(2.0 * np.pi * phases[500:, 0])) / (2.0 * np.pi)
    # the switch between the rates is smooth, so phase is uneven just around it
    assert np.median(np.abs(steps - 1.7 * DT)) < 1e-6
    assert np.abs(steps - 1.7 * DT).max() < 0.3 * 1.7 * DT


def test_phase_is_zero_at_touchdown_and_the_duty_factor_at_lift_off():
    corners = np.array([[1.0, -1e-9], [0.0, -1.0], [-1.0, 1e-9], [0.0, 1.0]])
    np.testing.assert_allclose(cpg.stride_phase(corners, 0.6), [0.0, 0.3, 0.6, 0.8], atol=1e-8)
    assert cpg.stride_phase(np.array([[1.0, 1e-300]] * 4), 0.6).max() < 1.0


def test_seed_has_the_phases_asked_for():
    for offsets in PATTERNS.values():
        phases = cpg.stride_phase(cpg.seed_state(np.array(offsets)), 0.5)
        assert apart(phases, np.array(offsets)) < 1e-9


def test_skewed_swing_is_faster_first_but_as_long():
    skewed, plain = (run(15.0, coupling=0.0, swing_skew=skew) for skew in (2.0, 1.0))
    assert frequency(skewed[2]) == pytest.approx(frequency(plain[2]), rel=0.01)
    early = [((s[1250:, 0, 1] > 0) & (s[1250:, 0, 0] < 0)).mean() for s, *_ in (skewed, plain)]
    assert early[0] < 0.7 * early[1]


def test_speed_of_the_foot_is_limited():
    foot = np.array([[5.0, 0.0, 0.0]] * 4)
    coupling = cpg.coupling_matrices(np.array(PATTERNS["trot"]))
    state = np.array([[0.0, 1.0]] * 4)
    velocity = cpg.advance(state, foot, GAIT, *coupling, SHAPE, DT, 1, CENTRE, np.zeros(2))
    np.testing.assert_array_equal(velocity[:, 0], -cpg.MAX_FOOT_SPEED)


def test_sigmoid_is_safe_far_out():
    np.testing.assert_allclose([cpg.sigmoid(u) for u in (-1e4, 0.0, 1e4)], [0.0, 0.5, 1.0])
