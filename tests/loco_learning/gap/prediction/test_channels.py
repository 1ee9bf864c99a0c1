# SPDX-License-Identifier: Apache-2.0
"""What slides is told in metres and newtons."""

from __future__ import annotations

import dataclasses

from loco_learning.gap import contents as tell
from loco_learning.gap.prediction.channels import ON_SLIDES, Channel
from loco_sim.effects.base import EFFECTS


def test_every_unit_of_a_joint_in_the_registry_has_one_for_slides():
    units = {
        field.metadata["unit"]
        for effect in EFFECTS.values()
        for field in dataclasses.fields(effect)
        if "unit" in field.metadata
    }
    turning = {unit for unit in units if "rad" in unit or "N·m" in unit or unit == "kg·m²"}
    assert "N·m/rad³" in turning
    assert turning <= set(ON_SLIDES)


def test_only_what_sits_on_a_slide_is_told_in_metres():
    channels = [Channel("q", "slide", "m"), Channel("q", "hinge", "rad")]
    places = ["slide", "q slide", "hinge", "*"]
    made = [{"place": place, "parameters": {"step": {"unit": "rad"}}, "evidence": "It is 3 N·m.",
             "amount": "it is slack at 0.1 rad"}
            for place in places]  # fmt: skip
    told = tell.in_metres(made, channels)
    assert [t["parameters"]["step"]["unit"] for t in told] == ["m", "m", "rad", "rad"]
    assert [t["amount"][-1] for t in told] == ["m", "m", "d", "d"]
    assert [t["evidence"] for t in told] == 2 * ["It is 3 N."] + 2 * ["It is 3 N·m."]
