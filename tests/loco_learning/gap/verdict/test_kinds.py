# SPDX-License-Identifier: Apache-2.0
"""A kind is named where all explanations are of it, and only there."""

from __future__ import annotations

import dataclasses

import pytest

from loco_bringup.gap import text
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import decide, kinds
from loco_learning.gap.verdict.candidates import Candidate, Estimate, Rival
from loco_sim.effects.base import EFFECTS

STRONG = evidence.Comparison(80.0, 50.0, 110.0, 0.95, 1e6, 30)
CLOSE = dataclasses.replace(STRONG, gain=1.0, low=-3.0, high=5.0, odds=2.0)
SIZE = Estimate("torque", 0.4, 0.35, 0.45, "N·m", least=0.0, most=5.0, sign=1)


def found(*rivals: Rival) -> kinds.Kind | None:
    """Kind of Coulomb friction in the knee beside some rivals."""
    candidate = Candidate("coulomb_friction", "knee", (SIZE,), STRONG, 0.9, rivals)
    ruling = decide._rule(candidate, decide.LIMITS)
    return kinds.shared(candidate, ruling)


def test_rivals_of_one_kind_leave_the_kind():
    kind = found(
        Rival("viscous_friction", "knee", CLOSE),
        Rival("backlash", "knee", dataclasses.replace(STRONG, odds=40.0)),
    )
    assert (kind.kind, kind.places) == ("friction", ("knee",))
    assert kind.effects == ("coulomb_friction", "viscous_friction")
    assert kind.odds == 40.0  # against what is no friction


@pytest.mark.parametrize("rivals", [("backlash",), ("viscous_friction", "backlash"), ()])
def test_no_kind_where_another_kind_may_be_or_the_name_is_told(rivals):
    assert found(*(Rival(name, "knee", CLOSE) for name in rivals)) is None


def test_kinds_are_told_where_they_may_sit():
    kind = found(Rival("viscous_friction", "hip", CLOSE))
    assert kind.places == ("hip", "knee")


def test_the_headline_names_the_kind():
    group = ["coulomb_friction", "viscous_friction"]
    result = {
        "verdict": "ambiguous", "terms": [], "ambiguous": [group],
        "kinds": [{"kind": "friction", "places": ["servo_joint"], "effects": group}],
    }  # fmt: skip
    said = text.headline(result)
    assert "coulomb friction or viscous friction" in said
    assert "Named: friction in servo, by what law is not told." in said


def test_kinds_have_more_than_one_law():
    names = [cls.identity.kind for cls in EFFECTS.values() if cls.identity and cls.identity.kind]
    assert all(names.count(kind) > 1 for kind in names)
