# SPDX-License-Identifier: Apache-2.0
"""Bundles of hypotheses that one simulation can test together, since they do not interact.

On a robot with a fixed base the branches move independently: one simulation with an effect on the
hip of every leg gives the same responses as one simulation per leg. Each hypothesis is then judged
by the channels of its own branch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loco_sim.effects.places import chains
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from .hypotheses import Hypothesis


@dataclass(frozen=True)
class Batch:
    """Hypotheses to test together.

    Attributes:
        hypotheses: One per branch.
        channels: Channels of the branch of each hypothesis, (C,) flags; None is all.
        passes: Whether branches whose residual is mostly noise are skipped. False where values of
            the robot are refitted to its torques, since these absorb friction.
    """

    hypotheses: tuple[Hypothesis, ...]
    channels: tuple[np.ndarray | None, ...]
    passes: bool = True

    @property
    def key(self) -> str:
        """Key of the first hypothesis, for messages."""
        return self.hypotheses[0].key


def batches(
    robot: Robot,
    channels: Sequence,
    hypotheses: Sequence[Hypothesis],
    fixed_base: bool,
    inverse: bool = False,
) -> list[Batch]:
    """Bundles of all hypotheses, in the order of the first hypothesis of each.

    Args:
        robot: Robot that the hypotheses are about.
        channels: Channels of the residual, with `name`.
        hypotheses: Hypotheses to test.
        fixed_base: Whether the base is fixed in every record.
        inverse: Whether torques are computed along the measured motion (inverse dynamics), so
            that an effect in one joint changes no other.
    """
    positions = _branch_positions(robot) if fixed_base else {}
    if inverse:
        positions = {joint: (i, 0) for i, joint in enumerate(robot.joints)}
    branches = {branch for branch, _ in positions.values()}
    if len(branches) < 2:
        return [Batch((h,), (None,)) for h in hypotheses]
    flags = {
        branch: np.array([positions.get(c.name, (-1, 0))[0] == branch for c in channels])
        for branch in branches
    }
    groups: dict[tuple, list[Hypothesis]] = {}
    for i, h in enumerate(hypotheses):
        at = positions.get(h.place)
        key = (h.effect, h.variant, at[1]) if at else (h.effect, h.variant, i, "")
        groups.setdefault(key, []).append(h)
    result = []
    for group in groups.values():
        single = group[0].place not in positions
        masks = [None if single else flags[positions[h.place][0]] for h in group]
        result.append(Batch(tuple(group), tuple(masks), not inverse))
    return result


def _branch_positions(robot: Robot) -> dict[str, tuple[int, int]]:
    """Branch index of each joint and link, and its depth in the branch."""
    text, positions = Description(robot.urdf), {}
    for branch, chain in enumerate(chains(robot)):
        for depth, joint in enumerate(chain):
            positions[joint] = (branch, depth)
        for depth, link in enumerate(text.below(text.child(chain[0]))):
            positions[link] = (branch, depth)
    return positions
