# SPDX-License-Identifier: Apache-2.0
"""`loco gap battery`: benchmark of `loco gap` on robots with hidden effects.

The robots are simulated by code that the workflow does not use. Files:

OUT/bags/case_0000/fit_chirp …   input of the workflow
OUT/truth/case_0000.json         hidden effects, used only for the score
OUT/results/case_0000.json       output of the workflow
OUT/score.json, .md, .html       the score
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from loco_control.exceptions import ParameterError
from loco_control.reading import read_json
from loco_learning.jobs import pool

from . import bags, cases, sysid
from .baselines import METHODS
from .drawn import fleet
from .ground.walkers import WALKERS
from .trial import OTHERS, make, unfinished, work

SETTINGS = "battery.json"
SYSID = "sysid"  # the baseline with additional dependencies


def check(a: argparse.Namespace) -> None:
    """Check the options; if no baselines are named, set all.

    Raises:
        ParameterError: A number is not above 0, there is no such baseline, or a baseline for robots
            with a fixed base is requested for a walking robot.
        MissingPackageError: A baseline needs a package that is not installed.
    """
    for what in ("cases", "workers", "limit"):
        if getattr(a, what) <= 0:
            raise ParameterError(f"--{what} must be above 0, got {getattr(a, what):g}")
    if not 0 <= a.settings <= len(OTHERS):
        raise ParameterError(f"--settings must be 0 to {len(OTHERS)}, got {a.settings}")
    other = [robot for robot in a.robots if robot in WALKERS or fleet.is_family(robot)]
    if other and (requested := [n for n in ("baselines", "follow") if getattr(a, n)]):
        what = f"--{requested[0]}"
        raise ParameterError(
            f"{what} is for listed robots that are held, not for {other[0]}; leave it out"
        )
    if a.baselines is None:
        a.baselines = [] if other else [n for n in METHODS if n != SYSID or sysid.installed()]
    for name in a.baselines:
        if name not in METHODS:
            raise ParameterError(f"unknown baseline {name!r}; known: {', '.join(METHODS)}")
    if SYSID in a.baselines:
        sysid.require()


def run(
    a: argparse.Namespace, folder: Path, tell: Callable[[int, str, str], Any]
) -> list[dict[str, Any]]:
    """Run the cases that have no result yet or that failed the last time.

    Args:
        a: Options.
        folder: Folder of the battery.
        tell: Called with the number of completed cases, the last case and its result.

    Returns:
        Results of all cases, in their order.

    Raises:
        ParameterError: The folder holds a battery with other settings.
    """
    planned = cases.plan(a.cases, a.seed, a.robots, a.effects)
    _settle(a, folder)
    results = {c.name: bags.result(folder, c.name) for c in planned}
    baselines = tuple(a.baselines)
    requested = baselines, a.follow, a.settings
    missing = [c for c in planned if unfinished(c, results[c.name], *requested)]
    if a.bags_only:
        missing = [c for c in planned if not bags.ready(folder, c.name)]
    tell(len(planned) - len(missing), "", "")
    done = len(planned) - len(missing)
    jobs: list[tuple] = [(folder, c, tuple(a.effects), *requested) for c in missing]
    if a.bags_only:
        jobs = [job[:3] for job in jobs]
    with pool.start(make if a.bags_only else work, workers=a.workers, limit=a.limit) as place:
        for index, result in place.outcomes(jobs):
            case, done = missing[index], done + 1
            reason = result.reason if isinstance(result, pool.Failure) else ""
            if a.bags_only:
                tell(done, case.name, reason or "made")
                continue
            if reason:  # not saved: a full disk or lack of memory is no result of the case
                result = bags.result(folder, case.name) or {
                    "case": case.name, "verdict": "error", "names": [], "terms": [],
                    "error": reason,
                }  # fmt: skip
            results[case.name] = result
            tell(done, case.name, ", ".join(result["names"]) or result["verdict"])
    return [] if a.bags_only else [results[c.name] for c in planned]


def _settle(a: argparse.Namespace, folder: Path) -> None:
    """Write the settings that the cases depend on; refuse a folder of another battery."""
    settings = {"format": 1, "seed": a.seed, "robots": a.robots, "effects": a.effects}
    path = folder / SETTINGS
    if path.is_file():
        stored = read_json(path)
        if any(stored.get(key) != value for key, value in settings.items()):
            raise ParameterError(
                f"{folder} holds a battery of seed {stored.get('seed')}, robots "
                f"{stored.get('robots') or 'all'} and effects {stored.get('effects') or 'all'}; "
                "choose another --out"
            )
        return
    bags.write_json(path, settings)
