# SPDX-License-Identifier: Apache-2.0
"""One law in several joints, each with a size of its own: a robot that rubs, rubs everywhere.

A single joint of seven that rub explains little; all of them together explain what no other
effect does. A family is fitted as one hypothesis and counted as what it is: a size per joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from loco_sim.effects import EFFECTS
from loco_sim.effects.places import common

from .hypotheses import Hypothesis

EACH = "each"  # variant of a family
LEAST = 0.01  # share of the residual that a joint must explain to be in a family (taste)
MOST = 4  # families that are fitted (taste)


def families(screened: Sequence[Any], joints: tuple[str, ...]) -> list[tuple]:
    """Families of effects that several joints may have, each as (hypothesis, start).

    Args:
        screened: `Screened` hypotheses, each with the share that it may explain by itself.
        joints: Joints of the robot.

    Returns:
        Those that may explain most, the best first.
    """
    members: dict[str, dict[str, Any]] = {}
    for one in screened:
        h = one.hypothesis
        alone = h.place in joints and not h.variant and not h.joints
        if alone and EFFECTS[h.effect].identity.kind and not one.dead and one.share > 0.0:
            members.setdefault(h.effect, {})[h.place] = one
    ranked = sorted(
        (-sum(one.share for one in found.values()), effect)
        for effect, found in members.items()
        if sum(one.share >= LEAST for one in found.values()) > 1
    )
    return [_family([members[e][j] for j in joints if j in members[e]], joints)
            for _, e in ranked[:MOST]]  # fmt: skip


def _family(found: Sequence[Any], joints: tuple[str, ...]) -> tuple:
    """One law at the joints of some screened hypotheses, and where to start."""
    mine = tuple(one.hypothesis.place for one in found)
    first = found[0].hypothesis
    coordinates = tuple(
        replace(c, of=one.hypothesis.place) for one in found for c in one.hypothesis.coordinates
    )
    fixed = tuple((k, v) for k, v in first.fixed if k != "joint")
    place = common(list(mine), joints) or " ".join(mine)
    family = Hypothesis(first.effect, place, fixed, coordinates, EACH, mine)
    return family, tuple(v for one in found for v in one.x)
