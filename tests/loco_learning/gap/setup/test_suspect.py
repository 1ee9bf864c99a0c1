# SPDX-License-Identifier: Apache-2.0
"""Wrong units are found and named; right ones, and robots with hidden effects, are let be."""

import re
from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.importing import align, importing
from loco_learning.gap.recordings import lags, mapping
from loco_learning.gap.recordings.tracks import Track
from loco_learning.gap.setup import suspect
from loco_sim.robot.servo import TorqueDrive
from loco_sim.robot.spring import SpringParams

DEGREE = 180.0 / np.pi


def suspected(tracks, robot, said):
    with pytest.raises(ParameterError, match=said) as error:
        align.record("run", tracks, robot)
    assert "\n" not in str(error.value) and "trust_units" in str(error.value)
    align.record("run", tracks, robot, trust_units=True)


def later(change, factor):
    return lambda k: change(k, t=factor * k.t)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"dq": DEGREE}, "dq of hinge is 57.* probably dq is in deg/s"),
        ({"q": DEGREE, "command_position": DEGREE}, "probably q is in deg"),
        ({"dq": 60 / (2 * np.pi)}, "dq is in rpm"),
        ({"dq": 1 / (2 * np.pi)}, "dq is in rev/s"),
        ({"q": 1 / (2 * np.pi), "command_position": 1 / (2 * np.pi)}, "probably q is in rev"),
        ({"dq": -1.0}, "opposite sign"),
        ({"dq": 8.0}, "a wrong unit or scale"),
        ({"q": 1e3}, "probably q is in mrad"),
        ({"dq": 1e3}, "probably dq is in mrad/s;"),
        ({"q": 4096 / (2 * np.pi)}, "probably q is in counts of 4096 a turn"),
        ({"q": 1e5 / (2 * np.pi)}, "probably q is in a unit of this size"),
        ({"dq": 2.0}, r"[12].* times the derivative of q.*scale: 0.5.* at dq.*\{scale: 0.5"),
        ({"dq": 0.5}, r"0\.(49.*|5) times the derivative of q.*time: \{scale: (2.0|1.99)"),
    ],
)
def test_velocity_and_angle_do_not_fit(signals, hinge, changes, said):
    suspected(signals(**changes), hinge, said)


@pytest.mark.parametrize(("dq", "low"), [(None, -1.6), (300.0, -1.6), (300.0, -1e4)])
def test_whole_numbers_are_counts_whatever_the_limits_and_the_unit_of_speed(
    signals, hinge, dq, low
):
    """Steps of one radian are no angles; a speed in a unit of its own tells nothing of them."""

    def counts(track):
        return replace(track, x=np.round(track.x * 4096 / (2 * np.pi)) + 2048)

    limits = f'lower="{low}" upper="{-low}"'
    robot = replace(hinge, urdf=hinge.urdf.replace('lower="-1.6" upper="1.6"', limits))
    changes = {"q": counts, "command_position": counts, "dq": dq or (lambda k: None)}
    suspected(signals(**changes), robot, "steps of 1 rad: probably counts; give their scale")


@pytest.mark.parametrize("every", [2, 4])
def test_the_signals_of_a_slow_log_are_compared_where_they_were_read(signals, hinge, every):
    """Between its rows nothing is known, as commands were given more often."""
    robot = replace(hinge, control_rate=100.0, rate_stated=True)

    def thin(track, by=1.0):
        return replace(track, t=track.t[::every], x=by * track.x[::every])

    tracks = {role: thin for role in ("q", "command_position")}
    suspected(
        signals(**tracks, dq=lambda k: thin(k, 2.0)), robot, r"(1.9|2.0). times the derivative"
    )
    align.record("run", signals(**tracks, dq=thin), robot)


@pytest.mark.parametrize("pause", [10, 100])
def test_pauses_hide_no_wrong_unit(signals, hinge, pause):
    """Nothing is known there; a difference over a pause is no velocity."""

    def holed(by=1.0):
        def change(track):
            x = by * track.x
            for start in (50, 250, 400):
                x[start : start + pause] = np.nan
            known = np.isfinite(x)
            return replace(track, t=track.t[known], x=x[known])

        return change

    suspected(signals(q=holed(), dq=holed(DEGREE)), hinge, "57.*probably dq is in deg/s")
    align.record("run", signals(q=holed(), dq=holed()), hinge)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_motion_near_half_the_rate_is_no_wrong_clock(signals, hinge, share):
    """A difference of neighbours is smaller than the speed there."""
    robot = replace(hinge, control_rate=100.0, rate_stated=True)
    w = share * np.pi * 10.0

    def wave(f, every=10):
        return lambda k: replace(k, t=k.t[::every], x=f(k.t[::every]))

    q = wave(lambda t: np.sin(w * t))
    dq = wave(lambda t: w * np.cos(w * t))
    align.record("run", signals(q=q, dq=dq, command_position=q), robot)


