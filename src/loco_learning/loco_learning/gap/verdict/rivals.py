# SPDX-License-Identifier: Apache-2.0
"""Selection of the rivals of an effect: a few other effects, and the same at a few other places."""

from __future__ import annotations

from collections.abc import Sequence

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis

RIVAL_NAMES, RIVAL_PLACES = 4, 2  # rivals of other names, and other places of the same, per effect


def look_alike_names(main: Hypothesis) -> set[str]:
    """Names of the effects that are easily mistaken for a given one."""
    return {effect.name for effect in EFFECTS[main.effect].identity.look_alikes}


def leading(screening: Sequence, main: Hypothesis) -> list:
    """Best hypothesis of each other effect with a share, look-alikes first."""
    similar = look_alike_names(main)
    best: dict[str, object] = {}
    for s in sorted(screening, key=lambda s: (-s.share, s.hypothesis.key)):
        if not s.dead and s.share > 0.0 and s.hypothesis.effect != main.effect:
            best.setdefault(s.hypothesis.effect, s)
    return sorted(best.values(), key=lambda s: (s.hypothesis.effect not in similar, -s.share))


def select(models: Sequence[Fitted], main: Hypothesis, rest: Sequence[str]) -> list[Fitted]:
    """Best model of each of a few other names, and of each of a few other places."""
    selected, names, unique = [], set(), set()
    for model in models:
        (other,) = [h for h, _ in model.parts if h.key not in rest]
        if other.effect != main.effect and other.effect not in names and len(names) < RIVAL_NAMES:
            names.add(other.effect)
            selected.append(model)
        elif (
            other.effect == main.effect and other.place not in unique and len(unique) < RIVAL_PLACES
        ):
            unique.add(other.place)
            selected.append(model)
    return selected
