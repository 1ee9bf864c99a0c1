# SPDX-License-Identifier: Apache-2.0
"""What values that nobody knows exactly add to the intervals of sizes."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.prediction import nominal
from loco_learning.gap.verdict import doubt
from loco_sim.robot import robot

# Value, deviation and group of each name: a servo's two values change together.
KNOWN = {"mass": (2.0, 0.04, 0), "inertia": (0.01, 0.0004, 1), "kp": (100.0, 2.0, 2),
         "kd": (4.0, 0.08, 2)}  # fmt: skip
SLOPE = {"mass": (3.0, 0.0), "inertia": (0.0, 500.0), "kp": (0.1, 0.2), "kd": (1.0, -1.0)}


@dataclass
class Case:
    """Residuals that are linear in the values of the robot; two records of one channel."""

    loose: SimpleNamespace | None
    cap: float = 1e5

    def kept(self):
        return self

    def whitened(self, specs, values, coarse):
        assert coarse
        moved = {n: values.get(n, at) - at for n, (at, _, _) in KNOWN.items()}
        return [np.array([[sum(SLOPE[n][row] * by for n, by in moved.items())]]) for row in (0, 1)]


def case() -> Case:
    values, spread, of = (np.array(column) for column in zip(*KNOWN.values(), strict=True))
    return Case(
        SimpleNamespace(names=[*KNOWN], nominal=values, spread=spread, of=of, at=np.zeros(3))
    )


def model(**values: float) -> SimpleNamespace:
    return SimpleNamespace(specs=[], overrides={}, settled=values, loose=values)


def test_what_changes_together_is_one_group():
    assert doubt.groups(case(), model()) == [
        {"mass": (2.0, 0.04)},
        {"inertia": (0.01, 0.0004)},
        {"kp": (100.0, 2.0), "kd": (4.0, 0.08)},
    ]


def test_a_column_is_what_one_deviation_of_a_group_does():
    matrix, now = doubt.columns(case(), model())
    wanted = [[0.12, 0.0, 0.28], [0.0, 0.2, 0.32]]
    assert matrix == pytest.approx(np.array(wanted))
    assert now.tolist() == [0.0, 0.0, 0.0]


def test_where_values_went_is_told_in_deviations_and_columns_are_about_it():
    settled = {"mass": 2.02, "kp": 97.0, "kd": 3.88}
    matrix, now = doubt.columns(case(), model(**settled))
    assert now == pytest.approx([0.5, 0.0, -1.5])
    assert matrix == pytest.approx(doubt.columns(case(), model())[0])


def test_a_value_that_is_fitted_freely_is_in_no_doubt():
    free = model(kp=110.0)
    free.overrides = {"kp": 110.0}
    matrix, now = doubt.columns(case(), free)
    assert matrix.shape == (2, 2) and now.shape == (2,)
    assert matrix == pytest.approx(doubt.columns(case(), model())[0][:, :2])


def test_where_nothing_is_in_doubt_there_is_no_column():
    everything = model()
    everything.overrides = dict.fromkeys(KNOWN, 1.0)
    matrix, now = doubt.columns(case(), everything)
    assert matrix.shape == (2, 0) and now.shape == (0,)
    assert doubt.none(7)[0].shape == (7, 0)


def test_a_model_that_diverges_counts_as_its_cap_and_no_more():
    wild = case()
    wild.cap = 0.1
    assert np.abs(doubt.columns(wild, model())[0]).max() == 0.1
    wild.whitened = lambda specs, values, coarse: [
        np.array([[np.nan if values.get("mass") else 0.0]])
    ]
    matrix, _ = doubt.columns(wild, model())
    assert np.isfinite(matrix).all()


def test_a_robot_of_which_nothing_is_refitted_has_the_priors_of_every_robot():
    plant = robot.load("servo_pendulum")
    bare = Case(None)
    bare.forward = SimpleNamespace(given=lambda: plant)
    found = doubt.groups(bare, model())
    assert [[*group] for group in found] == [[*one] for one in nominal.priors(plant)]
    for group, prior in zip(found, nominal.priors(plant), strict=True):
        for name, (value, spread) in group.items():
            assert value == nominal.nominal_value(plant, name) and spread == prior[name]
    weighed = model()
    weighed.overrides = dict.fromkeys(found[0], 1.0)
    assert doubt.groups(bare, weighed) == found[1:]
