# SPDX-License-Identifier: Apache-2.0
"""Rivals of an effect, and the intervals of its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.verdict import rivals, sensitivity
from loco_sim.effects import EFFECTS

from ..laws import COMMAND_DELAY, COULOMB, STRIBECK, TORQUE, fitted, hypothesis


def test_of_each_other_effect_the_best_is_tried_look_alikes_first():
    alike = EFFECTS["coulomb_friction"].identity.look_alikes[0].name
    hip = hypothesis(alike, TORQUE, place="hip")
    screened = [
        Screened(COULOMB, 0.9, (1.0,)),  # itself
        Screened(COMMAND_DELAY, 0.8, (1.0,)),
        Screened(hypothesis(alike, TORQUE), 0.2, (1.0,)),
        Screened(hip, 0.3, (1.0,)),
        Screened(hypothesis("armature", TORQUE), 0.7, (1.0,), dead=True),
        Screened(hypothesis("payload", TORQUE), 0.0, (1.0,)),
        Screened(hypothesis("cable_force", TORQUE), -0.1, (1.0,)),
    ]
    found = rivals.leading(screened, COULOMB)
    assert [s.hypothesis for s in found] == [hip, COMMAND_DELAY]
    assert rivals.leading(screened[::-1], COULOMB) == found


def test_a_few_names_and_a_few_places_are_weighed_the_best_of_each():
    beside = hypothesis("payload", TORQUE, place="foot")

    def model(law: Hypothesis) -> Fitted:
        return replace(fitted(law), parts=((beside, (1.0,)), (law, (1.0,))))

    names = [hypothesis(n, TORQUE, place=p) for n in "abcdefg" for p in ("knee", "hip")]
    places = [hypothesis("mine", TORQUE, place=p) for p in ("hip", "ankle", "hip", "toe")]
    models = [model(law) for law in (*places, *names)]
    kept = rivals.few(models, hypothesis("mine", TORQUE), [beside.key])
    laws = [m.parts[1][0] for m in kept]
    assert laws == [*places[:2], *names[: 2 * rivals.RIVAL_NAMES : 2]]
    assert len(places[:2]) == rivals.RIVAL_PLACES


def test_intervals_are_in_the_unit_and_may_pass_zero():
    strength, shape = sensitivity.estimates(
        STRIBECK, [1.0, 0.0], np.array([2.0, 0.98]), np.array([0.2, 0.2]), np.array([2.0, np.nan])
    )
    assert strength.value == pytest.approx(0.05)
    assert strength.low == pytest.approx(0.05 - 2.0 * 0.05)
    assert not strength.excludes_absent
    surer, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], np.array([0.5, 0.98]), *np.zeros((2, 2)))
    assert surer.low == pytest.approx(0.5 * 0.05) and surer.excludes_absent
    assert (strength.absent, strength.sign) == (0.0, 1)
    assert strength.spread == pytest.approx(0.01)
    assert shape.absent is None
    assert shape.low == pytest.approx(0.1 * np.exp(-0.98))
    wide = np.array([np.inf, 1.0])
    unknown, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), wide)
    assert (unknown.low, unknown.high) == (-np.inf, np.inf) and not unknown.excludes_absent


def test_an_effect_of_which_size_and_shape_show_together_is_there():
    """A cable's stiffness and free length may show as one force: neither is known by itself."""
    wide, sure = np.array([9.0, 9.0]), np.array([0.1, np.nan])
    strength, shape = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), sure)
    assert strength.low < 0.0 < strength.high
    assert strength.excludes_absent and not shape.excludes_absent


def test_halves_follow_flat():
    whole = [np.zeros((4, 2)), np.zeros((2, 2))]
    assert sensitivity.halves(whole).tolist() == [0] * 4 + [1] * 4 + [2] * 2 + [3] * 2
