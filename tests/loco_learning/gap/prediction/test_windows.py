# SPDX-License-Identifier: Apache-2.0
"""Pieces begin where the robot was, and a right model stays there."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from loco_learning.gap.importing import align
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import horizon, windows
from loco_learning.gap.prediction.channels import Channel
from loco_learning.gap.prediction.forward import Forward, ForwardParams, start
from loco_learning.gap.prediction.running import Start
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.recordings.tracks import Track
from loco_learning.gap.statistics import noise
from loco_learning.params import JointLearnerParams
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model

SHORT = ForwardParams(window=0.2)


def swinging(effects: list | None = None, rows: int = 400) -> Record:
    """A pendulum that is thrown about by a torque."""
    t = np.arange(rows) / 200.0
    push = np.sin(9.0 * t)[:, None] + 0.7 * np.sin(2.3 * t)[:, None]
    silent = Record("p", t, {"torque": push}, ("pivot",), {"q": 0.0 * push}, ("pivot",))
    q = Forward(Model("pendulum", {}, effects or []), [silent])()[0].copy()
    return Record("p", t, {"torque": push}, ("pivot",), {"q": q}, ("pivot",))


def test_smoothing_gives_value_and_rate_of_a_noisy_wave():
    t = np.arange(500) * 0.005
    noisy = np.sin(6.0 * t) + np.random.default_rng(0).normal(0.0, 1e-3, len(t))
    level, rate, *left = windows.smoothed(noisy, 0.005)
    missed = level - np.sin(6.0 * t), rate - 6.0 * np.cos(6.0 * t)
    assert np.std(missed[0]) < 7e-4 and np.std(missed[1]) < 0.09
    for off, said in zip(missed, left, strict=True):  # it knows how much, at the ends as well
        assert 0.4 < np.sqrt(np.mean(np.square(off / said))) < 1.2
        assert np.mean(said[[0, -1]]) > 1.5 * np.median(said)


def test_smoothing_of_exact_samples_changes_little_and_bridges_a_gap():
    t = np.arange(300) * 0.005
    exact = np.sin(6.0 * t)
    exact[40] = np.nan
    level, rate, *_ = windows.smoothed(exact, 0.005)
    assert np.isnan(level[40]) and np.isnan(rate[40])
    assert np.nanmax(np.abs(level - np.sin(6.0 * t))) < 3e-4
    off = np.abs(rate - 6.0 * np.cos(6.0 * t))
    near = np.abs(np.arange(len(t)) - 40) <= 2  # of the straight bridge across what is lost
    assert np.nanmax(off[~near]) < 0.005 and np.nanmax(off[near]) < 0.06


def test_noise_is_found_under_a_wave():
    wave = np.sin(np.arange(4000) * 0.05)
    noisy = wave + np.random.default_rng(1).normal(0.0, 0.01, 4000)
    assert windows.noise_of(noisy) == pytest.approx(0.01, rel=0.1)


STEP = 2e-3


def rounded(ratio, rows=6000):
    """Readings of a motion that passes several steps between samples, noise in steps; the truth."""
    t = np.arange(rows) / 500.0
    wave = 0.5 * np.sin(2.0 * np.pi * 1.732 * t) + 0.1 * t
    noisy = wave + ratio * STEP * np.random.default_rng(3).normal(size=rows)
    return STEP * np.round(noisy / STEP), wave, STEP * np.hypot(ratio, 1.0 / np.sqrt(12.0))


@pytest.mark.parametrize("ratio", [0.1, 0.3, 0.5, 0.8, 1.0, 3.0])
def test_noise_of_rounded_readings_is_that_of_noise_and_rounding(ratio):
    """A median of rounded differences is rounded itself, as low as 0.57 of the truth."""
    read, _, truth = rounded(ratio)
    assert windows.noise_of(read, STEP) == pytest.approx(truth, rel=0.08)


@pytest.mark.parametrize("ratio", [0.3, 0.8])
def test_smoothing_of_rounded_readings_knows_how_far_it_is_off(ratio):
    read, wave, _ = rounded(ratio)
    level, _, doubt, _ = windows.smoothed(read, 1.0 / 500.0, STEP)
    assert 0.4 < np.sqrt(np.mean(np.square((level - wave) / doubt))) < 1.2


@pytest.mark.parametrize("ratio", [0.3, 0.8])
def test_runs_on_the_ground_are_as_long_as_rounded_noise_lets_them(monkeypatch, ratio):
    """An error that grows by 0.015 rad/s is larger than twice the noise at a time that is known."""
    read, _, truth = rounded(ratio)
    t = np.arange(len(read)) / 500.0
    record = Record("r", t, {}, (), {"q": read[:, None]}, ("knee",),
                    resolution={("q", "knee"): STEP})  # fmt: skip
    grown = Some(channels=(Channel("q", "knee", "rad"),), measured=[read[:, None]])
    grown.starts = [[Start(0, len(t), None, None)]]
    grown.shaken = lambda count: [lambda: [0.015 * t[:, None]]] * count
    forward = type("Stub", (), {"__call__": lambda self: [0.0 * t[:, None]]})()
    forward.__dict__.update(vars(grown))
    monkeypatch.setattr(horizon, "Forward", lambda *args: forward)
    assert horizon.length(None, [record]) == pytest.approx(2.0 * truth / 0.015, rel=0.1)


def test_a_robot_that_rested_starts_at_rest_and_settles_whatever_its_first_samples_say():
    t = np.arange(400) / 200.0
    q = 0.3 + 0.8 * t[:, None]  # the sensor was switched on in mid-motion, it seems
    record = Record("r", t, {"torque": 0.0 * q}, ("pivot",), {"q": q}, ("pivot",))
    (moving,), (rested,) = (
        start(r, Forward(Model("pendulum"), [r]).robot()) for r in (record, record.rested(1.0))
    )
    assert moving.dq[0] == pytest.approx(0.8, abs=0.01)
    assert (rested.q[0], rested.dq[0]) == (pytest.approx(0.3), pytest.approx(0.0, abs=1e-9))


@pytest.mark.parametrize("window", [0.0, 0.2])
@pytest.mark.parametrize("lost", [0, 3])
def test_nothing_is_compared_in_the_rest_before_a_record(window, lost):
    """A pendulum that is said to rest where it cannot misses made-up readings by much."""
    t = np.arange(400) / 200.0
    q = 0.3 + 0.01 * np.random.default_rng(1).standard_normal((len(t), 1))
    guessed = dict.fromkeys(("q", "dq"), np.arange(len(t))[:, None] < lost) if lost else {}
    record = Record("r", t, {"torque": 0.0 * q}, ("pivot",), {"q": q, "dq": 0.0 * q}, ("pivot",),
                    guessed=guessed).rested(3.0)  # fmt: skip
    forward = Forward(Model("pendulum"), [record], ForwardParams(window=window))
    assert not np.isfinite(forward.measured[0][: 600 + lost]).any()
    read = np.isfinite(forward.measured[0][600 + lost :])
    assert read.any() if window else read.all()  # where a piece begins nothing is compared
    reads = record.read_of(forward.robot(), "q")  # three fifths of the samples are no noise
    assert noise.white([reads[:, 0]]) == pytest.approx(0.01, rel=0.15)


@pytest.mark.parametrize(("noise", "better"), [(0.1, "q"), (1e-4, "dq")])
def test_pieces_begin_at_the_speed_that_is_known_best(noise, better):
    """A drive that takes differences of positions says a speed with more noise than these have."""
    record, rng = swinging(), np.random.default_rng(2)
    true = np.gradient(record.signals["q"], record.dt, axis=0)
    q = record.signals["q"] + rng.normal(0.0, 1e-3, true.shape)
    said = true + rng.normal(0.0, noise, true.shape)
    both = replace(record, signals={"q": q, "dq": said})
    robot = Forward(Model("pendulum"), [both]).robot()
    seen, heard = (windows.smoothed(x[:, 0], both.dt) for x in (q, said))
    begun = windows.joint_states(both, robot)[1][:, 0]
    assert np.mean(begun == {"q": seen.rate, "dq": heard.level}[better]) > 0.75
    assert np.std(begun - true[:, 0]) < 0.1 * np.std(true)
    walking = replace(robot, fixed_base=False)
    assert np.array_equal(windows.joint_states(both, walking)[1][:, 0], heard.level)


def test_pieces_follow_each_other_and_the_right_model_stays_in_them():
    record = swinging()
    forward = Forward(Model("pendulum"), [record], SHORT)
    error = forward()[0] - forward.measured[0]
    starts = windows.segments(record, forward.robot(), 0.2)
    assert [s.row for s in starts] == list(range(0, 400, 40))
    assert forward.begun() == [list(range(40, 400, 40))]
    assert np.isnan(error[[0, 1, 2, 3, 40, 41, 42, 43]]).all()
    assert np.sqrt(np.nanmean(error**2)) < 5e-3 * np.std(record.signals["q"])


@pytest.mark.parametrize("step", [0.0, 0.003, 0.01])
@pytest.mark.parametrize("window", [0.2, 0.5, 1.0])
def test_a_right_model_explains_pieces_whose_starts_nobody_knows_exactly(step, window):
    """Without the doubt of their starts it left up to thirty floors."""
    exact, squares = swinging(rows=800), []
    for seed in range(6):
        q = exact.signals["q"] + np.random.default_rng(seed).normal(0.0, 3e-4, (800, 1))
        q = np.round(q / step) * step if step else q
        known = {"resolution": {("q", "pivot"): step}, "simulated": 1e-3}
        record = replace(exact, signals={"q": q}, **known)
        forward = Forward(Model("pendulum"), [record], ForwardParams(window=window))
        (left,) = cases.prepare(forward, [record], [], refitted=False).whitened([], {})
        squares.append(np.nanmean(np.square(left)))
    assert 0.3 < np.sqrt(np.mean(squares)) < 1.3


@pytest.mark.parametrize("rows", [399, 400, 401])
def test_whatever_is_compared_is_predicted(rows):
    """Also the last sample of a record that is one longer than its pieces."""
    forward = Forward(Model("pendulum"), [swinging(rows=rows)], SHORT)
    compared = np.isfinite(forward.measured[0])
    assert np.isfinite(forward()[0][compared]).all()
    assert compared[-1].all()


def test_what_no_piece_covers_is_not_compared():
    record = swinging()
    record.signals["q"][80:130] = np.nan  # a piece would begin at 80 and at 120
    forward = Forward(Model("pendulum"), [record], SHORT)
    assert not np.isfinite(forward.measured[0][80:160]).any()
    assert np.isfinite(forward.measured[0][170:]).any()


@pytest.mark.parametrize(
    ("sensor", "axis", "step", "noise"),
    [(100, 1000, 0.0015, 0.001), (100, 500, 0.005, 0.003), (200, 1000, 0.0015, 0.0005),
     (100, 150, 0.005, 0.002), (1000, 1000, 0.0015, 0.001)],
)  # fmt: skip
def test_a_robot_at_rest_starts_at_rest_however_fine_the_axis(sensor, axis, step, noise):
    """A rate from axis samples is a step of the encoder over one of them: 0.5 to 1 rad/s."""
    plant, rng = Model("servo_pendulum").make_robot(), np.random.default_rng(0)

    def motion(rate):
        t = np.arange(0.0, 4.0, 1.0 / rate)
        return t, np.where(t > 1.0, 0.4 * (1.0 - np.cos(6.0 * (t - 1.0))), 0.0)

    for _ in range(5):
        t, q = motion(sensor)
        q = step * np.round((q + noise * rng.standard_normal(len(t))) / step)
        tracks = [Track("q", "pivot", t, q, "q"), Track("command_position", "pivot",
                                                        *motion(axis), "c")]  # fmt: skip
        assert start(align.record("r", tracks, plant), plant) == []


@pytest.mark.parametrize("jitter", [0.0, 0.2, 0.45])
@pytest.mark.parametrize("ratio", [1.0, 1.3, 2.0, 3.7, 5.0, 20.0])
def test_however_unevenly_a_sensor_reads_the_state_is_that_of_the_motion(ratio, jitter):
    """Rows of readings end on the last one, and never after the axis, whatever their mean is."""
    plant, axis, rng = Model("servo_pendulum").make_robot(), 1000.0, np.random.default_rng(3)
    for last in range(8):
        told = np.arange(1600 + last) / axis
        read = np.arange(0.0, told[-1], ratio / axis)
        read[1:] += jitter * ratio / axis * rng.uniform(-1.0, 1.0, len(read) - 1)
        tracks = [Track("q", "pivot", read, 0.3 + 0.2 * read, "q"),
                  Track("command_position", "pivot", told, 0.3 + 0.2 * told, "c")]  # fmt: skip
        record = align.record("r", tracks, plant)
        (q,), (dq,), _ = windows.first_state(record, plant)
        near = 0.1 / axis  # a reading lies half a sample of the axis off its row at most
        assert q == pytest.approx(0.3, abs=near)
        # The slope at the end of a parabola is at most 160 / 70 errors of five readings a gap.
        assert dq == pytest.approx(0.2, abs=160.0 / 70.0 * near * axis / ratio)
        q, dq = (each[:, 0] for each in windows.joint_states(record, plant))
        read_there = np.isfinite(record.joints_of(plant, "q")[:, 0])
        np.testing.assert_array_equal(np.isfinite(q), read_there)
        np.testing.assert_allclose((q - 0.3 - 0.2 * record.t)[read_there], 0.0, atol=near)
        assert np.median(dq[read_there]) == pytest.approx(0.2, rel=0.01)


@pytest.mark.parametrize("rest", [0.05, 0.1, 0.2, 0.3, 0.5])
def test_a_robot_that_is_soon_told_to_move_starts_at_rest(rest):
    """A parabola through rest and motion together is neither."""
    plant, t = Model("servo_pendulum").make_robot(), np.arange(0.0, 4.0, 0.01)
    for speed in (3.0, 6.0, 12.0):
        q = np.where(t > rest, 0.5 * np.sin(speed * (t - rest)), 0.0)
        q = 0.005 * np.round(q / 0.005)
        tracks = [Track("q", "pivot", t, q, "q"), Track("command_position", "pivot", t, q, "c")]
        assert start(align.record("r", tracks, plant), plant) == []


@pytest.mark.parametrize("before", range(1, 9))
@pytest.mark.parametrize("encoder", [5e-3, 5e-4])
def test_a_log_that_begins_just_before_a_step_starts_with_its_speed(before, encoder):
    """A parabola across the step had 4.0 rad/s for 2.5, and a stop in mid-air was named."""
    t = np.arange(300) / 100.0
    told = np.where(t < 0.1, 0.0, np.where(t < 0.3, 0.6, -0.6))[:, None]
    silent = Record("s", t, {"position": told}, ("pivot",), {"q": 0.0 * told}, ("pivot",))
    exact = Forward(Model("servo_pendulum"), [silent])()[0]
    speed = np.gradient(exact[:, 0], t)
    rows = np.arange(30 - before, 300)
    q = np.round(exact[rows] / encoder) * encoder
    cut = Record(
        "s", t[rows] - t[rows[0]], {"position": told[rows]}, ("pivot",), {"q": q}, ("pivot",)
    )
    robot = Forward(Model("servo_pendulum"), [cut]).robot()
    (found,), (doubt,) = windows.first_state(cut, robot)[1], windows.first_doubt(cut, robot)[1]
    assert abs(found - speed[rows[0]]) < 3.0 * doubt + 0.5 * encoder / 0.01
    assert doubt < 1.0


def test_the_first_state_is_computed_once_and_depends_on_the_first_samples_alone():
    plant, t = Model("servo_pendulum").make_robot(), np.arange(0.0, 4.0, 0.01)
    q = np.round(0.3 * np.sin(3.0 * t + 0.5), 3)
    windows._first_of.cache_clear()
    states = []
    for later in (0.0, 0.1, 0.2):
        x = (q + later * (t > 2.0))[:, None]
        told = q[:, None]
        record = Record("r", t, {"position": told}, ("pivot",), {"q": x}, ("pivot",),
                        resolution={("q", "pivot"): 1e-3})  # fmt: skip
        states += [windows.first_state(record, plant), windows.first_doubt(record, plant)]
    np.testing.assert_allclose(states[4], states[0], rtol=1e-3)
    info = windows._first_of.cache_info()
    assert info.hits >= 3 and info.misses <= 3


def test_a_robot_that_swings_at_first_starts_with_its_speed():
    plant, rng = Model("servo_pendulum").make_robot(), np.random.default_rng(1)
    t = np.arange(0.0, 4.0, 0.01)
    q = 0.8 * np.sin(5.0 * t + 0.3) + 0.001 * rng.standard_normal(len(t))
    record = Record("r", t, {"position": q[:, None]}, ("pivot",), {"q": q[:, None]}, ("pivot",))
    (begin,) = start(record, plant)
    assert begin.dq[0] == pytest.approx(4.0 * np.cos(0.3), abs=0.15)
    assert begin.q[0] == pytest.approx(0.8 * np.sin(0.3), abs=0.005)


def test_pieces_tell_a_wrong_model_from_the_right_one():
    effect = {"name": "coulomb_friction", "torque": 0.2}
    forward = Forward(Model("pendulum"), [swinging([effect])], SHORT)
    wrong, right = (
        np.sqrt(np.nanmean((p[0] - forward.measured[0]) ** 2))
        for p in (forward(), forward([effect]))
    )
    assert wrong > 10.0 * right


def test_a_walking_robot_is_put_where_it_was():
    experiment = Experiment(
        robot="tigrillo",
        duration=0.6,
        overrides={"sensors.exact": True},
        learner=JointLearnerParams(enabled=False),
    )
    log, plant = rollout(experiment), experiment.plant
    signals = {"q": log.q, "base_position": log.position, "base_orientation": log.orientation}
    said = {"position": log.command, "velocity": log.command_dq}
    driven = tuple(plant.joints[i] for i in plant.driven)
    record = Record("walk", log.t, said, driven, signals, plant.joints).rows(10, 60)
    forward = Forward(Model("tigrillo"), [record], ForwardParams(window=0.1))
    error, wanted = forward()[0] - forward.measured[0], forward.measured[0]
    names = [str(channel) for channel in forward.channels]
    height = names.index("base_position z")
    assert np.isfinite(error[9]).all()
    assert np.nanmax(np.abs(error[:, height])) < 5e-3
    assert np.nanmean(error**2) < 0.05 * np.nanmean((wanted - np.nanmean(wanted, axis=0)) ** 2)


@pytest.mark.parametrize(("dt", "noise"), [(0.0005, 1e-3), (0.001, 1e-4), (0.001, 1e-3)])
def test_the_doubt_of_the_first_speed_covers_what_a_parabola_of_a_wave_is_off(dt, noise):
    """Beyond 2.5 deviations a refit of the initial state could not reach the true speed."""
    rng, t, off = np.random.default_rng(1), np.arange(400) * dt, []
    for _ in range(200):
        a, b = rng.uniform(0.0, 2.0 * np.pi, 2)
        wave = 0.3 * np.sin(6.0 * np.pi * t + a) + 0.1 * np.sin(10.2 * np.pi * t + b)
        speed = 1.8 * np.pi * np.cos(a) + 1.02 * np.pi * np.cos(b)
        read = wave + noise * rng.standard_normal(len(t))
        _, rate, _, _, doubt = windows._first(t, read, noise, np.zeros(len(t)))
        off.append((rate - speed) / doubt)
    assert np.mean(np.abs(off) > 2.5) < 0.08