@pytest.mark.parametrize("gain", [0.7 / 1.3, 1.3 / 0.7])
def test_a_gain_that_sensors_have_is_no_wrong_scale(signals, hinge, gain):
    align.record("run", signals(dq=gain), hinge)


def test_a_clock_that_runs_too_fast_is_mended_by_its_scale(tmp_path, hinge):
    t = np.arange(800) / 200.0
    rows = np.column_stack([t / 2.0, np.sin(3.0 * t), 3.0 * np.cos(3.0 * t), np.sin(3.0 * t)])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header="t,q,dq,cmd", comments="")
    text = """time: {column: t}
columns:
  - {column: q, role: q, joint: hinge}
  - {column: dq, role: dq, joint: hinge}
  - {column: cmd, role: command_position, joint: hinge}
"""
    (tmp_path / "mapping.yaml").write_text(text)
    with pytest.raises(ParameterError, match=r"time: \{scale") as error:
        importing.load(tmp_path / "a.csv", hinge, mapping.load(tmp_path))
    line = re.search(r"time: \{(scale: [0-9.]+)\}", str(error.value))[1]
    (tmp_path / "mapping.yaml").write_text(text.replace("{column: t}", f"{{column: t, {line}}}"))
    (record,) = importing.load(tmp_path / "a.csv", hinge, mapping.load(tmp_path))
    assert record.duration == pytest.approx(t[-1], rel=0.01)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"command_position": DEGREE}, "probably command_position is in deg"),
        ({"q": DEGREE}, "probably q is in deg"),
        (
            {"q": DEGREE, "command_position": DEGREE},
            "limits are -1.6 and 1.6: probably q is in deg",
        ),
        ({"q": 9.0, "command_position": 9.0}, "probably q is in deg"),
    ],
)
def test_angles_alone_do_not_fit(signals, hinge, changes, said):
    suspected(signals(**changes, dq=lambda k: None), hinge, said)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns"), (1e-3, "s")])
def test_times_in_another_unit(signals, hinge, change, factor, unit):
    wrong = later(change, factor)
    tracks = signals(q=wrong, command_position=wrong, dq=lambda k: None)
    with pytest.raises(ParameterError, match=rf"time is probably in .*\b{unit}\b"):
        align.record("run", tracks, hinge)


def test_times_in_ms_at_a_rate_that_could_be(signals, hinge, change):
    """At 20 kHz times in ms make 20 Hz, which robots do run at; the velocity tells."""
    wrong = later(change, 1e3)
    tracks = signals(rate=2e4, seconds=2.0, q=wrong, dq=wrong, command_position=wrong)
    suspected(tracks, hinge, "the time is in ms")


@pytest.mark.parametrize(
    ("factor", "said"),
    [(10.0, "a current in A"), (1e3, "in mN·m"), (0.05, "a current in A")],
)
def test_measured_torque_in_another_unit(signals, one_joint, torque_drive, change, factor, said):
    tracks = signals(q=0.1, dq=0.1)
    tracks = [change(k, role=k.role.replace("position", "torque")) for k in tracks]
    torque = next(k for k in tracks if k.role == "command_torque")
    tracks.append(change(torque, role="tau", x=factor * torque.x, source="column 'i'"))
    suspected(tracks, one_joint(drive=torque_drive), said)


@pytest.mark.parametrize("sprung", [False, True])
def test_a_drive_that_is_told_voltages_has_the_torque_of_its_gains(
    signals, one_joint, change, sprung
):
    """A torque sensor reads the spring of the joint too, which holds the motor back."""
    drive, spring = TorqueDrive(gain=0.05, slope=0.002), SpringParams("linear", 0.4, 0.0, rest=0.0)
    robot = one_joint(drive=drive)
    robot = replace(robot, springs={"hinge": spring}) if sprung else robot
    tracks = [change(k, role=k.role.replace("position", "torque")) for k in signals()]
    told = next(k for k in tracks if k.role == "command_torque")
    told = change(told, x=20.0 * told.x)
    by = {k.role: k.x for k in tracks}
    made = 0.05 * told.x - 0.002 * by["dq"] - (0.4 * by["q"] if sprung else 0.0)
    tau = change(told, role="tau", x=made)
    tracks = [k for k in tracks if k.role != "command_torque"]
    align.record("run", [*tracks, told, tau], robot)
    suspected([*tracks, told, tau], one_joint(drive=TorqueDrive()), "a current in A")


def test_torque_far_above_the_limit(signals, hinge, change):
    tracks = signals()
    tracks.append(change(tracks[0], role="tau", x=2000.0 * tracks[0].x, source="column 'i'"))
    suspected(tracks, hinge, "tau of hinge reaches .* probably it is in mN·m")


