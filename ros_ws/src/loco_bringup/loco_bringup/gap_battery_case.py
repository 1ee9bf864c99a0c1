# SPDX-License-Identifier: Apache-2.0
"""One case of the blind battery: make its bags, run the workflow on them, keep the verdict."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from loco_control.exceptions import LocoError
from loco_learning.gap.battery import cases, machines
from loco_learning.gap.battery.cases import Case

from . import gap_battery_bags as bags

KEPT = ("verdict", "names", "terms", "rivals", "ambiguous", "gap")


def work(folder: Path, case: Case, effects: tuple[str, ...], baselines: tuple[str, ...]) -> dict:
    """Do what is missing of a case: make it, run the workflow, run baselines; keep the result.

    Args:
        folder: Of the battery.
        case: From `cases.plan`.
        effects: Patterns that single effects match.
        baselines: Names of the baselines to run.
    """
    if not bags.ready(folder, case.name):
        bags.write(folder, cases.fill(case, effects))
    place = folder / bags.BAGS / case.name
    result = bags.result(folder, case.name)
    if result is None:
        result = {"case": case.name, **examined(place, case.robot, case.seed)}
        bags.write_json(folder / bags.RESULTS / f"{case.name}.json", result)
    missing = lacking(result, baselines)
    if missing:
        found = compared(place, case.robot, case.seed, missing)
        result["baselines"] = {**result.get("baselines", {}), **found}
        bags.write_json(folder / bags.RESULTS / f"{case.name}.json", result)
    return result


def lacking(result: dict[str, Any], baselines: tuple[str, ...]) -> tuple[str, ...]:
    """Baselines that a result does not have yet."""
    if result["verdict"] == "error":
        return ()
    done = result.get("baselines", {})
    return tuple(name for name in baselines if name not in done)


def examined(place: Path, robot: str, seed: int) -> dict[str, Any]:
    """What the workflow says about the bags in a folder; it sees nothing else.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        seed: Of the workflow.
    """
    from loco_learning.gap import workflow
    from loco_learning.gap.params import GapParams

    model, fit, held = read(place, robot)
    began, spent = time.perf_counter(), time.process_time()
    try:
        found = workflow.find(model, fit, held, GapParams(seed=seed))
        result = {key: found[key] for key in KEPT if key in found}
    except LocoError as error:
        result = {"verdict": "error", "names": [], "terms": [], "error": str(error)}
    result["seconds"] = round(time.perf_counter() - began, 2)
    result["cpu"] = round(time.process_time() - spent, 2)
    return result


def compared(place: Path, robot: str, seed: int, names: tuple[str, ...]) -> dict[str, Any]:
    """What baselines make of the same bags; arguments as of `examined`."""
    from loco_learning.gap.battery import baselines

    return baselines.run(names, *read(place, robot), seed)


def read(place: Path, robot: str) -> tuple[Any, list, list]:
    """Model of a robot as it should be, records to fit and records to judge on."""
    from loco_sim.model import Model

    from .gap_import import load

    machine = machines.get(robot)
    model = Model(robot, dict(machine.overrides), [dict(e) for e in machine.known])
    made = model.make_robot()
    fit = [r for path in sorted(place.glob("fit_*")) for r in load(path, made)]
    return model, fit, load(place / "hold_out", made)
