# SPDX-License-Identifier: Apache-2.0
"""The pool of experiments to choose the next one from."""

from __future__ import annotations

import pytest

from loco_learning.gap.proposals import pool
from loco_learning.gap.proposals.excitation import library
from loco_sim.plant.model import Model


@pytest.fixture(scope="module")
def experiments():
    return library(Model("tigrillo"))


def named(experiments):
    return {e.name for e in experiments}


def robot(overrides):
    return Model("tigrillo", overrides).make_robot()


def test_the_next_experiment_is_held_as_the_recordings_were(experiments):
    model = Model("tigrillo")
    air, ground = robot({"fixed_base": True, "height": 1.0}), robot({})
    on_stand = pool.usable(model, experiments, [air])
    free = pool.usable(model, experiments, [ground])
    assert {"chirp_large_air", "steps_air"} <= named(on_stand)
    assert {"bound_fast", "chirp_large_ground"} <= named(free)
    assert not named(on_stand) & named(free)
    assert named(pool.usable(model, experiments, [air, ground])) == named(experiments)


def test_a_robot_that_is_always_bolted_keeps_all_of_its_experiments():
    model = Model("servo_pendulum")
    made = library(model)
    assert pool.usable(model, made, [model.make_robot()]) == made


def test_where_none_is_held_alike_all_are_left(experiments):
    on_stand = [e for e in experiments if e.overrides.get("fixed_base")]
    assert pool.usable(Model("tigrillo"), on_stand, [robot({})]) == on_stand
