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
    """Make a case if need be, run the workflow and the baselines, write and return the result.

    Args:
        folder: Of the battery.
        case: From `cases.plan`.
        effects: Patterns that single effects match.
        baselines: Names of the baselines to run.
    """
    if not bags.ready(folder, case.name):
        bags.write(folder, cases.fill(case, effects))
    result = examined(folder / bags.BAGS / case.name, case.robot, case.seed, baselines)
    result["case"] = case.name
    bags.write_json(folder / bags.RESULTS / f"{case.name}.json", result)
    return result


def examined(place: Path, robot: str, seed: int, baselines: tuple[str, ...] = ()) -> dict[str, Any]:
    """What the workflow says about the bags in a folder; it sees nothing else.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        seed: Of the workflow.
        baselines: Names of the baselines to run on the same records.
    """
    from loco_learning.gap import workflow
    from loco_learning.gap.params import GapParams
    from loco_sim.model import Model

    from .gap_import import load

    machine = machines.get(robot)
    model = Model(robot, dict(machine.overrides), [dict(e) for e in machine.known])
    made = model.make_robot()
    began, spent = time.perf_counter(), time.process_time()
    try:
        fit = [r for path in sorted(place.glob("fit_*")) for r in load(path, made)]
        held = load(place / "hold_out", made)
        found = workflow.find(model, fit, held, GapParams(seed=seed))
        result = {key: found[key] for key in KEPT if key in found}
    except LocoError as error:
        result = {"verdict": "error", "names": [], "terms": [], "error": str(error)}
    result["seconds"] = round(time.perf_counter() - began, 2)
    result["cpu"] = round(time.process_time() - spent, 2)
    if baselines and result["verdict"] != "error":
        from loco_learning.gap.battery import baselines as others

        result["baselines"] = others.run(baselines, model, fit, held, seed)
    return result
