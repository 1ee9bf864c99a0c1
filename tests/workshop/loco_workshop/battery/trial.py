# SPDX-License-Identifier: Apache-2.0
"""One case of the blind battery: write its bags, run the workflow on them, save the verdict."""

from __future__ import annotations

import atexit
import contextlib
import shutil
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_bringup.gap.importing import load
from loco_control.exceptions import LocoError
from loco_control.files import write_whole
from loco_learning.gap import workflow
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.proposals import pool
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

from . import bags, baselines, cases
from .cases import Case
from .drawn import fleet
from .ground import trots, walkers
from .physics.machines import Machine
from .score import SURE

KEPT = ("verdict", "names", "probability", "terms", "rivals", "ambiguous", "gap", "next",
        "setup")  # fmt: skip
HELD = "hold_out"
OTHERS = ("order", "judge", "first half", "second half", "split", "seed")  # the same data otherwise
OTHER = 6  # seed key of the random choice among them


def work(
    folder: Path,
    case: Case,
    effects: tuple[str, ...],
    baselines: tuple[str, ...],
    follow: int = 0,
    settings: int = 0,
) -> dict:
    """Run the missing parts of a case (bags, workflow, baselines) and save the result.

    Args:
        folder: Folder of the battery.
        case: Case from `cases.plan`.
        effects: Patterns that single effects match.
        baselines: Names of the baselines to run.
        follow: Number of experiments that are simulated one after the other at most, each as an
            ambiguous verdict proposes, with a search after each.
        settings: Number of other divisions of the data with which a search that names an effect is
            repeated.
    """
    make(folder, case, effects)
    place = folder / bags.BAGS / case.name
    result = bags.result(folder, case.name)
    if result is None:
        with _timed(folder, case.name, "search"):
            result = {"case": case.name, **examined(place, case.robot, case.seed)}
        bags.keep(folder, result)
    while unfollowed(result, follow):
        *_, last = chain = answers(result)
        with _timed(folder, case.name, "followed"):
            last["followed"] = followed(folder, case, last, len(chain))
        bags.keep(folder, result)
    for setting in unasked(result, case.seed, settings):
        with _timed(folder, case.name, "settings"):
            answer = asked(place, case.robot, case.seed, setting)
        result.setdefault("settings", []).append(answer)
        bags.keep(folder, result)
    missing = lacking(result, baselines)
    if missing:
        with _timed(folder, case.name, "baselines"):
            results = compared(place, case.robot, case.seed, missing)
        result["baselines"] = {**result.get("baselines", {}), **results}
        bags.keep(folder, result)
    return result


def make(folder: Path, case: Case, effects: tuple[str, ...]) -> None:
    """Write bags and ground truth of a case; arguments as for `work`."""
    if not bags.ready(folder, case.name):
        robot = model_of(case.robot).robot if case.robot in walkers.WALKERS else ""
        bags.write(folder, cases.fill(case, effects), robot)
    if fleet.is_drawn(case.robot):  # for a reader who wants to run `loco gap` by hand
        path = _foreign(fleet.get(case.robot))
        for file in (path, path.with_suffix(".urdf")):
            write_whole(folder / "robots" / file.name, file.read_text(encoding="utf-8"))


