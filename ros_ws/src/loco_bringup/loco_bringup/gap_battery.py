# SPDX-License-Identifier: Apache-2.0
"""`loco gap battery`: hidden effects in robots made by other code; how often the name is right.

OUTPUT/bags/case_0000/fit_chirp …   what the workflow sees
OUTPUT/truth/case_0000.json         what is hidden, for the score alone
OUTPUT/results/case_0000.json       what the workflow said
OUTPUT/score.json, .md, .html       the score
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from loco_control.exceptions import ParameterError
from loco_learning.gap.battery import cases

from . import gap_battery_bags as bags
from . import gap_battery_pool as pool
from .gap import read_json

SETTINGS = "battery.json"
BASELINES = ("everything", "sparse", "cma")


def add_arguments(p: argparse.ArgumentParser) -> None:
    """Options of the command."""
    p.add_argument("--cases", type=int, default=20, help="how many (default 20)")
    p.add_argument("--seed", type=int, default=1, help="of all that is drawn (default 1); below "
                   "1000 for development")  # fmt: skip
    p.add_argument("--robots", nargs="+", default=[], metavar="NAME", help="default: all it has")
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME",
                   help="only single effects, of these names or patterns")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--limit", type=float, default=900.0, help="seconds per case (default 900)")
    p.add_argument("--baselines", nargs="*", default=list(BASELINES), metavar="NAME",
                   help="everything, sparse, cma (default: all three)")  # fmt: skip
    p.add_argument("--follow", action="store_true", help="where the verdict is ambiguous, run the "
                   "experiment that it proposes on the robot, and look again")  # fmt: skip
    p.add_argument("--bags-only", action="store_true", help="make the cases, run nothing")
    p.add_argument("--output", type=Path, metavar="DIR", help="default results/gap_battery_SEED")


def from_arguments(a: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from .console_gap_battery import show_battery

    for what in ("cases", "workers", "limit"):
        if getattr(a, what) <= 0:
            raise ParameterError(f"--{what} must be above 0, got {getattr(a, what):g}")
    for name in a.baselines:
        if name not in BASELINES:
            raise ParameterError(f"unknown baseline {name!r}; known: {', '.join(BASELINES)}")
    return show_battery(a, a.output or Path("results") / f"gap_battery_{a.seed}")


def run(
    a: argparse.Namespace, folder: Path, tell: Callable[[int, str, str], Any]
) -> list[dict[str, Any]]:
    """Work on the cases that have no result yet.

    Args:
        a: Options.
        folder: Of the battery.
        tell: Called with the number of cases done, the last one and what was said of it.

    Returns:
        Results of all cases, in their order.

    Raises:
        ParameterError: The folder holds a battery of other settings.
    """
    from .gap_battery_case import unfinished, work

    planned = cases.plan(a.cases, a.seed, a.robots, a.effects)
    _settle(a, folder)
    kept = {c.name: bags.result(folder, c.name) for c in planned}
    wanted = tuple(a.baselines)
    missing = [c for c in planned if unfinished(kept[c.name], wanted, a.follow)]
    tell(len(planned) - len(missing), "", "")
    if a.bags_only:
        missing = [c for c in planned if not bags.ready(folder, c.name)]
        jobs = [(folder, c, tuple(a.effects)) for c in missing]
        for index, said in pool.run(make, jobs, a.workers, a.limit):
            tell(len(planned) - len(missing) + index + 1, missing[index].name, said or "made")
        return []
    jobs = [(folder, c, tuple(a.effects), wanted, a.follow) for c in missing]
    done = len(planned) - len(missing)
    for index, result in pool.run(work, jobs, a.workers, a.limit):
        case, done = missing[index], done + 1
        if isinstance(result, str):
            result = bags.result(folder, case.name) or {
                "case": case.name, "verdict": "error", "names": [], "terms": [], "error": result,
            }  # fmt: skip
            bags.keep(folder, result)
        kept[case.name] = result
        said = ", ".join(result["names"]) or result["verdict"]
        tell(done, case.name, said)
    return [kept[c.name] for c in planned]


def make(folder: Path, case: cases.Case, effects: tuple[str, ...]) -> str:
    """Bags and truth of a case."""
    if not bags.ready(folder, case.name):
        bags.write(folder, cases.fill(case, effects))
    return ""


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
                "choose another --output"
            )
        return
    bags.write_json(path, mine)
