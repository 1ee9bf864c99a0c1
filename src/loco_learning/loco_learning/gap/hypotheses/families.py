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
MIN_SHARE = 0.01  # share of the residual that a joint must explain to be in a family (taste)
MAX_GROUPS = 4  # families that are fitted (taste)


def by_law(screening: Sequence[Any], joints: tuple[str, ...], least: float = 0.0) -> list[tuple]:
    """Families of effects that can act in several joints, each as (hypothesis, start).

    Args:
        screening: `Screened` hypotheses, each with the share that it may explain alone.
        joints: Joints of the robot.
        least: Smallest share that all joints explain together.

    Returns:
        The first `MAX_GROUPS` families, the largest summed share first.
    """
    members: dict[str, dict[str, Any]] = {}
    for one in screening:
        h = one.hypothesis
        single = h.place in joints and not h.variant and not h.joints
        if single and EFFECTS[h.effect].identity.kind and not one.dead and one.share > 0.0:
            members.setdefault(h.effect, {})[h.place] = one
    shares = {e: [one.share for one in entries.values()] for e, entries in members.items()}
    ranked = sorted(
        (-sum(each), effect)
        for effect, each in shares.items()
        if sum(share >= MIN_SHARE for share in each) > 1 and sum(each) >= least
    )
    entries = [[members[e][j] for j in joints if j in members[e]] for _, e in ranked[:MAX_GROUPS]]
    return [_merge([(one.hypothesis, one.x) for one in each], joints) for each in entries]


def restrict(
    group: Hypothesis,
    x: Sequence[float],
    subset: Sequence[str],
    hypotheses: Sequence[Hypothesis],
    joints: tuple[str, ...],
) -> tuple:
    """The law of a family in some of its joints, as (hypothesis, coordinates).

    Args:
        group: Hypothesis about several joints.
        x: Coordinates of the family.
        subset: Joints to keep, at least one.
        hypotheses: Hypotheses about each joint alone.
        joints: Joints of the robot.
    """
    by_place = {h.place: h for h in hypotheses if h.effect == group.effect and not h.variant}
    count = len(group.coordinates) // len(group.joints)
    at = {joint: tuple(x[i * count : (i + 1) * count]) for i, joint in enumerate(group.joints)}
    if len(subset) == 1:
        return by_place[subset[0]], at[subset[0]]
    return _merge([(by_place[joint], at[joint]) for joint in subset], joints)


def _merge(parts: Sequence[tuple[Hypothesis, Sequence[float]]], joints: tuple[str, ...]) -> tuple:
    """One law at the joints of some hypotheses, and its initial coordinates."""
    members = tuple(h.place for h, _ in parts)
    first = parts[0][0]
    coordinates = tuple(replace(c, of=h.place) for h, _ in parts for c in h.coordinates)
    fixed = tuple((k, v) for k, v in first.fixed if k != "joint")
    place = common(list(members), joints) or " ".join(members)
    hypothesis = Hypothesis(first.effect, place, fixed, coordinates, EACH, members)
    return hypothesis, tuple(v for _, x in parts for v in x)
