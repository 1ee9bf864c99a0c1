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
    assert MEASURES["clock_keeps_the_gait"](trials) == {"survived": 1.0, "trials": 1.0}
    assert MEASURES["no_clock_fails"](trials) == {"failed": 1.0, "fell": 0.5}
    assert MEASURES["phase_drifts"](trials)["rse_slip"] == 1.5


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
    assert found == {"pse_nrmse": 0.2, "rse_nrmse": 0.7, "rse_early": early}


def test_the_worst_trial_of_each_kind_tells_how_far_strides_shrink():
    trials = given(
        trial("pse", amplitude=0.9), trial("pse", amplitude=0.8), trial("rse", amplitude=0.3),
        trial("rse", amplitude=0.6),
    )  # fmt: skip
    found = MEASURES["amplitude_decays"](trials)
    assert found == {"rse_amplitude": 0.3, "pse_amplitude": 0.8}


def test_a_clock_is_judged_by_its_worst_trial_and_its_absence_by_the_middle_one():
    trials = given(
        trial("pse", slip=0.1, nrmse=0.02), trial("pse", slip=0.2, nrmse=0.01),
        *(trial("rse", slip=slip, nrmse=slip / 10.0) for slip in (1.0, 2.0, 9.0)),
        name="clock",
    )  # fmt: skip
    assert MEASURES["clock_ablation"](trials) == pytest.approx(
        {"clock_slip": 0.2, "no_clock_slip": 2.0, "clock_nrmse": 0.02, "no_clock_nrmse": 0.2}
    )