def robotwide(tracks, role, rows):
    t = tracks[0].t
    axes = "xyzw"[: len(rows)]
    return tracks + [
        Track(role, axis if len(rows) > 1 else "", t, np.full(len(t), row), role)
        for axis, row in zip(axes, rows, strict=True)
    ]


@pytest.mark.parametrize(
    ("role", "rows", "said"),
    [
        ("gyro", (90.0, 0.0, 0.0), "probably deg/s"),
        ("acceleration", (0.0, 0.1, 1.0), "probably g;"),
        ("acceleration", (0.0, 0.0, 1000.0), "probably mg"),
        ("orientation", (1.0, 0.0, 0.0, 0.0), "order is w, x, y, z"),
        ("supply", (7.4,), "probably in V"),
        ("enable", (2.0,), "must be 0 or 1"),
    ],
)
def test_what_the_whole_robot_has(signals, hinge, role, rows, said):
    suspected(robotwide(signals(), role, rows), hinge, said)


def test_a_quaternion_has_length_one(signals, hinge):
    with pytest.raises(ParameterError, match="of length 1"):
        align.record("run", robotwide(signals(), "orientation", (1.0, 0, 0, 1.0)), hinge)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"q": 1.4, "dq": 0.8},
        {"command_position": 2.5},
        {"q": 0.3, "dq": 0.3},
        {"q": 0.02, "dq": 0.02},
        {"dq": lambda k: None},
    ],
)
def test_no_alarm_at_hidden_effects(signals, hinge, changes):
    align.record("run", signals(**changes), hinge)


@pytest.mark.parametrize("step", [0.005, 0.05])
def test_no_alarm_at_coarse_sensors(signals, hinge, change, step):
    rng = np.random.default_rng(3)

    def coarse(track):
        return change(track, x=step * np.round(track.x / step + rng.normal(size=len(track.x))))

    def rough(track):
        x = track.x + step / 0.01 * rng.normal(size=len(track.x))
        return change(track, x=x)

    align.record("run", signals(q=coarse, dq=rough), hinge)


def with_torque(tracks, sign=np.copysign, load=0.0):
    """Tracks with the torque that a spring to the command would ask for."""
    by = {k.role: k for k in tracks}
    error = by["command_position"].x - by["q"].x
    tau = 4.0 * error + load
    return [*tracks, Track("tau", "hinge", by["q"].t, sign(np.abs(tau), tau), "tau")]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_torque_without_its_sign(signals, hinge, way):
    unsigned = with_torque(signals(), lambda size, tau: way * size)
    suspected(unsigned, hinge, "tau of hinge has one sign only.*probably tau is unsigned")


def test_torque_with_its_sign_or_of_a_loaded_joint_is_let_be(signals, hinge):
    align.record("run", with_torque(signals()), hinge)
    loaded = with_torque(signals(), load=2.5)
    assert np.all(loaded[-1].x > 0.0)
    align.record("run", loaded, hinge)


@pytest.mark.parametrize("value", [0.0, 0.9, -1e-3, 1e6])
def test_a_constant_has_no_delay_and_no_ratio_to_anything(value):
    """Also where its mean is rounded, as that of 8,005 times 0.9 is."""
    wave, constant = np.sin(0.01 * np.arange(8005)), np.full(8005, value)
    for pair in ((constant, wave), (wave, constant)):
        assert lags.lag(*pair, 0.005) == (0.0, 0.0)
        assert suspect.slope(*pair) == (1.0, 0.0)


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_a_shift_that_leaves_out_the_motion_has_no_correlation(noise):
    """Of a step at the begin nothing but rounding is left behind it."""
    t = 0.005 * np.arange(80)
    command = 0.4 * (t >= 0.01) + noise * np.sin(900.0 * t)
    q = 0.4 / (1.0 + np.exp(-(t - 0.06) / 0.01))
    time, _ = lags.lag(lags.rates(command, 0.005), lags.rates(q, 0.005), 0.005)
    assert time == 0.0 or abs(time - 0.05) < 0.02
    assert lags.following(command, np.where(t < 0.1, 0.3, 0.3 - t), 0.005) < lags.FOLLOWS


@pytest.mark.parametrize("digits", [4, 6])
def test_a_time_that_lost_its_digits_does_not_rise(signals, hinge, change, digits):
    def rounded(track):
        return change(track, t=np.array([float(f"{1.77e9 + t:.{digits}e}") for t in track.t]))

    tracks = signals(q=rounded, command_position=rounded, dq=rounded)
    with pytest.raises(ParameterError, match="time of q of hinge does not rise.*too few digits"):
        align.record("run", tracks, hinge)
