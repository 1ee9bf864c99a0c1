# SPDX-License-Identifier: Apache-2.0
"""What measures of chapter 8 say of trials whose answer is known."""

import numpy as np
import pytest

from loco_learning.thesis.registry import MEASURES

from .made import Given, case

EXPERIMENT = {"effects": [{"start": 20.0}], "learner": {"stand": 1.0, "train": 9.0}}


def trial(variant, survived=True, fall="", slip=0.0, error_at=None, **verdict):
    """A trial whose error is small but for one moment."""
    t = np.arange(0.0, 30.0, 0.5)
    error = np.where(t == error_at, 0.9, 0.05)
    usual = {"amplitude": 1.0, "nrmse": 0.1, "frequency": 1.6, "target_frequency": 1.7}
    return case(
        variant, verdict={"survived": survived, "fall": fall, "slip": slip} | usual | verdict,
        experiment=EXPERIMENT, curves={"error_t": t, "error": error},
    )  # fmt: skip


def given(*trials, name="chapter8"):
    return Given(("pse", "rse"), **{name: list(trials)})


def test_trials_without_a_clock_are_counted():
    trials = given(trial("pse"), trial("rse", False, "roll"), trial("rse", False, slip=3.0))
    assert MEASURES["clock_keeps_the_gait"](trials)["survived"].tolist() == [1.0]
    found = MEASURES["no_clock_fails"](trials)
    assert (found["failed"].tolist(), found["fell"].tolist()) == ([1.0, 1.0], [1.0, 0.0])
    found = MEASURES["phase_drifts"](trials)
    assert found["rse_slip"].tolist() == [0.0, 3.0]
    assert found["rse_frequency"] == pytest.approx([1.6 / 1.7, 1.6 / 1.7])


@pytest.mark.parametrize(
    ("moment", "early"),
    [
        (5.0, 0.0),  # while it learns, nothing drives by reflex
        (15.0, 1.0),
        (25.0, 0.0),  # after the delay began that is to make it fail
        (None, 0.0),
    ],
)
def test_an_error_is_early_between_learning_and_the_delay(moment, early):
    trials = given(trial("pse", nrmse=0.2), trial("rse", error_at=moment, nrmse=0.7))
    found = MEASURES["error_overshoots"](trials)
    assert {name: values.tolist() for name, values in found.items()} == {
        "pse_nrmse": [0.2], "rse_nrmse": [0.7], "rse_early": [early]
    }  # fmt: skip


def test_each_trial_tells_how_far_strides_shrink():
    trials = given(
        trial("pse", amplitude=0.9), trial("pse", amplitude=0.8), trial("rse", amplitude=0.3),
        trial("rse", amplitude=0.6),
    )  # fmt: skip
    found = MEASURES["amplitude_decays"](trials)
    assert found["rse_amplitude"].tolist() == [0.3, 0.6]
    assert found["pse_amplitude"].tolist() == [0.9, 0.8]


def test_a_clock_is_told_beside_its_absence():
    trials = given(
        trial("pse", slip=0.1, nrmse=0.02), trial("pse", slip=0.2, nrmse=0.01),
        *(trial("rse", slip=slip, nrmse=slip / 10.0) for slip in (1.0, 2.0, 9.0)),
        name="clock",
    )  # fmt: skip
    found = MEASURES["clock_ablation"](trials)
    assert found["clock_slip"].tolist() == [0.1, 0.2]
    assert found["no_clock_slip"].tolist() == [1.0, 2.0, 9.0]
    assert found["clock_nrmse"].tolist() == [0.02, 0.01]
    assert found["no_clock_nrmse"] == pytest.approx([0.1, 0.2, 0.9])
