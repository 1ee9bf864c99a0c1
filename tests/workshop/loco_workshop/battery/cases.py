# SPDX-License-Identifier: Apache-2.0
"""Cases of a battery: which robot, what is hidden in it, how large. Drawn from one seed.

The first cases of a battery are the same however many are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError

from . import sizes
from .ground import hidden as ground
from .ground import walkers
from .physics import conditions, excitation, hidden, kinds, machines, plant
from .physics.conditions import Condition
from .physics.hidden import Hidden

# Of twenty cases: two nulls, three outsiders, three pairs, twelve single effects.
ORDER = (
    ("single", "medium"), ("single", "large"), ("null", ""), ("single", "small"),
    ("outsider", "large"), ("single", "large"), ("pair", "large"), ("single", "medium"),
    ("single", "small"), ("single", "large"), ("outsider", "medium"), ("single", "medium"),
    ("pair", "medium"), ("single", "large"), ("null", ""), ("single", "small"),
    ("single", "medium"), ("outsider", "large"), ("pair", "large"), ("single", "large"),
)  # fmt: skip
TRIES = 40  # effects that are drawn until one shows as much as it should


@dataclass(frozen=True)
class Case:
    """One case; what is hidden is in `effects`, empty before `fill`.

    Attributes:
        name: Says nothing about what is hidden.
        robot: Machine.
        kind: null, single, pair or outsider.
        size: small, medium, large, or empty for a null.
        seed: Seed of everything in the case.
        wanted: Effects to begin with, the rest of the deck follows.
        effects: Hidden effects.
        shows: Visibility of each effect alone (`sizes.visibility`).
        condition: Difference between robot and model, and the way it was recorded.
    """

    name: str
    robot: str
    kind: str
    size: str
    seed: int
    wanted: tuple[str, ...] = ()
    effects: tuple[Hidden, ...] = ()
    shows: tuple[float, ...] = ()
    condition: Condition = Condition()


def plan(
    count: int, seed: int, robots: Sequence[str] = (), effects: Sequence[str] = ()
) -> list[Case]:
    """Cases of a battery, not filled in yet.

    Args:
        count: Number of cases.
        seed: Seed of the battery.
        robots: Machines and walkers; all machines by default.
        effects: Only these single effects, names or patterns; then there are no other cases.

    Raises:
        NameUnknownError: There is no such robot or effect.
    """
    robots = list(robots) or list(machines.MACHINES)
    known = (*machines.MACHINES, *walkers.WALKERS)
    for robot in robots:
        if robot not in known:
            raise NameUnknownError("robot of the battery", robot, known)
        if not _pool(robot, "single", effects):
            raise NameUnknownError("effect of the battery", ", ".join(effects), _pool(robot, ""))
    order = [o for o in ORDER if not effects or o[0] == "single"]
    rng = np.random.default_rng([seed, 6])
    decks: dict[str, list[str]] = {}
    turns = {what: order.index(what) for what in order}  # each kind goes through all robots
    planned = []
    for i in range(count):
        kind, size = what = order[i % len(order)]
        robot = robots[turns[what] % len(robots)]
        turns[what] += 1
        pool = _pool(robot, kind, effects)
        key = f"{robot} {kind == 'outsider'}"
        deck = []
        for _ in range({"null": 0, "pair": 2}.get(kind, 1)):
            if not decks.get(key):
                decks[key] = [pool[k] for k in rng.permutation(len(pool))]
            deck.append(decks[key].pop())
        own = seed * 10_000 + i
        how = conditions.draw(own)
        if robot in walkers.WALKERS:  # its bags are those of `loco run`
            how = replace(how, way="")
        planned.append(Case(f"case_{i:04d}", robot, kind, size, own, tuple(deck), condition=how))
    return planned


def _pool(robot: str, kind: str, effects: Sequence[str] = ()) -> list[str]:
    """Effects that a robot may hide; patterns choose among those of single ones."""
    all_kinds = ground if robot in walkers.WALKERS else kinds
    if kind == "outsider":
        return list(all_kinds.OUTSIDERS)
    return [n for n in all_kinds.KINDS if not effects or any(fnmatchcase(n, p) for p in effects)]


def fill(case: Case, effects: Sequence[str] = ()) -> Case:
    """Draw what is hidden in a case, as large as its size asks for.

    An effect that cannot show that much on the robot gives way to another one.

    Args:
        case: Case from `plan`.
        effects: Patterns that single effects must match.
    """
    rng = np.random.default_rng([case.seed, 7])
    names = _pool(case.robot, case.kind, effects)
    deck = [*case.wanted, *(names[k] for k in rng.permutation(len(names)))]
    if case.robot in walkers.WALKERS:
        return _walking(case, deck, rng)
    parts: list[tuple[Hidden, float]] = []
    want = {"null": 0, "pair": 2}.get(case.kind, 1)
    for name in deck[:TRIES]:
        if len(parts) == want:
            break
        family = kinds.ALL[name].family or name
        if any((kinds.ALL[e.effect].family or e.effect) == family for e, _ in parts):
            continue
        sized = sizes.sized(name, case.robot, case.size, rng, case.seed)
        if sized is not None:
            parts.append((sizes.rounded(sized[0]), sized[1]))
    return replace(
        case, effects=tuple(e for e, _ in parts), shows=tuple(round(v, 3) for _, v in parts)
    )


def _walking(case: Case, deck: Sequence[str], rng: np.random.Generator) -> Case:
    """A case on the ground: the first of the deck, of different families."""
    chosen: dict[str, str] = {}
    for name in deck if case.kind != "null" else ():
        chosen.setdefault(ground.family(name), name)
    names = list(chosen.values())[: 2 if case.kind == "pair" else 1]
    walker = walkers.get(case.robot)
    parts = [sizes.rounded(ground.draw(name, walker, case.size, rng)) for name in names]
    return replace(case, effects=tuple(parts))


def readings(case: Case) -> dict[str, plant.Reading]:
    """Recordings of the robot of a filled case, by the name of the record."""
    machine = conditions.machine_of(machines.get(case.robot), case.condition, case.seed)
    result = {}
    for kind in excitation.RECORDS:
        moved = excitation.command(machine, kind, case.seed)
        name = "hold_out" if kind == excitation.HELD_OUT else f"fit_{kind}"
        whole = plant.record(machine, case.effects, moved, case.seed, kind)
        result[name] = conditions.recorded(whole, case.condition, case.seed)
    return result


def further(case: Case, name: str, moved: tuple[np.ndarray, np.ndarray]) -> plant.Reading:
    """Recording of the robot of a filled case in one experiment more.

    Args:
        case: Case of the robot.
        name: Name of the record; keys the noise.
        moved: Positions and velocities that the driven joints are told, (T, m) each.
    """
    machine = conditions.machine_of(machines.get(case.robot), case.condition, case.seed)
    whole = plant.record(machine, case.effects, moved, case.seed, name)
    return conditions.recorded(whole, case.condition, case.seed)


def truth(case: Case) -> dict[str, Any]:
    """Plain values of a filled case, for a file that the workflow never sees."""
    return {
        "name": case.name, "robot": case.robot, "kind": case.kind, "size": case.size,
        "seed": case.seed, "effects": [hidden.to_dict(e) for e in case.effects],
        "shows": list(case.shows), "condition": case.condition.to_dict(),
    }  # fmt: skip


def from_truth(values: dict[str, Any]) -> Case:
    """The case of values that `truth` wrote."""
    effects = tuple(hidden.from_dict(e) for e in values["effects"])
    keys = ("name", "robot", "kind", "size", "seed")
    how = Condition(**values.get("condition", {}))
    return Case(*(values[k] for k in keys), (), effects, tuple(values["shows"]), how)
