# SPDX-License-Identifier: Apache-2.0
"""Laws of rounding that readings show."""

import numpy as np
import pytest

from loco_learning.gap import lattice
from loco_learning.gap.record import Record
from loco_sim import robot

T = np.arange(800) / 100.0
MOTION = 0.4 * np.sin(2.0 * T) + 0.003 * np.sin(31.0 * T)


@pytest.mark.parametrize("step", [0.004, 0.01, 0.05])
def test_the_step_of_rounded_readings_comes_back(step):
    assert lattice.step_of(step * np.round(MOTION / step)) == pytest.approx(step, rel=1e-6)


def test_readings_that_are_not_rounded_have_no_step():
    rng = np.random.default_rng(2)
    assert lattice.step_of(MOTION) == 0.0
    assert lattice.step_of(0.01 * np.round(MOTION / 0.01) + 1e-4 * rng.normal(size=800)) == 0.0
    assert lattice.step_of(np.zeros(800)) == 0.0
    assert lattice.step_of(np.full(800, np.nan)) == 0.0


def gap_of(step, after=1.0, effects=("*",), name="servo_pendulum"):
    plant = robot.load(name)
    joint = plant.joints[0]
    q = step * np.round(MOTION / step)
    record = Record("r", T, {"position": q[:, None]}, (joint,), {"q": q[:, None]}, (joint,))
    gap = {"verdict": "no gap", "names": [], "terms": [], "gap": {"after": after},
           "model": {"effects": []}}  # fmt: skip
    return lattice.tell(gap, [record], plant, effects)


def test_a_step_beyond_that_of_the_model_is_named_and_its_own_is_not():
    coarse = gap_of(0.02)
    assert (coarse["verdict"], coarse["names"]) == ("named", ["quantisation"])
    (effect,) = coarse["model"]["effects"]
    assert effect == {"name": "quantisation", "joint": "pivot", "step": pytest.approx(0.02)}
    assert gap_of(0.00506)["verdict"] == "no gap"


def test_it_is_not_named_where_more_is_left_or_it_is_not_asked_for():
    assert gap_of(0.02, after=5.0)["names"] == []
    assert gap_of(0.02, effects=("*_friction",))["names"] == []
