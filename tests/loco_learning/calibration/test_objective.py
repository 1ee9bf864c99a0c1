# SPDX-License-Identifier: Apache-2.0
"""A body is wrong by how far its sensors are from the recording."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration.mawe import LOSSES
from loco_learning.calibration.objective import Reference
from loco_learning.calibration.parameters import parameter_set
from loco_sim.plant.model import Model

TIGRILLO = Model("tigrillo")


def test_the_true_body_is_ten_times_nearer_than_the_default(recording, quick, truth):
    reference = Reference(recording, TIGRILLO, quick)
    right = reference.evaluate(truth)
    wrong = reference.evaluate(parameter_set("seven").default)
    for name in LOSSES:
        assert right.error[name] < 0.1 * wrong.error[name]
    assert right.fall == ""
    assert reference.joints == ["lf_kfe_joint", "rf_kfe_joint", "lh_kfe_joint", "rh_kfe_joint"]


def test_the_same_body_gives_the_same_error(recording, quick, truth):
    reference = Reference(recording, TIGRILLO, quick)
    assert reference.evaluate(truth).error == reference.evaluate(truth).error


def test_the_robots_lag_is_found(recording, quick, truth):
    late = dataclasses.replace(recording, q=np.roll(recording.q, 10, axis=0))
    found = Reference(late, TIGRILLO, quick).evaluate(truth)
    assert found.lag == pytest.approx(0.1, abs=0.02)


def test_only_what_is_needed_is_simulated(recording, quick):
    short = Reference(recording, TIGRILLO, quick)
    assert short.simulated == pytest.approx(1.6, abs=0.45)  # part of a period to settle, one of 1 s
    everything = Reference(recording, TIGRILLO, quick.replace(settle=99.0, periods=0))
    assert everything.simulated > 3.9
    assert len(everything.robot.periods) == len(short.robot.periods)


def test_a_recording_without_enough_periods_is_refused(recording, quick):
    with pytest.raises(ParameterError, match="at least 2 are needed"):
        Reference(recording, TIGRILLO, quick.replace(skip=3.5))


def test_a_recording_shorter_than_what_is_skipped_says_so(recording, quick):
    """Its command is a sine; nothing of it is left, which is not the same as constant."""
    with pytest.raises(ParameterError, match=r"lasts .* s, and its first 1000 s are not used"):
        Reference(recording, TIGRILLO, quick.replace(skip=1000.0))


def test_the_first_command_that_moves_cuts_the_periods(recording, quick, truth):
    """A first joint that is held still has no zero crossings; the others have."""
    held = recording.command.copy()
    first = TIGRILLO.make_robot().driven[0]
    column = recording.driven.index(TIGRILLO.make_robot().joints[first])
    held[:, column] = held[0, column]
    still = dataclasses.replace(recording, command=held)
    assert Reference(still, TIGRILLO, quick).robot.period == pytest.approx(
        Reference(recording, TIGRILLO, quick).robot.period, rel=0.01
    )
    held[:] = held[0]
    with pytest.raises(ParameterError, match="constant at"):
        Reference(still, TIGRILLO, quick)


def test_values_come_on_top_of_the_model_that_is_calibrated(recording, quick, truth):
    base = Model("tigrillo", {"springs.*_kfe_joint.damping": 0.02}, [{"name": "payload"}])
    made = Reference(recording, base, quick).with_body(truth)
    assert made.overrides["springs.*_kfe_joint.damping"] == 0.02
    assert made.overrides["springs.[lr]h_kfe_joint.stiffness"] == 440.0
    assert made.effects == base.effects
