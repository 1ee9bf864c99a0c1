# SPDX-License-Identifier: Apache-2.0
"""Commands and states with their own stamps end on one time axis."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration.recording import align, compared

JOINTS = ("hip", "knee")
ROBOT = SimpleNamespace(name="leg", joints=JOINTS, driven=np.array([0]))


def states(n=101, dt=0.01, start=0.0):
    t = start + dt * np.arange(n)
    return t, np.stack([t, 2.0 * t], axis=1), JOINTS


def commands(n=101, dt=0.01, start=0.0):
    t = start + dt * np.arange(n)
    return t, np.sin(t)[:, None], ("hip",)


def test_equal_stamps_stay_as_they_are():
    made = align("bag", states(), commands(), 100.0)
    np.testing.assert_allclose(made.t, states()[0])
    np.testing.assert_allclose(made.q, states()[1])
    np.testing.assert_allclose(made.command, commands()[1])
    assert made.dt == pytest.approx(0.01)


def test_a_command_holds_until_the_next_and_angles_are_interpolated():
    made = align("bag", states(51, 0.02), commands(11, 0.1, 0.05), 100.0)
    assert made.t[0] == pytest.approx(0.05)
    assert made.t[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(made.q[:, 0], made.t)
    np.testing.assert_allclose(made.command[:10, 0], np.sin(0.05))
    np.testing.assert_allclose(made.command[10, 0], np.sin(0.15))


def test_columns_are_found_by_name_in_any_order():
    t, q, _ = states()
    made = align("bag", (t, q[:, ::-1], ("knee", "hip")), commands(), 100.0)
    np.testing.assert_allclose(made.sensors_of(ROBOT)[:, 0], 2.0 * made.t)
    assert made.commands_of(ROBOT).q.shape == (101, 1)
    assert compared(ROBOT) == ["knee"]


def test_joints_that_the_robot_needs_and_the_recording_lacks_are_named():
    made = align("bag", states(), commands(), 100.0)
    other = SimpleNamespace(name="other", joints=("hip", "ankle"), driven=np.array([1]))
    with pytest.raises(ParameterError, match="no commands of ankle.*'other'; it has hip"):
        made.commands_of(other)
    other = SimpleNamespace(name="other", joints=("hip", "ankle"), driven=np.array([0]))
    with pytest.raises(ParameterError, match="no sensors of ankle"):
        made.sensors_of(other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s, c: (s, commands(101, 0.01, 5.0)), "no time in common"),
        (lambda s, c: (states(5, 0.5), c), "joint states pause for 0.50 s"),
        (lambda s, c: (s, commands(1)), "joint commands need at least two"),
        (lambda s, c: ((s[0][::-1], s[1], s[2]), c), "rising order"),
        (lambda s, c: ((s[0], np.where(s[1] > 0.5, np.nan, s[1]), s[2]), c), "not finite"),
    ],
)
def test_what_does_not_fit_together_is_refused(change, message):
    with pytest.raises(ParameterError, match=f"bag.*{message}"):
        align("bag", *change(states(), commands()), 100.0)
