# SPDX-License-Identifier: Apache-2.0
"""One case of the blind battery: make its bags, run the workflow on them, keep the verdict."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError
from loco_learning.gap.battery import cases, machines
from loco_learning.gap.battery.cases import Case

from . import gap_battery_bags as bags

KEPT = ("verdict", "names", "terms", "rivals", "ambiguous", "gap", "next")


def work(
    folder: Path,
    case: Case,
    effects: tuple[str, ...],
    baselines: tuple[str, ...],
    follow: bool = False,
) -> dict:
    """Do what is missing of a case: make it, run the workflow, run baselines; keep the result.

    Args:
        folder: Of the battery.
        case: From `cases.plan`.
        effects: Patterns that single effects match.
        baselines: Names of the baselines to run.
        follow: Where the verdict is ambiguous, run the experiment it proposes, and look again.
    """
    if not bags.ready(folder, case.name):
        bags.write(folder, cases.fill(case, effects))
    place = folder / bags.BAGS / case.name
    result = bags.result(folder, case.name)
    if result is None:
        result = {"case": case.name, **examined(place, case.robot, case.seed)}
        bags.keep(folder, result)
    if follow and unfollowed(result):
        result["followed"] = followed(folder, case, result)
        bags.keep(folder, result)
    missing = lacking(result, baselines)
    if missing:
        found = compared(place, case.robot, case.seed, missing)
        result["baselines"] = {**result.get("baselines", {}), **found}
        bags.keep(folder, result)
    return result


def lacking(result: dict[str, Any], baselines: tuple[str, ...]) -> tuple[str, ...]:
    """Baselines that a result does not have yet."""
    if result["verdict"] == "error":
        return ()
    done = result.get("baselines", {})
    return tuple(name for name in baselines if name not in done)


def unfinished(result: dict[str, Any] | None, baselines: tuple[str, ...], follow: bool) -> bool:
    """Something of a case is still to be done; arguments as of `work`."""
    return result is None or bool(lacking(result, baselines)) or (follow and unfollowed(result))


def unfollowed(result: dict[str, Any]) -> bool:
    """A verdict is ambiguous, proposes an experiment, and that was not run."""
    ambiguous = result["verdict"] == "ambiguous" and bool(result.get("next"))
    return ambiguous and "followed" not in result


def followed(folder: Path, case: Case, result: dict[str, Any]) -> dict[str, Any]:
    """What the workflow says when it has also seen the experiment that it proposes."""
    name = result["next"][0]["experiment"]
    place = folder / bags.BAGS / case.name
    moved = motion(model_of(case.robot), name, machines.get(case.robot).rate)
    bags.write_next(folder, case.name, moved)
    return {"experiment": name, **examined(place, case.robot, case.seed, (bags.NEXT,))}


def motion(model: Any, name: str, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Commanded positions and velocities of an experiment of the pool, (T, m) each.

    Args:
        model: Of the robot as it should be.
        name: Of the experiment.
        rate: Commands per second.
    """
    from loco_learning.gap import pool

    experiment = pool.within_limits(pool.choose(pool.pool(model), name))
    experiment = experiment.replace(control_rate=rate)
    target = experiment.make_target()
    target.reset()
    q, dq = zip(*(target.step(k / rate) for k in range(experiment.ticks)), strict=True)
    return np.array(q), np.array(dq)


def examined(place: Path, robot: str, seed: int, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """What the workflow says about the bags in a folder; it sees nothing else.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        seed: Of the workflow.
        more: Names of further bags to fit.
    """
    from loco_learning.gap import workflow
    from loco_learning.gap.params import GapParams

    model, fit, held = read(place, robot, more)
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


def model_of(robot: str) -> Any:
    """Model of a robot as it should be, with how it is held."""
    from loco_sim.model import Model

    machine = machines.get(robot)
    return Model(robot, dict(machine.overrides), [dict(e) for e in machine.known])


def read(place: Path, robot: str, more: tuple[str, ...] = ()) -> tuple[Any, list, list]:
    """Model of a robot as it should be, records to fit and records to judge on.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        more: Names of further bags to fit.
    """
    from .gap_import import load

    model = model_of(robot)
    made = model.make_robot()
    bags_to_fit = [*sorted(place.glob("fit_*")), *(place / name for name in more)]
    fit = [r for path in bags_to_fit for r in load(path, made)]
    return model, fit, load(place / "hold_out", made)
