# SPDX-License-Identifier: Apache-2.0
"""Uneven stamps onto an even axis: nothing invented, nothing shifted, all of it told."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap import contents
from loco_learning.gap.importing import align
from loco_learning.gap.recordings.record import HELD_OUT, Doubt
from loco_learning.gap.recordings.tracks import Track

FINE = np.arange(41000) / 1e4  # times of a motion as it was [s]


def told(record, words):
    return any(words in note for note in record.notes)


def test_even_data_stay_as_they_are(signals, hinge):
    tracks = signals(start=12.3)
    made = align.record("run", tracks, hinge, role=HELD_OUT, overrides={"fixed_base": True})
    for track in tracks:
        values = made.signals.get(track.role, made.command["position"])
        assert np.array_equal(values[:, 0], track.x)
    assert made.dt == pytest.approx(0.01) and made.t[0] == 0.0 and made.driven == ("hinge",)
    assert made.role == HELD_OUT and made.overrides == {"fixed_base": True}
    assert not any("resampled" in note or "quantised" in note for note in made.notes)


def test_uneven_stamps_are_resampled_and_told(signals, hinge, change):
    rng = np.random.default_rng(1)
    jitter = 0.004 * rng.random(400)

    def uneven(track):  # read when it is stamped
        x = np.interp(track.t + jitter, FINE, smooth[track.role])
        return change(track, t=track.t + jitter, x=x)

    smooth = {track.role: track.x for track in signals(rate=1e4, seconds=4.1)}
    made = align.record("run", signals(q=uneven, dq=uneven, command_position=uneven), hinge)
    off = np.interp(made.t + jitter[0], FINE, smooth["q"]) - made.signals["q"][:, 0]
    assert np.nanmax(np.abs(off)) < 2e-3 and 1.0 / made.dt == pytest.approx(100.0)
    assert told(made, "uneven stamps")


@pytest.mark.parametrize("latest", [0.003, 0.025])
def test_stamps_of_arrival_are_put_back_on_the_clock_of_the_readings(
    signals, hinge, change, latest
):
    rng = np.random.default_rng(1)
    plain = signals()[1]

    def late(track):
        arrived = np.maximum.accumulate(track.t + latest * rng.random(400))
        return change(track, t=arrived)

    made = align.record("run", signals(q=late, dq=lambda track: None), hinge)
    assert told(made, "were put back")
    off = np.interp(made.t + plain.t[0], plain.t, plain.x) - made.signals["q"][:, 0]
    assert np.nanmax(np.abs(off)) < 0.02 * 8.0 * latest  # of what lateness does to 8 rad/s


def test_a_joint_that_mostly_rests_tells_of_late_stamps_as_well(signals, hinge, change):
    rng = np.random.default_rng(2)
    t = np.arange(400) / 100.0
    x = 0.3 * np.clip((t - 2.0) / 0.5, 0.0, 1.0) + 5e-5 * rng.standard_normal(400)

    def late(track):
        arrived = np.maximum.accumulate(track.t + 0.0025 * rng.random(400))
        return change(track, t=arrived, x=x)

    made = align.record("run", signals(q=late, dq=lambda track: None), hinge, trust_units=True)
    assert told(made, "were put back")


def test_stamps_of_which_one_in_twenty_is_lost_are_left_alone(signals, hinge, change):
    kept = np.random.default_rng(1).random(400) >= 0.05
    kept[0] = True

    def lossy(track):
        return change(track, t=track.t[kept], x=track.x[kept])

    made = align.record("run", signals(q=lossy, dq=lossy), hinge)
    assert not told(made, "put back")
    flags = made.guessed["q"][:, 0]
    assert np.array_equal(flags, ~kept[: len(flags)])
    assert np.isfinite(made.joints_of(hinge, "q")).all()
    assert np.array_equal(np.isfinite(made.read_of(hinge, "q")[:, 0]), ~flags)
    assert np.array_equal(made.rows(10, 200).guessed["q"][:, 0], flags[10:200])


def test_a_command_holds_until_the_next(signals, hinge, change):
    def rare(track):
        return change(track, t=track.t[::50], x=track.x[::50])

    made = align.record("run", signals(command_position=rare), hinge)
    command = made.command["position"][:, 0]
    assert len(command) == 400 and np.array_equal(command, np.repeat(command[::50], 50))


@pytest.mark.parametrize("latest", [0.0, 0.002])
def test_commands_dropped_with_a_reading_are_on_the_line_about_them(signals, hinge, change, latest):
    """In the rows of the readings, at the rate of the drive; others hold, as events do."""
    rng = np.random.default_rng(3)
    here, late = rng.random(400) > 0.05, latest * rng.random(400)
    here[[0, -1]], late[[0, -1]] = True, 0.0
    plain = signals()[0]

    def lossy(track):
        return change(track, t=(track.t + late)[here], x=track.x[here])

    made = align.record("run", signals(q=lossy, dq=lossy, command_position=lossy), hinge)
    off = made.command["position"][:, 0] - np.interp(made.t, plain.t - plain.t[0], plain.x)
    assert np.abs(off[1:-1]).max() < 0.02 * np.ptp(plain.x)
    alone = align.record("run", signals(command_position=lossy), hinge).command["position"][:, 0]
    assert np.isin(alone, plain.x[here]).all()


def test_a_measured_command_runs_on_between_its_samples(signals, hinge, change):
    def rare(track):
        return change(track, t=track.t[::50], x=track.x[::50], between="line")

    made = align.record("run", signals(command_position=rare), hinge)
    command = made.command["position"][:, 0]
    assert made.ramps == ("position",) and np.ptp(np.diff(command[:50])) < 1e-12
    assert align.record("run", signals(), hinge).ramps == ()


def test_a_slow_signal_is_not_filled_in(signals, hinge):
    tracks = signals()
    t = tracks[0].t[::10]
    tracks += [Track("gyro", axis, t, np.sin(t), "imu") for axis in "xyz"]
    made = align.record("run", tracks, hinge)
    known = np.isfinite(made.signals["gyro"][:, 0])
    assert np.array_equal(np.flatnonzero(known), np.arange(0, 400, 10))
    assert np.array_equal(made.signals["gyro"][known, 1], np.sin(t))


def test_nothing_is_known_in_a_gap(signals, hinge, change):
    def lost(track):
        kept = (track.t < 1.0) | (track.t >= 1.5)
        return change(track, t=track.t[kept], x=track.x[kept])

    made = align.record("run", signals(q=lost, dq=lost), hinge)
    unknown = np.isnan(made.signals["q"][:, 0])
    assert np.array_equal(np.flatnonzero(unknown), np.arange(100, 150))
    assert np.all(np.isfinite(made.command["position"]))
    assert told(made, "q, dq: 1 pauses, the longest of 0.510 s at 0.99 s")


def test_a_lost_reading_is_drawn_between_its_neighbours_and_marked(signals, hinge, change):
    def lost(track):
        return change(track, t=np.delete(track.t, [100, 399]), x=np.delete(track.x, [100, 399]))

    whole, made = (align.record("run", signals(**by), hinge) for by in ({}, {"q": lost}))
    q = whole.signals["q"][:, 0]
    assert np.flatnonzero(made.guessed["q"][:, 0]).tolist() == [100]
    assert made.signals["q"][100, 0] == pytest.approx(0.5 * (q[99] + q[101]))
    kept = np.delete(np.arange(len(made.t)), 100)
    assert np.allclose(made.signals["q"][kept, 0], q[kept], atol=1e-12)
    assert whole.guessed == {} and "dq" not in made.guessed


def test_time_that_jumps_back_is_two_experiments(signals, hinge, change):
    def twice(share):
        def begin_again(track):
            cut = int(share * len(track.t))
            return change(track, t=np.r_[track.t[cut:], track.t[:cut]])

        return begin_again

    for share in (0.3, 0.5, 0.7):
        with pytest.raises(ParameterError, match="jumps back by .* at row .*several experiments"):
            align.record("run", signals(q=twice(share)), hinge)


def test_disorder_and_doubles_are_put_right(signals, hinge, change):
    def repeated(track):  # by a logger that is five times faster
        return change(track, t=np.repeat(track.t, 5), x=np.repeat(track.x, 5))

    def doubled(track):
        made = change(track, t=np.repeat(track.t, 2), x=np.repeat(track.x, 2))
        return change(made, x=made.x + 0.01 * (np.arange(len(made.x)) % 2))

    def swapped(track):
        order = np.arange(len(track.t))
        order[[10, 11]] = [11, 10]
        return change(track, t=track.t[order], x=track.x[order])

    right = align.record("run", signals(), hinge).signals["q"]
    for change_of, words in (
        (repeated, "samples repeat another, with its stamp"), (doubled, "with the stamp of another"),
        (swapped, "were sorted"),
    ):  # fmt: skip
        made = align.record("run", signals(q=change_of), hinge)
        assert np.array_equal(made.signals["q"], right) and told(made, words)


def test_only_the_common_time_is_kept(signals, hinge, change):
    made = align.record("run", signals(q=lambda k: change(k, t=k.t + 1.0)), hinge)
    assert made.duration == pytest.approx(2.99 + 0.01, abs=0.0101)


def test_time_that_only_positions_or_commands_cover_is_told(signals, hinge, change):
    def until(track, end):
        return change(track, t=track.t[track.t < end], x=track.x[track.t < end])

    made = align.record("run", signals(command_position=lambda k: until(k, 2.0)), hinge)
    assert told(made, "positions go on 1.9") and told(made, "s after the commands: that time is")
    made = align.record("run", signals(q=lambda k: change(k, t=k.t + 1.0)), hinge)
    assert told(made, "commands begin 1.00 s before the positions: that time is not used")


@pytest.mark.parametrize("rate", [50.0, 250.0])
def test_another_rate_is_made_if_asked(signals, hinge, rate):
    made = align.record("run", signals(), hinge, rate=rate)
    assert 1.0 / made.dt == pytest.approx(rate)


def test_rates_that_jitter_about_a_round_one_are_that_one(signals, hinge, change):
    rng = np.random.default_rng(2)

    def drift(track):
        return change(track, t=1.0003 * track.t + 1e-5 * rng.random(len(track.t)))

    made = align.record("run", signals(q=drift, dq=drift, command_position=drift), hinge)
    assert 1.0 / made.dt == pytest.approx(100.0, rel=1e-9)
    made = align.record("run", signals(rate=99.9), hinge)
    assert 1.0 / made.dt == pytest.approx(99.9, rel=1e-9)


def test_angles_over_a_turn_are_unwrapped_and_told(signals, hinge, change):
    def turning(track):
        x = (2.0 * track.t + np.pi) % (2.0 * np.pi) - np.pi
        return change(track, x=x)

    made = align.record("run", signals(q=turning, dq=lambda k: None), hinge, trust_units=True)
    assert np.allclose(np.diff(made.signals["q"][:, 0]), 0.02) and told(made, "was wrapped")


def test_a_quaternion_and_its_negative_are_one_turn(signals, hinge):
    tracks = signals()
    t = tracks[0].t + 0.004
    half = 0.5 * t
    sign = np.where(np.arange(len(t)) % 7 < 3, 1.0, -1.0)
    parts = {"x": np.zeros(len(t)), "y": np.zeros(len(t)), "z": np.sin(half), "w": np.cos(half)}
    tracks += [Track("orientation", axis, t, sign * x, "imu") for axis, x in parts.items()]
    q = align.record("run", tracks, hinge).signals["orientation"]
    known = np.isfinite(q[:, 0])
    assert known.sum() > 390
    assert np.allclose(np.linalg.norm(q[known], axis=1), 1.0)
    assert np.max(np.abs(np.diff(q[known], axis=0))) < 0.01


def test_lags_are_told_and_left(signals, hinge, change):
    made = align.record("run", signals(dq=lambda k: change(k, t=k.t + 0.02)), hinge)
    motion = next(n for n in made.notes if n.startswith("motion is behind"))
    velocity = next(n for n in made.notes if n.startswith("measured velocity"))
    assert float(motion.split("about ")[1].split()[0]) == pytest.approx(30.0, abs=2.0)
    assert float(velocity.split("by ")[1].split()[0]) == pytest.approx(20.0, abs=2.0)
    inner = slice(10, 300)
    late = made.command["position"][7:297, 0]
    assert np.max(np.abs(late - made.signals["q"][inner, 0])) < 1e-9


def test_stamps_must_be_at_least_two(signals, hinge, change):
    with pytest.raises(ParameterError, match="too short"):
        align.record("run", signals(q=lambda k: change(k, t=k.t[:2], x=k.x[:2])), hinge)


def test_a_command_that_the_motion_does_not_follow_raises_a_warning(signals, hinge, change):
    """The column of another joint, or a drive that is off."""
    slow = signals(q=lambda k: change(k, x=0.5 * np.sin(1.7 * k.t + 1.0)), dq=lambda k: None)
    (warning,) = align.record("run", slow, hinge).warnings
    assert "hinge does not follow its commanded position" in warning


@pytest.mark.parametrize("late", [0.0, 0.1, 0.25])
def test_a_motion_that_is_late_small_or_noisy_follows(signals, hinge, change, late):
    rng = np.random.default_rng(0)

    def worse(track):
        x = 0.3 * np.interp(track.t - late, track.t, track.x)
        return change(track, x=x + 0.05 * rng.standard_normal(len(x)))

    assert align.record("run", signals(q=worse, dq=lambda k: None), hinge).warnings == ()


def set_back(seconds, share=0.5):
    """Change of a track: its clock was set back by some seconds at a share of it."""

    def step(track):
        t = track.t.copy()
        t[int(share * len(t)) :] -= seconds
        return type(track)(track.role, track.place, t, track.x, track.source)

    return step


@pytest.mark.parametrize(("seconds", "share"), [(0.05, 0.5), (1.0, 0.5), (0.025, 0.3), (2.4, 0.6)])
def test_a_clock_set_back_cuts_the_record_and_nothing_is_mixed_or_lost(
    signals, hinge, seconds, share
):
    whole = align.record("run", signals(), hinge).signals["q"][:, 0]
    back = set_back(seconds, share)
    parts = align.records("run", signals(q=back, dq=back, command_position=back), hinge)
    assert [part.name for part in parts] == ["run part 1", "run part 2"]
    assert np.array_equal(np.concatenate([part.signals["q"][:, 0] for part in parts]), whole)
    row = int(share * len(whole))
    words = f"jumps back by {seconds - 0.01:.6g} s at row {row}: cut there"
    assert all(told(part, words) for part in parts)


def test_a_clock_set_back_while_one_signal_rests_cuts_that_too(signals, hinge):
    back = set_back(0.3)
    tracks = [back(track) for track in signals(command_position=0.0)]
    assert len(align.records("run", tracks, hinge)) == 2


def test_a_slow_signal_is_cut_with_the_fast_ones_and_one_of_another_clock_is_refused(
    signals, hinge, change
):
    back = set_back(0.05)

    def slow(track):  # 5 Hz, of which no two stamps are in the wrong order
        later = back(track)
        return change(later, t=later.t[10::20], x=later.x[10::20])

    tracks = signals(q=back, command_position=back, dq=slow)
    parts = align.records("run", tracks, hinge)
    assert [int(np.isfinite(part.signals["dq"]).sum()) for part in parts] == [10, 10]
    with pytest.raises(ParameterError, match="q of hinge jumps back by 0.04.*that of .* does not"):
        align.records("run", signals(q=back), hinge)
    with pytest.raises(ParameterError, match=r"back by 0.04 s at row 200.*rows: \[first, stop\]"):
        align.record("run", [back(track) for track in signals()], hinge)


def test_readings_that_came_late_are_sorted_wherever_they_belong(signals, hinge):
    right = align.record("run", signals(), hinge).signals["q"]
    single, block = np.arange(400), np.arange(400)
    single[100:107] = [*range(101, 107), 100]
    block[100:140] = [*range(120, 140), *range(100, 120)]
    for order in (single, block):
        tracks = [type(k)(k.role, k.place, k.t[order], k.x[order], k.source) for k in signals()]
        (made,) = align.records("run", tracks, hinge)
        assert np.array_equal(made.signals["q"], right) and told(made, "were sorted: 1 times")


@pytest.mark.parametrize("pause", [0.2, 0.51, 3.0])
def test_a_pause_of_all_signals_is_a_cut_and_said_with_row_and_size(signals, hinge, change, pause):
    def stopped(track):
        return change(track, t=np.where(np.arange(400) < 170, track.t, track.t + pause))

    whole = align.record("run", signals(), hinge).signals["q"][:, 0]
    tracks = signals(q=stopped, dq=stopped, command_position=stopped)
    parts = align.records("run", tracks, hinge)
    assert [part.name for part in parts] == ["run part 1", "run part 2"]
    assert np.array_equal(np.concatenate([part.signals["q"][:, 0] for part in parts]), whole)
    words = f"angles and commands pause for {pause + 0.01:.6g} s at row 170 of q of hinge: cut"
    assert all(told(part, words) for part in parts)


def test_a_pause_in_one_clock_alone_is_no_cut(signals, hinge, change):
    """Commands that go on say what the drive did; those that are given now and then may rest."""

    def stopped(track):
        kept = (track.t < 1.5) | (track.t >= 2.1)
        return change(track, t=track.t[kept], x=track.x[kept])

    def rare(track):
        return change(track, t=track.t[::70], x=track.x[::70])

    for changes in ({"q": stopped, "dq": stopped}, {"command_position": stopped},
                    {"q": stopped, "dq": stopped, "command_position": rare}):  # fmt: skip
        assert len(align.records("run", signals(**changes), hinge)) == 1


def test_a_short_part_before_a_pause_is_left_out_and_said(signals, hinge, change):
    def stopped(track):
        return change(track, t=np.where(np.arange(400) < 20, track.t, track.t + 1.0))

    tracks = signals(q=stopped, dq=stopped, command_position=stopped)
    (made,) = align.records("run", tracks, hinge)
    assert len(made.t) == 380 and told(made, "part 1 has 20 readings, fewer than 50")


def test_notes_that_can_look_like_a_gap_are_told_from_those_that_cannot(signals, hinge, change):
    def late(track):
        arrived = track.t + 0.003 * np.random.default_rng(1).random(400)
        return change(track, t=arrived, x=np.round(track.x, 3))

    made = align.record("run", signals(q=late, dq=lambda track: None), hinge)
    (doubt,) = [note for note in made.notes if isinstance(note, Doubt)]
    assert "were put back" in doubt and told(made, "is quantised")
    twin = align.record("twin", signals(q=late, dq=lambda track: None), hinge)
    assert contents.reading_warnings([made, twin]) == [f"run, twin: {doubt}"]
    assert contents.reading_warnings([align.record("run", signals(), hinge)]) == []


@pytest.mark.parametrize("step", [0.05, 0.07, 0.085])
def test_a_clock_set_forward_while_the_motion_goes_on_is_a_cut(signals, hinge, change, step):
    def forward(track):
        return change(track, t=np.where(np.arange(400) < 170, track.t, track.t + step))

    tracks = signals(q=forward, dq=forward, command_position=forward)
    parts = align.records("run", tracks, hinge)
    assert [len(part.t) for part in parts] == [170, 230]
    words = f"the time of q of hinge jumps forward by {step + 0.01:.6g} s at row 170"
    assert all(told(part, words) for part in parts)


@pytest.mark.parametrize("count", [5, 7, 8])
def test_readings_that_are_lost_from_all_signals_are_no_cut(signals, hinge, change, count):
    def losing(track):
        kept = np.r_[0:170, 170 + count : 400]
        return change(track, t=track.t[kept], x=track.x[kept])

    tracks = signals(q=losing, dq=losing, command_position=losing)
    assert len(align.records("run", tracks, hinge)) == 1


@pytest.mark.parametrize("turn", [0.0, 2.0 * np.pi])
def test_an_angle_wrapped_at_zero_is_no_second_publisher(signals, hinge, change, turn):
    def wrapped(track):
        x = np.where(np.arange(400) % 100 < 60, 1e-3 * (track.t % 0.02 > 0.005), track.x)
        return change(track, x=np.round((x - 4e-4) % (2.0 * np.pi), 3) + turn)

    def resting(track):
        return change(track, x=np.where(np.arange(400) % 100 < 60, 0.0, track.x))

    record = align.record(
        "run", signals(q=wrapped, dq=lambda k: None, command_position=resting), hinge
    )
    assert told(record, "q of hinge was wrapped")
    assert np.abs(record.signals["q"] - record.command["position"]).max() < 1.0
