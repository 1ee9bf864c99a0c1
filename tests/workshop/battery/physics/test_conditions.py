# SPDX-License-Identifier: Apache-2.0
"""Recordings are spoiled as they say, and no more."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from loco_workshop.battery.physics import conditions, excitation, machines, plant
from loco_workshop.battery.physics.conditions import Condition

pytestmark = pytest.mark.usefixtures("short")


@pytest.fixture(scope="module")
def whole():
    m = machines.get("linear_axis")
    command = np.zeros((500, 1)), np.zeros((500, 1))
    return plant.record(m, (), command, 1)


def test_a_third_of_the_models_is_off_and_every_way_comes():
    drawn = [conditions.draw(10_000 + i) for i in range(600)]
    assert 150 < sum(c.off for c in drawn) < 250
    assert set(Counter(c.way for c in drawn)) == set(conditions.WAYS)
    assert {c.noise for c in drawn} == {0.5, 1.0, 2.0}


@pytest.mark.parametrize("way", conditions.WAYS)
def test_each_way_changes_what_it_says(whole, way):
    one = conditions.recorded(whole, Condition(way=way), 3)
    assert len(one.stamp) == len(one.q)
    assert np.all(np.diff(one.stamp) >= 0.0)
    late = one.stamp - whole.stamp[: len(one.stamp)]
    seen = {
        "": np.array_equal(one.q, whole.q) and np.array_equal(one.stamp, whole.stamp),
        "late": np.all(late >= 0.0) and 0.0 < late.max() <= conditions.LATE,
        "dropped": 0.9 < len(one.q) / len(whole.q) < 1.0,
        "half": len(one.q) == len(whole.q) // 2 and len(one.t) == len(whole.t),
        "cut": one.stamp[0] == one.t[0] == conditions.CUT,
    }
    assert seen[way]


def test_a_model_that_is_off_is_off_by_a_little_everywhere():
    m = machines.get("tigrillo")
    real = conditions.machine_of(m, Condition(off=True), 4)
    for name, most in (("mass", machines.OFF[0]), ("inertia", 0.09)):
        share = getattr(real.body, name) / np.where(
            getattr(m.body, name) == 0.0, 1.0, getattr(m.body, name)
        )
        share = share[getattr(m.body, name) != 0.0]
        assert 0.0 < np.abs(share - 1.0).max() <= most
    assert np.ptp(real.drives[m.driven, 1]) > 0.0
    same = conditions.machine_of(m, Condition(), 4)
    assert same.body is m.body and same.motor is None


def test_a_motor_that_is_off_moves_an_impedance_drive(whole):
    m = machines.get("linear_axis")
    moved = excitation.command(m, "chirp", 3)
    strong = replace(m, motor=np.array([1.03]))
    gap = plant.record(strong, (), moved, 1).q - plant.record(m, (), moved, 1).q
    assert 1e-4 < np.abs(gap).max() < 0.02
