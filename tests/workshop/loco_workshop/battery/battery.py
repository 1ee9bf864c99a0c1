# SPDX-License-Identifier: Apache-2.0
"""`loco gap battery`: hidden effects in robots made by other code; how often the name is right.

OUT/bags/case_0000/fit_chirp …   what the workflow sees
OUT/truth/case_0000.json         what is hidden, for the score alone
OUT/results/case_0000.json       what the workflow said
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
from .ground.walkers import WALKERS
from .trial import OTHERS, make, unfinished, work

SETTINGS = "battery.json"
SYSID = "sysid"  # the baseline that needs packages of its own


def check(a: argparse.Namespace) -> None:
    """Check the options, and fill in all baselines if none are named.

    Raises:
        ParameterError: A number is not above 0, there is no such baseline, or it is for robots
            that are held and one walks.
        MissingPackageError: A baseline needs a package that is not installed.
    """
    for what in ("cases", "workers", "limit"):
        if getattr(a, what) <= 0:
            raise ParameterError(f"--{what} must be above 0, got {getattr(a, what):g}")
    if not 0 <= a.settings <= len(OTHERS):
        raise ParameterError(f"--settings must be 0 to {len(OTHERS)}, got {a.settings}")
    walking = [robot for robot in a.robots if robot in WALKERS]
    if walking and (asked := [n for n in ("baselines", "follow", "settings") if getattr(a, n)]):
        what = f"--{asked[0]}"
        raise ParameterError(
            f"{what} is for robots that are held, not for {walking[0]}; leave it out"
        )
    if a.baselines is None:
        a.baselines = [] if walking else [n for n in METHODS if n != SYSID or sysid.installed()]
    for name in a.baselines:
        if name not in METHODS:
            raise ParameterError(f"unknown baseline {name!r}; known: {', '.join(METHODS)}")
    if SYSID in a.baselines:
        sysid.require()


def run(
    a: argparse.Namespace, folder: Path, tell: Callable[[int, str, str], Any]
) -> list[dict[str, Any]]:
    """Work on the cases that have no result yet, or that failed the last time.

    Args:
        a: Options.
        folder: Folder of the battery.
        tell: Called with the number of cases done, the last one and what was said of it.

    Returns:
        Results of all cases, in their order.

    Raises:
        ParameterError: The folder holds a battery of other settings.
    """
    planned = cases.plan(a.cases, a.seed, a.robots, a.effects)
    _settle(a, folder)
    kept = {c.name: bags.result(folder, c.name) for c in planned}
    baselines = tuple(a.baselines)
    wanted = baselines, a.follow, a.settings
    missing = [c for c in planned if unfinished(c, kept[c.name], *wanted)]
    if a.bags_only:
        missing = [c for c in planned if not bags.ready(folder, c.name)]
    tell(len(planned) - len(missing), "", "")
    done = len(planned) - len(missing)
    jobs: list[tuple] = [(folder, c, tuple(a.effects), *wanted) for c in missing]
    if a.bags_only:
        jobs = [job[:3] for job in jobs]
    with pool.start(make if a.bags_only else work, workers=a.workers, limit=a.limit) as place:
        for index, result in place.outcomes(jobs):
            case, done = missing[index], done + 1
            reason = result.reason if isinstance(result, pool.Failure) else ""
            if a.bags_only:
                tell(done, case.name, reason or "made")
                continue
            if reason:  # not kept: a full disk or the end of memory says nothing of the case
                result = bags.result(folder, case.name) or {
                    "case": case.name, "verdict": "error", "names": [], "terms": [],
                    "error": reason,
                }  # fmt: skip
            kept[case.name] = result
            tell(done, case.name, ", ".join(result["names"]) or result["verdict"])
    return [] if a.bags_only else [kept[c.name] for c in planned]


def _settle(a: argparse.Namespace, folder: Path) -> None:
    """Keep what the cases depend on; refuse a folder of another battery."""
    mine = {"format": 1, "seed": a.seed, "robots": a.robots, "effects": a.effects}
    path = folder / SETTINGS
    if path.is_file():
        theirs = read_json(path)
        if any(theirs.get(key) != value for key, value in mine.items()):
            raise ParameterError(
                f"{folder} holds a battery of seed {theirs.get('seed')}, robots "
                f"{theirs.get('robots') or 'all'} and effects {theirs.get('effects') or 'all'}; "
                "choose another --out"
            )
        return
    bags.write_json(path, mine)
