# SPDX-License-Identifier: Apache-2.0
"""Random cases of a battery (robot, hidden effects, sizes), drawn from one seed.

The first cases of a battery do not depend on the number of cases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError

from . import sizes
from .drawn import fleet
from .ground import hidden as ground
from .ground import walkers
from .physics import conditions, excitation, hidden, kinds, machines, plant
from .physics.conditions import Condition
from .physics.hidden import Hidden

# Of twenty cases: two without effect (null), three outsiders (effects that are not in the
# registry), three pairs, twelve single effects.
ORDER = (
    ("single", "medium"), ("single", "large"), ("null", ""), ("single", "small"),
    ("outsider", "large"), ("single", "large"), ("pair", "large"), ("single", "medium"),
    ("single", "small"), ("single", "large"), ("outsider", "medium"), ("single", "medium"),
    ("pair", "medium"), ("single", "large"), ("null", ""), ("single", "small"),
    ("single", "medium"), ("outsider", "large"), ("pair", "large"), ("single", "large"),
)  # fmt: skip
TRIES = 40  # largest number of draws until an effect has the requested visibility


@dataclass(frozen=True)
class Case:
    """One case; its hidden effects are in `effects`, which `fill` sets.

    Attributes:
        name: Name without information on the hidden effects.
        robot: Name of the machine.
        kind: ``null`` (no effect), ``single``, ``pair`` or ``outsider`` (not in the registry).
        size: ``small``, ``medium`` or ``large``; empty for ``null``.
        seed: Seed of all random choices of the case.
        wanted: Effects to try first, before the other candidates.
        effects: Hidden effects.
        shows: Visibility of each effect by itself (`sizes.visibility`).
        condition: Difference between robot and model, and recording faults.
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
    """Cases of a battery, without hidden effects yet (see `fill`).

    Args:
        count: Number of cases.
        seed: Seed of the battery.
        robots: Machines, ``drawn`` and walkers; all machines by default.
        effects: Names or patterns; if given, all cases are single effects among these.

    Raises:
        NameUnknownError: There is no such robot or effect.
    """
    robots = list(robots) or list(machines.MACHINES)
    available = (*machines.MACHINES, fleet.DRAWN, *walkers.WALKERS)
    for robot in robots:
        if robot not in available and not fleet.is_family(robot):
            raise NameUnknownError("robot of the battery", robot, available)
        if not _pool(robot, "single", effects):
            raise NameUnknownError("effect of the battery", ", ".join(effects), _pool(robot, ""))
    order = [o for o in ORDER if not effects or o[0] == "single"]
    rng = np.random.default_rng([seed, 6])
    decks: dict[str, list[str]] = {}
    turns = {what: order.index(what) for what in order}  # each kind cycles through all robots
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
        seed_i = seed * 10_000 + i
        how = conditions.draw(seed_i)
        if fleet.is_family(robot):  # an integrator must be at rest when a record begins
            robot = f"{robot}_{seed_i}"
            cut = how.way == "cut" and fleet.get(robot).integrates
            how = replace(how, noise=1.0, way="" if cut else how.way)
        if robot in walkers.WALKERS:  # its bags are those of `loco run`
            how = replace(how, way="")
        planned.append(Case(f"case_{i:04d}", robot, kind, size, seed_i, tuple(deck), condition=how))
    return planned


def _pool(robot: str, kind: str, effects: Sequence[str] = ()) -> list[str]:
    """Candidate effects for a robot; patterns select among single effects."""
    all_kinds = ground if robot in walkers.WALKERS else kinds
    if kind == "outsider":
        return list(all_kinds.OUTSIDERS)
    return [n for n in all_kinds.KINDS if not effects or any(fnmatchcase(n, p) for p in effects)]


def fill(case: Case, effects: Sequence[str] = ()) -> Case:
    """Draw the hidden effects of a case, with the visibility of its size class.

    An effect that cannot reach this visibility on the robot is replaced by another one.

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
        group = kinds.ALL[name].family or name
        if any((kinds.ALL[e.effect].family or e.effect) == group for e, _ in parts):
            continue
        sized = sizes.sized(name, case.robot, case.size, rng, case.seed)
        if sized is not None:
            parts.append((sizes.rounded(sized[0]), sized[1]))
    return replace(
        case, effects=tuple(e for e, _ in parts), shows=tuple(round(v, 3) for _, v in parts)
    )


def _walking(case: Case, deck: Sequence[str], rng: np.random.Generator) -> Case:
    """Fill a case of a walking robot with the first effects of different families."""
    by_family: dict[str, str] = {}
    for name in deck if case.kind != "null" else ():
        by_family.setdefault(ground.family(name), name)
    names = list(by_family.values())[: 2 if case.kind == "pair" else 1]
    walker = walkers.get(case.robot)
    parts = [sizes.rounded(ground.draw(name, walker, case.size, rng)) for name in names]
    return replace(case, effects=tuple(parts))


def readings(case: Case) -> dict[str, plant.Reading]:
    """Recordings of the robot of a filled case, by name of the record."""
    known = fleet.get(case.robot)
    machine = conditions.machine_of(known, case.condition, case.seed)
    result = {}
    for record in machine.records:
        moved = excitation.command(known, record.name, case.seed)
        name = "hold_out" if record.judge else f"fit_{record.name}"
        reading = plant.record(machine, case.effects, moved, case.seed, record.name)
        result[name] = conditions.recorded(reading, case.condition, case.seed)
    return result


def further(case: Case, name: str, moved: tuple[np.ndarray, np.ndarray]) -> plant.Reading:
    """Recording of the robot of a filled case in one further experiment.

    Args:
        case: Case of the robot.
        name: Name of the record, part of the seed of the noise.
        moved: Commanded positions and velocities of the driven joints, (T, m) each.
    """
    machine = conditions.machine_of(fleet.get(case.robot), case.condition, case.seed)
    reading = plant.record(machine, case.effects, moved, case.seed, name)
    return conditions.recorded(reading, case.condition, case.seed)


def truth(case: Case) -> dict[str, Any]:
    """Values of a filled case for the truth file, which the workflow never reads."""
    return {
        "name": case.name, "robot": case.robot, "kind": case.kind, "size": case.size,
        "seed": case.seed, "effects": [hidden.to_dict(e) for e in case.effects],
        "shows": list(case.shows), "condition": case.condition.to_dict(),
    }  # fmt: skip


def from_truth(values: dict[str, Any]) -> Case:
    """Case from the values written by `truth`."""
    effects = tuple(hidden.from_dict(e) for e in values["effects"])
    keys = ("name", "robot", "kind", "size", "seed")
    how = Condition(**values.get("condition", {}))
    return Case(*(values[k] for k in keys), (), effects, tuple(values["shows"]), how)
