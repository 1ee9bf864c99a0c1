# SPDX-License-Identifier: Apache-2.0
"""What slides is told in metres and newtons."""

from __future__ import annotations

import dataclasses

from loco_learning.gap.channels import ON_SLIDES
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
