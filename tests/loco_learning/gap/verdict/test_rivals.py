# SPDX-License-Identifier: Apache-2.0
"""Rivals of an effect."""

from __future__ import annotations

from dataclasses import replace

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.verdict import rivals
from loco_sim.effects import EFFECTS

from ..laws import COMMAND_DELAY, COULOMB, TORQUE, fitted, hypothesis


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
    kept = rivals.select(models, hypothesis("mine", TORQUE), [beside.key])
    laws = [m.parts[1][0] for m in kept]
    assert laws == [*places[:2], *names[: 2 * rivals.RIVAL_NAMES : 2]]
    assert len(places[:2]) == rivals.RIVAL_PLACES
