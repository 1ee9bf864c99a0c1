# SPDX-License-Identifier: Apache-2.0
"""Recordings that cannot be used are refused, each for its own reason and in one line."""

from dataclasses import replace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.importing import align, checks


def refused(tracks, robot, said, **options):
    with pytest.raises(ParameterError, match=said) as error:
        align.record("run", tracks, robot, **options)
    text = str(error.value)
    assert text.startswith("run: ") and "\n" not in text


def spoilt(change, row, value):
    def spoil(track):
        x = track.x.copy()
        x[row] = value
        return change(track, x=x)

    return spoil


def test_no_time_in_common(signals, hinge, change):
    tracks = signals(command_position=lambda k: change(k, t=k.t + 100.0))
    refused(
        tracks, hinge, r"no time in common .*measured from 0.000 to 3.990 s.*commanded from 100"
    )


@pytest.mark.parametrize(
    ("role", "said"),
    [("q", "role q .* is missing; it has command"), ("command_position", "a command is missing")],
)
def test_a_missing_role(signals, hinge, role, said):
    refused(signals(**{role: lambda k: None}), hinge, said)


def test_a_missing_command_for_the_drive(signals, one_joint, torque_drive):
    robot = one_joint(drive=torque_drive)
    refused(signals(), robot, "role command_torque of joint hinge is missing.*has command_position")


@pytest.mark.parametrize(
    ("role", "value"),
    [("q", np.inf), ("dq", np.inf), ("command_position", np.nan), ("command_position", np.inf)],
)
def test_values_that_are_not_finite(signals, hinge, change, role, value):
    tracks = signals(**{role: spoilt(change, 17, value)})
    refused(tracks, hinge, f"{role} of hinge has 1 values of 400 .*first in row 17")


@pytest.mark.parametrize("role", ["q", "dq"])
def test_a_reading_of_nan_is_none(signals, hinge, change, role):
    """As drivers of ros2_control write it; the motion between the others is kept."""
    made = align.record("run", signals(**{role: spoilt(change, slice(3, 390, 7), np.nan)}), hinge)
    whole = align.record("run", signals(), hinge)
    assert any(f"{role} of hinge: 56 of 400 readings are NaN" in note for note in made.notes)
    known = np.isfinite(made.signals[role][:, 0])
    error = made.signals[role][known, 0] - whole.signals[role][known, 0]
    assert len(made.t) == len(whole.t)
    assert np.max(np.abs(error)) < 0.02 * np.std(whole.signals[role])


def test_a_required_signal_without_any_value(signals, hinge, change):
    refused(signals(q=lambda k: change(k, x=k.x * np.nan)), hinge, "q of hinge has only NaN")
    refused(signals(q=lambda k: change(k, t=k.t[:0], x=k.x[:0])), hinge, "no samples")


def test_an_optional_signal_without_any_value_was_not_measured(signals, hinge, change):
    made = align.record("run", signals(dq=lambda k: change(k, x=k.x * np.nan)), hinge)
    assert not made.has("dq") and any("not measured" in note for note in made.notes)


def test_a_speed_of_zero_beside_a_motion_was_not_measured(signals, hinge):
    made = align.record("run", signals(dq=0.0), hinge)
    assert not made.has("dq") and any("dq of hinge is 0 all the time" in n for n in made.notes)


def test_a_constant_signal(signals, hinge, change):
    tracks = signals(q=lambda k: change(k, x=np.full(len(k.x), 0.25)), dq=lambda k: None)
    refused(tracks, hinge, "position of hinge is constant at 0.25")


def test_a_constant_command_is_an_experiment(signals, hinge, change):
    made = align.record("drop", signals(command_position=0.0), hinge)
    assert np.ptp(made.command["position"]) == 0.0


@pytest.mark.parametrize(("seconds", "rate"), [(0.2, 1000.0), (0.4, 100.0)])
def test_too_short(signals, hinge, seconds, rate):
    refused(signals(seconds=seconds, rate=rate), hinge, "too short: at least 50 and 0.25 s")


def test_other_joints_than_the_model(signals, one_joint):
    refused(signals(), one_joint("wheel"), r"joints hinge are not those of robot 'one' \(wheel\)")


def test_a_signal_given_twice(signals, hinge, change):
    tracks = [*signals(), *(change(k, source="column 'again'") for k in signals())]
    refused(tracks, hinge, "given twice, by column 'command_position' and by column 'again'")


def test_several_experiments_in_one_file(signals, hinge, change):
    tracks = signals(q=lambda k: change(k, t=k.t % 2.0))
    refused(tracks, hinge, r"jumps back by 1.99 s at row 200.*Cut them")


def test_a_joint_that_stands_while_its_command_moves_is_refused_one_at_rest_is_not(signals):
    swing, rest = (next(t for t in signals() if t.role == "q") for _ in range(2))
    command = next(t for t in signals() if t.role == "command_position")
    tracks = [
        replace(swing, place="knee"), replace(command, place="knee"),
        replace(rest, place="hip", x=np.full(len(rest.x), 0.3)),
        replace(command, place="hip", x=np.full(len(command.x), 0.3)),
    ]  # fmt: skip
    checks.moving("run", tracks)
    tracks[3] = replace(tracks[3], x=command.x)
    with pytest.raises(
        ParameterError, match="position of hip is constant at 0.3 while its command"
    ):
        checks.moving("run", tracks)
    tracks[3] = replace(tracks[3], role="command_velocity")  # holds no position by itself
    checks.moving("run", tracks)


@pytest.mark.parametrize(
    ("count", "seconds", "fits"),
    [(50, 0.25, True), (49, 1.0, False), (50, 0.2499, False), (0, 0.0, False), (5000, 0.25, True)],
)
def test_how_long_is_long_enough_hangs_on_the_duration_not_on_the_clock(count, seconds, fits):
    for start in (0.0, 1.7e9):  # seconds since 1970
        axis = start + np.linspace(0.0, seconds, count)
        if start:
            axis[-1:] += 1e-6  # stamps of that size know a quarter of a microsecond
        if fits:
            checks.long_enough("run", axis)
        else:
            with pytest.raises(ParameterError, match=f"have {count} samples over"):
                checks.long_enough("run", axis)
