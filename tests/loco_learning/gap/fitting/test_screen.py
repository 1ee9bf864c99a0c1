# SPDX-License-Identifier: Apache-2.0
"""Effects that a linear step does not find: limits that are not reached, friction that stops."""

from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.screen import IDLE
from loco_learning.gap.fitting.screen import screen as screened
from loco_learning.gap.hypotheses.bundles import Bundle
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_sim.effects.offers import Hints
from loco_sim.robot import robot

LATE = {"name": "command_delay", "delay": 0.02}


def tried(bench, effect, name):
    """What an effect of some name explains of what an effect makes."""
    case, offered = bench([effect])
    case = case.kept()
    residual = case.vector([], {}, case.fitted, coarse=True)
    (found,) = screened(case, offered[name], [], {}, case.fitted, residual)
    return found


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "torque_limit", "reduction": 0.8},
        {"name": "stribeck_friction", "torque": 4.3, "velocity": 0.085},
        {"name": "coulomb_friction", "torque": 3.0},
        LATE,
    ],
)
def test_what_is_missing_is_found_at_any_size(bench, effect):
    found = tried(bench, effect, effect["name"])
    assert found.share > IDLE
    assert not found.dead


def test_the_longest_legal_delay_can_be_simulated(bench):
    case, _ = bench([LATE])
    assert len(case.vector([{"name": "command_delay", "delay": 1.0}])) > 0


def test_what_cannot_explain_anything_does_not(bench):
    found = tried(bench, {"name": "torque_limit", "reduction": 0.8}, "command_delay")
    assert found.share < IDLE


def test_a_size_that_is_far_too_loud_and_turns_round_does_not_end_the_search():
    """A drive that rounds its encoder does at a fifth of sag the contrary of at a fortieth."""
    wave = np.sin(np.arange(200.0))

    def vector(specs, overrides, only, coarse):
        sag = sum(spec["sag"] for spec in specs)
        return wave * ((sag if sag < 0.1 else -sag) - 0.025)

    case = SimpleNamespace(vector=vector, channel_of=lambda only: np.zeros(200, int))
    hints = Hints(np.full(1, -0.5), np.full(1, 0.5))
    offered = offer(robot.load("servo_pendulum"), ("q",), hints)
    (hypothesis,) = [h for h in offered if h.effect == "supply_sag"]
    (found,) = screened(case, Bundle((hypothesis,), (None,)), [], {}, [0], vector([], {}, [0], 1))
    assert found.share > 0.9
    assert hypothesis.term(found.x).params["sag"] == pytest.approx(0.025, rel=0.3)
