# SPDX-License-Identifier: Apache-2.0
"""Effects that a linear step does not find: limits that are not reached, friction that stops."""

import pytest

from loco_learning.gap.screen import IDLE
from loco_learning.gap.screen import screen as screened

LATE = {"name": "command_delay", "delay": 0.02}


def tried(bench, effect, name):
    """What an effect of some name explains of what an effect makes."""
    case, offered = bench([effect])
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
