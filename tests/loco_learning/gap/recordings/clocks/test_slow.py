# SPDX-License-Identifier: Apache-2.0
"""A log that keeps one in a few of the commands that a drive got."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.importing import align
from loco_learning.gap.recordings.clocks import slow
from loco_learning.gap.recordings.record import Doubt
from loco_learning.gap.recordings.tracks import Track

WORDS = "logged at"


@pytest.fixture
def commanded(hinge):
    """A hinge whose robot.yaml says that it is commanded at 100 Hz."""
    return replace(hinge, control_rate=100.0, rate_stated=True)


def thin(every, **change):
    return lambda track: replace(track, t=track.t[::every], x=track.x[::every], **change)


def record(signals, robot, every, **change):
    kept = {role: thin(every) for role in ("q", "dq")}
    return align.record("run", signals(**kept, command_position=thin(every, **change)), robot)


@pytest.mark.parametrize("every", [2, 4, 5])
def test_a_command_between_the_rows_of_a_log_is_drawn_as_a_curve(signals, commanded, every):
    made, whole = record(signals, commanded, every), signals()[0].x
    command = made.command["position"][:, 0]
    assert made.dt == pytest.approx(0.01)
    off = np.abs(command - whole[: len(command)])[50:-50]
    held = np.abs(np.repeat(whole[::every], every)[: len(whole)] - whole)[50:-50]
    assert np.max(off) < 0.05 * np.max(held)
    known = np.isfinite(made.signals["q"][:, 0])
    assert np.mean(known) == pytest.approx(1.0 / every, abs=0.01)  # nothing was read between rows
    assert any(WORDS in note and isinstance(note, Doubt) for note in made.notes)


def test_commands_faster_than_the_physics_are_drawn_once_per_step(signals, commanded):
    made = record(signals, replace(commanded, control_rate=8000.0), 5)
    assert made.dt == pytest.approx(1.0 / commanded.sim.physics_rate)


def lost(every, of):
    """A log that keeps one value in `every`; of these one in `of` is lost."""
    def change(track):
        kept = np.arange(0, len(track.t), every)
        kept = np.delete(kept, np.arange(of // 2, len(kept), of))
        return replace(track, t=track.t[kept], x=track.x[kept])
    return change


@pytest.mark.parametrize("of", [15, 30, 1000])
@pytest.mark.parametrize("loser", ["q", "dq", "command_position", "q command_position"])
def test_a_log_that_lost_a_few_values_is_as_slow_as_without_the_loss(signals, commanded, of, loser):
    """One empty cell let all commands be held until the next row: friction was named on a null."""
    roles = ("q", "dq", "command_position")
    kept = {r: lost(2, of) if r in loser.split() else thin(2) for r in roles}
    made = align.record("run", signals(seconds=8.0, **kept), commanded)
    whole = signals(seconds=8.0)[0].x
    command = made.command["position"][:, 0]
    assert made.dt == pytest.approx(0.01)
    off = np.abs(command - whole[: len(command)])[50:-50]
    held = np.abs(np.repeat(whole[::2], 2)[: len(whole)] - whole)[50:-50]
    assert np.max(off) < 0.2 * np.max(held)


CURVES = {
    "smooth": lambda t: 0.9 * np.sin(4.0 * t) + 0.4 * np.sin(11.0 * t),
    "corners": lambda t: np.abs((1.3 * t) % 2.0 - 1.0),
    "steps": lambda t: np.sign(np.sin(3.0 * t)),
}


@pytest.mark.parametrize(("shape", "degree"), [("smooth", 5), ("corners", 3), ("steps", 3)])
def test_the_curve_between_samples_is_the_one_that_errs_least(monkeypatch, shape, degree):
    axis, robot = np.arange(0.0, 9.9, 0.005), SimpleNamespace(control_rate=200.0)
    times = np.arange(0.0, 10.0, 0.02)
    track = Track("command_position", "hinge", times, CURVES[shape](times), "a")
    made, told = slow.interpolated(track, axis, robot)

    def rms(values):
        return np.sqrt(np.mean(np.square(values[100:-100])))

    error = rms(made - CURVES[shape](axis))
    assert 0.5 * error < rms(told) < 3.0 * error
    for tried in (3, 5):
        monkeypatch.setattr(slow, "RATES", replace(slow.RATES, degrees=(tried,)))
        alone, _ = slow.interpolated(track, axis, robot)
        assert np.array_equal(alone, made) is (tried == degree)
        assert error <= rms(alone - CURVES[shape](axis))


@pytest.mark.parametrize("apart", [1e-9, 1e-6, 1e-4, 1e-3])
def test_two_rows_close_together_make_no_wild_command(apart):
    times = np.arange(0.0, 10.0, 0.02)
    times[51] = times[50] + apart
    noise = 1e-6 * np.random.default_rng(1).normal(size=len(times))
    track = Track("command_position", "hinge", times, 0.5 * np.sin(3.0 * times) + noise, "a")
    made, _ = slow.interpolated(track, np.arange(0.0, 9.9, 0.005), SimpleNamespace(control_rate=200))
    assert np.max(np.abs(made)) < 0.51


@pytest.mark.parametrize("rate", [30.0, 40.0])
def test_rates_that_are_no_multiples_come_on_average_when_they_were_given(signals, commanded, rate):
    tracks = [t for t in signals(rate=rate) if t.role != "dq"]
    made = align.record("run", tracks, commanded)
    late = made.t - 0.5 * 0.01 + 0.5 * made.dt  # held for a period of the drive
    true = 0.9 * np.sin(4.0 * late) + 0.4 * np.sin(11.0 * late)
    assert 1.0 / made.dt >= 100.0
    assert np.max(np.abs(made.command["position"][:, 0] - true)[50:-50]) < 4e-3


@pytest.mark.parametrize("every", [2, 5])
def test_how_far_off_the_curve_may_be_is_told_where_it_is(signals, commanded, every):
    made, whole = record(signals, commanded, every), signals()[0].x
    error = made.command["position"][:, 0] - whole[: len(made.t)]
    rms, told = (np.sqrt(np.mean(np.square(x[50:-50]))) for x in (error, made.unsure["position"]))
    assert 0.3 * rms < told < 10.0 * rms


def test_steps_in_a_slow_log_are_in_doubt_by_half_of_them(signals, commanded):
    def steps(track):
        return replace(track, t=track.t[::4], x=np.sign(np.sin(3.0 * track.t[::4])))

    kept = {role: thin(4) for role in ("q", "dq")}
    made = align.record("run", signals(**kept, command_position=steps), commanded)
    command, off = made.command["position"], made.unsure["position"]
    assert np.max(np.abs(command)) < 1.01  # it does not swing about them
    assert np.max(np.abs(off)) > 0.4 and np.mean(np.abs(off) > 0.05) < 0.2


@pytest.mark.parametrize(
    "case", ["said to be held", "another rate", "no rate of commands", "a topic of its own"]
)
def test_commands_that_are_all_there_are_held(signals, commanded, hinge, change, case):
    said = {"between": "hold"} if case == "said to be held" else {}
    robot = hinge if case == "no rate of commands" else commanded
    late = 1e-3 if case == "a topic of its own" else 0.0
    tracks = [thin(2)(t) for t in signals()]
    tracks[0] = change(tracks[0], t=tracks[0].t + late, **said)
    made = align.record("run", tracks, robot, rate=50.0 if case == "another rate" else 0.0)
    assert made.dt == pytest.approx(0.02) and not made.unsure
    assert not any(WORDS in note for note in made.notes)
