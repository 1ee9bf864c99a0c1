# SPDX-License-Identifier: Apache-2.0
"""Write cases of the blind battery as bags with only the signals that a robot would record.

The ground truth is written to a separate folder, which `loco gap` never opens.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_bringup.bag.writer import BagWriter
from loco_control.exceptions import BagError
from loco_control.files import write_whole
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS

from . import cases
from .cases import Case
from .drawn import fleet
from .ground import trots, walkers
from .physics import plant
from .physics.plant import Reading

BAGS, TRUTH, RESULTS = "bags", "truth", "results"
TIMES = "times.csv"  # the only file of a battery that differs from run to run
NEXT = "next"  # begin of the names of the bags of proposed experiments


def write(folder: Path, case: Case, robot: str = "") -> None:
    """Write the bags of a filled case and its ground truth; an existing case is kept.

    Args:
        folder: Folder of the battery.
        case: The case.
        robot: Name or file of a walking robot for the workflow.
    """
    if ready(folder, case.name):
        return
    place = folder / BAGS / case.name
    shutil.rmtree(place, ignore_errors=True)
    if case.robot in walkers.WALKERS:
        trots.write(place, robot, case.robot, case.effects, case.condition, case.seed)
    else:
        for name, reading in cases.readings(case).items():
            write_bag(place / name, reading, case.robot)
    write_json(folder / TRUTH / f"{case.name}.json", cases.truth(case))  # written last


def write_next(folder: Path, name: str, record: str, moved: tuple[np.ndarray, np.ndarray]) -> None:
    """Write the bag of one further experiment with the robot of a case.

    Args:
        folder: Folder of the battery.
        name: Name of the case.
        record: Name of the bag.
        moved: Commanded positions and velocities of the driven joints, (T, m) each.
    """
    case = cases.from_truth(truth(folder, name))
    bag = folder / BAGS / name / record
    shutil.rmtree(bag, ignore_errors=True)
    write_bag(bag, cases.further(case, record, moved), case.robot)


def ready(folder: Path, name: str) -> bool:
    """Whether bags and ground truth of a case exist."""
    return (folder / TRUTH / f"{name}.json").is_file() and (folder / BAGS / name).is_dir()


def truth(folder: Path, name: str) -> dict[str, Any]:
    """Hidden effects of a case that is `ready`."""
    return json.loads((folder / TRUTH / f"{name}.json").read_text(encoding="utf-8"))


def keep(folder: Path, result: dict[str, Any]) -> None:
    """Write the result of a case."""
    write_json(folder / RESULTS / f"{result['case']}.json", result)


def result(folder: Path, name: str) -> dict[str, Any] | None:
    """Result of a case; None if there is none yet."""
    path = folder / RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def note_time(folder: Path, case: str, what: str, wall: float, cpu: float) -> None:
    """Append the duration of a part of a case.

    Args:
        folder: Folder of the battery.
        case: Name of the case.
        what: The part: search, followed, settings or baselines.
        wall: Wall time [s].
        cpu: CPU time [s].
    """
    with open(folder / TIMES, "a", encoding="utf-8") as file:
        file.write(f"{case},{what},{wall:.2f},{cpu:.2f}\n")


def times(folder: Path, what: str) -> list[float]:
    """Durations [s] of a part, of all cases that were run."""
    path = folder / TIMES
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    cells = [line.split(",") for line in lines]
    return [float(row[2]) for row in cells if len(row) == 4 and row[1] == what]


def write_bag(folder: Path, reading: Reading, robot: str) -> None:
    """Write one record as a bag of standard messages with the robot's own stamps.

    Raises:
        BagError: The disk is full.
    """
    machine = fleet.get(robot)
    fields, values = ["position"], [reading.q]
    if reading.tau is not None:
        fields, values = [*fields, "effort"], [*values, reading.tau]
    if reading.dq is not None:
        fields, values = [*fields, "velocity"], [*values, reading.dq]
    told = {"position": reading.command, "velocity": reading.rate, "effort": reading.effort}
    quantities = list(machine.commands)
    signals = [told[name] for name in quantities]
    rows = (
        ("joint_states", JointCodec(reading.joints, "joint_states", fields), values),
        ("joint_command", JointCodec(reading.driven, "joint_command", quantities), signals),
    )
    writer = BagWriter(folder, {"robot": robot})
    try:
        for name, _, _ in rows:
            writer.add_row(f"/{name}", JOINT_TOPICS[name])
        for t, name, codec, columns in sorted(_messages(rows, reading), key=lambda m: m[0]):
            writer.write(f"/{name}", codec.pack(t, *columns), round(t * 1e9))
    finally:
        writer.close()
    if machine.integrates:  # a recording does not tell the state of an integrator
        rest = yaml.safe_dump(
            {"format": 1, "records": [{"rest": -max(plant.SETTLE, machine.settle)}]}
        )
        write_whole(folder / "mapping.yaml", rest)
    if writer.failed:  # the bag is valid, but the record is truncated
        raise BagError(f"the bag {folder} is not complete: {writer.failed}")


def _messages(rows: tuple, reading: Reading) -> Iterator[tuple]:
    """Stamp, topic, codec and values of each message, readings before commands."""
    for (name, codec, columns), stamps in zip(rows, (reading.stamp, reading.t), strict=True):
        for k, t in enumerate(stamps.tolist()):
            yield t, name, codec, [column[k] for column in columns]


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write a JSON file; after an error no incomplete file remains."""
    write_whole(path, json.dumps(values, indent=1, sort_keys=True) + "\n")
