# SPDX-License-Identifier: Apache-2.0
"""Families: one law in several joints with one size per joint, such as friction everywhere.

Friction in one of seven joints explains little; friction in all of them explains what no other
effect does. A family is fitted as one hypothesis, and penalised for one size per joint.
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


def families(screened: Sequence[Any], joints: tuple[str, ...], least: float = 0.0) -> list[tuple]:
    """Families of effects that can act in several joints, each as (hypothesis, start).

    Args:
        screened: `Screened` hypotheses, each with the share that it may explain alone.
        joints: Joints of the robot.
        least: Smallest share that all joints explain together.

    Returns:
        The first `MOST` families, the largest summed share first.
    """
    members: dict[str, dict[str, Any]] = {}
    for one in screened:
        h = one.hypothesis
        single = h.place in joints and not h.variant and not h.joints
        if single and EFFECTS[h.effect].identity.kind and not one.dead and one.share > 0.0:
            members.setdefault(h.effect, {})[h.place] = one
    shares = {e: [one.share for one in entries.values()] for e, entries in members.items()}
    ranked = sorted(
        (-sum(each), effect)
        for effect, each in shares.items()
        if sum(share >= LEAST for share in each) > 1 and sum(each) >= least
    )
    entries = [[members[e][j] for j in joints if j in members[e]] for _, e in ranked[:MOST]]
    return [_family([(one.hypothesis, one.x) for one in each], joints) for each in entries]


def fewer(
    family: Hypothesis,
    x: Sequence[float],
    mine: Sequence[str],
    offered: Sequence[Hypothesis],
    joints: tuple[str, ...],
) -> tuple:
    """The law of a family in some of its joints, as (hypothesis, coordinates).

    Args:
        family: Hypothesis about several joints.
        x: Coordinates of the family.
        mine: Joints to keep, at least one.
        offered: Hypotheses about each joint alone.
        joints: Joints of the robot.
    """
    by_place = {h.place: h for h in offered if h.effect == family.effect and not h.variant}
    count = len(family.coordinates) // len(family.joints)
    at = {joint: tuple(x[i * count : (i + 1) * count]) for i, joint in enumerate(family.joints)}
    if len(mine) == 1:
        return by_place[mine[0]], at[mine[0]]
    return _family([(by_place[joint], at[joint]) for joint in mine], joints)


def _family(found: Sequence[tuple[Hypothesis, Sequence[float]]], joints: tuple[str, ...]) -> tuple:
    """One law at the joints of some hypotheses, and its initial coordinates."""
    members = tuple(h.place for h, _ in found)
    first = found[0][0]
    coordinates = tuple(replace(c, of=h.place) for h, _ in found for c in h.coordinates)
    fixed = tuple((k, v) for k, v in first.fixed if k != "joint")
    place = common(list(members), joints) or " ".join(members)
    hypothesis = Hypothesis(first.effect, place, fixed, coordinates, EACH, members)
    return hypothesis, tuple(v for _, x in found for v in x)