def lacking(result: dict[str, Any], baselines: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the baselines that a result does not have yet."""
    if result["verdict"] == "error":
        return ()
    done = result.get("baselines", {})
    return tuple(name for name in baselines if name not in done)


def unfinished(
    case: Case,
    result: dict[str, Any] | None,
    baselines: tuple[str, ...],
    follow: int = 0,
    settings: int = 0,
) -> bool:
    """Whether parts of a case are missing; arguments as for `work`."""
    if result is None or lacking(result, baselines) or unfollowed(result, follow):
        return True
    return bool(unasked(result, case.seed, settings))


def answers(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The first verdict of a case, and that after each experiment."""
    found = [result]
    while "followed" in found[-1]:
        found.append(found[-1]["followed"])
    return found


def unfollowed(result: dict[str, Any], follow: int) -> bool:
    """Whether the last verdict is ambiguous and proposes an experiment that may still be run.

    Args:
        result: Result of the case.
        follow: Largest number of experiments.
    """
    *before, last = answers(result)
    ambiguous = last["verdict"] == "ambiguous" and bool(last.get("next"))
    return ambiguous and len(before) < follow


def unasked(result: dict[str, Any], seed: int, count: int) -> list[str]:
    """Names of other divisions of its data with which the search has not been repeated."""
    if result["verdict"] not in SURE or not result["names"]:
        return []
    drawn = np.random.default_rng([seed, OTHER]).permutation(OTHERS)[:count].tolist()
    return drawn[len(result.get("settings", [])) :]


def asked(place: Path, robot: str, seed: int, setting: str) -> dict[str, Any]:
    """Setting, verdict and names of a search with it; other arguments as for `examined`."""
    model, fit, held = read(place, robot)
    seed += setting == "seed"
    result = _found(model, *otherwise(setting, fit, held), GapParams(seed=seed))
    return {"setting": setting, "verdict": result["verdict"], "names": result["names"]}


def otherwise(
    setting: str, fit: Sequence[Record], held: Sequence[Record]
) -> tuple[list[Record], list[Record]]:
    """The same recordings divided in another way: records to fit, and held-out ones.

    Args:
        setting: One of `OTHERS`.
        fit: Records to fit.
        held: Held-out records; empty if the last third of the only one is held out.
    """
    if setting == "order":
        return [*fit][::-1], [*held][::-1]
    if setting == "judge":
        first, *others = [*fit, *held] if len(fit) + len(held) > 1 else _halves(fit[0])
        return others, [first]
    parts = {"first half": slice(0, 1), "second half": slice(1, 2), "split": slice(0, 2)}
    if setting not in parts:
        return [*fit], [*held]
    return tuple([half for r in records for half in _halves(r)[parts[setting]]]
                 for records in (fit, held))  # fmt: skip


def _halves(record: Record) -> list[Record]:
    """The first and the second half of a record."""
    middle, count = len(record.t) // 2, len(record.t)
    return [
        record.rows(*rows, f"{record.name}_{k}")
        for k, rows in enumerate([(0, middle), (middle, count)], 1)
    ]


def followed(folder: Path, case: Case, result: dict[str, Any], count: int) -> dict[str, Any]:
    """Result of the workflow with its proposed experiment and all earlier ones.

    Args:
        folder: Folder of the battery.
        case: Case of the robot.
        result: Last verdict, which proposes the experiment.
        count: Number of experiments with this one.
    """
    name = result["next"][0]["experiment"]
    place = folder / bags.BAGS / case.name
    moved = motion(model_of(case.robot), name, fleet.get(case.robot).rate)
    more = tuple(f"{bags.NEXT}_{k}" for k in range(1, count + 1))
    bags.write_next(folder, case.name, more[-1], moved)
    return {"experiment": name, **examined(place, case.robot, case.seed, more)}


def motion(model: Any, name: str, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Commanded positions and velocities of a proposed experiment, (T, m) each.

    Args:
        model: Model of the robot without hidden effects.
        name: Name of the experiment.
        rate: Commands per second.
    """
    experiment = pool.within_limits(pool.choose(pool.pool(model), name))
    experiment = experiment.replace(control_rate=rate)
    target = experiment.make_target()
    target.reset()
    q, dq = zip(*(target.step(k / rate) for k in range(experiment.ticks)), strict=True)
    return np.array(q), np.array(dq)


def examined(place: Path, robot: str, seed: int, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """Result of the workflow on the bags in a folder, without any other input.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        seed: Seed of the workflow.
        more: Names of further bags to fit.
    """
    return _found(*read(place, robot, more), GapParams(seed=seed))


def _found(model: Any, fit: list, held: list, params: GapParams) -> dict[str, Any]:
    """Parts of `gap.json` that a battery stores; an error becomes a verdict."""
    try:
        result = workflow.find(model, fit, held, params)
        return {key: result[key] for key in KEPT if key in result}
    except LocoError as error:
        return {"verdict": "error", "names": [], "terms": [], "error": str(error)}


@contextlib.contextmanager
def _timed(folder: Path, case: str, what: str) -> Iterator[None]:
    """Log the duration of the block, in a separate file since it differs from run to run."""
    began, cpu_start = time.perf_counter(), time.process_time()
    yield
    wall, cpu = time.perf_counter() - began, time.process_time() - cpu_start
    bags.note_time(folder, case, what, wall, cpu)


def compared(place: Path, robot: str, seed: int, names: tuple[str, ...]) -> dict[str, Any]:
    """Results of baselines on the same bags; arguments as for `examined`."""
    return baselines.run(names, *read(place, robot), seed)


def model_of(robot: str) -> Any:
    """Nominal model of a robot, including how its base is held."""
    if robot in walkers.WALKERS:
        return Model(trots.robot_of(walkers.get(robot), _folder()))
    machine = fleet.get(robot)
    place = str(_foreign(machine)) if machine.urdf else machine.robot or robot
    return Model(place, dict(machine.overrides), [dict(e) for e in machine.known])


@cache
def _folder() -> Path:
    """Temporary folder of this process for robots that loco lacks."""
    folder = Path(tempfile.mkdtemp(prefix="loco_battery_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _foreign(machine: Machine) -> Path:
    """Robot file in the format of `loco robot new`, with the gains of the machine.

    Its URDF has no shapes, since the robot is fixed in the air and has no contacts.
    """
    path = _folder() / f"{machine.name}.yaml"
    if not path.is_file():
        root = machine.urdf
        root = ET.fromstring(root) if isinstance(root, str) else ET.parse(root).getroot()
        for link in root.iter("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        urdf = path.with_suffix(".urdf")
        write_whole(urdf, ET.tostring(root, encoding="unicode"))
        gains = machine.drives[:, 1:3].tolist()
        values = {
            "urdf": urdf.name, "fixed_base": True, "height": 1.2,
            "joints": list(machine.joints), "standing": machine.start.tolist(),
            "control_rate": machine.rate,
            "drives": {
                joint: {"kind": "impedance", "kp": kp, "kd": kd}
                for joint, (kp, kd) in zip(machine.joints, gains, strict=True)
            },
            **machine.about,
        }  # fmt: skip
        write_whole(path, yaml.safe_dump(values, sort_keys=False))
    return path


def read(place: Path, robot: str, more: tuple[str, ...] = ()) -> tuple[Any, list, list]:
    """Nominal model of a robot, records to fit and held-out records.

    Args:
        place: Folder with fit_* and hold_out bags.
        robot: Name of the robot.
        more: Names of further bags to fit.
    """
    model = model_of(robot)
    machine = model.make_robot()
    names = [*sorted(path.name for path in place.glob("fit_*")), *more]
    fit = [r for name in names for r in load(place / name, machine)]
    held = load(place / HELD, machine) if (place / HELD).is_dir() else []
    return model, fit, held
