# SPDX-License-Identifier: Apache-2.0
"""Recordings of a fleet with planted faults, simulated by the generator of the battery.

The robots are arms of `pybullet_data` with seven joints. One of them gets friction from a day on,
one a payload, one a sensor with a bias; nothing is planted in the others.

    python -m loco_workshop.fleet bags/fleet --robots 10 --days 10 --each 10
    loco gap fleet bags/fleet --robot bags/fleet/robot/kuka_iiwa.yaml --out results/fleet
    python -m loco_workshop.fleet bags/fleet --days 10 --score results/fleet
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .battery import bags, trial
from .battery.physics import excitation, machines, plant
from .battery.physics.hidden import Hidden

MACHINE = "kuka_iiwa"
COULOMB = Hidden("coulomb_friction", "lbr_iiwa_joint_4", "torque", {"torque": 1.0})
HAND = {"link": "lbr_iiwa_link_7", "mass": 0.3, "position": [0.0, 0.0, 0.08]}
PAYLOAD = Hidden("payload", HAND["link"], "mass", HAND)
BIAS = Hidden("sensor_bias", "lbr_iiwa_joint_2", "q", {"q": 0.005})


@dataclass(frozen=True)
class Fault:
    """A planted effect: robot, first and last day on which it is there, from 1."""

    robot: str
    effect: Hidden
    since: int
    until: int = 10**6


def faults(days: int) -> list[Fault]:
    """The three planted faults of a fleet."""
    return [
        Fault("arm_2", COULOMB, min(4, days)),
        Fault("arm_5", PAYLOAD, 1),
        Fault("arm_8", BIAS, 1),
    ]


def write(folder: Path, robots: int, days: int, each: int, seed: int, pieces: int = 5) -> int:
    """Write the bags ``arm_R/day_D/run_N`` that are missing; returns the number of all.

    Args:
        folder: Folder of the fleet.
        robots: Number of robots.
        days: Number of days.
        each: Recordings of each robot on each day.
        seed: Seed of commands and noise.
        pieces: Motions of 4 s in a recording.
    """
    machine = machines.get(MACHINE)
    given = Path(trial.model_of(MACHINE).robot)
    (folder / "robot").mkdir(parents=True, exist_ok=True)
    for file in (given, given.with_suffix(".urdf")):
        shutil.copy(file, folder / "robot")
    count = 0
    for robot in range(1, robots + 1):
        for day in range(1, days + 1):
            name = f"arm_{robot}"
            planted = [
                f.effect for f in faults(days) if f.robot == name and f.since <= day <= f.until
            ]
            for run in range(1, each + 1):
                place, count = folder / name / f"day_{day}" / f"run_{run}", count + 1
                if (place / "metadata.yaml").is_file():
                    continue
                shutil.rmtree(place, ignore_errors=True)
                key = int(np.random.default_rng([seed, robot, day, run]).integers(2**31))
                reading = plant.record(
                    machine, planted, _command(machine, key, pieces), key, "fleet"
                )
                bags.write_bag(place, reading, MACHINE)
    return count


def _command(machine: machines.Machine, seed: int, pieces: int) -> excitation.Command:
    """Positions, velocities and efforts of several motions, one after the other, (T, m) each."""
    names = [record.name for record in machine.records]
    parts = [
        excitation.command(machine, names[(seed + i) % len(names)], seed + i) for i in range(pieces)
    ]
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def score(result: Mapping[str, Any], days: int) -> list[str]:
    """A line for each robot: whether its effects, places and days are those that were planted.

    Args:
        result: Contents of ``fleet.json``.
        days: Number of days.
    """
    lines = []
    for row in result["robots"]:
        planted = {
            (f.effect.effect, f.effect.place, f"day_{f.since}" if f.since > 1 else None): f.effect
            for f in faults(days)
            if f.robot == row["robot"]
        }
        found = {
            (one["effect"], one["place"], one["day"]): one for one in row["effects"] if one["has"]
        }
        sizes = [f"{one['size']:.4g} of {planted[key].size:.4g}" for key, one in found.items()
                 if key in planted]  # fmt: skip
        verdict = "right" if planted.keys() == found.keys() else f"wrong: {sorted(map(str, found))}"
        left = f", {row['unexplained']} unexplained" if row["unexplained"] else ""
        lines.append(" ".join([f"{row['robot']}: {verdict}", *sizes]) + left)
    return lines


def main() -> None:
    """Write a fleet, or score the answer about it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    for name, value in (("robots", 10), ("days", 10), ("each", 10), ("seed", 7)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--score", type=Path, help="folder of the results of `loco gap fleet`")
    a = parser.parse_args()
    if a.score:
        result = json.loads((a.score / "fleet.json").read_text(encoding="utf-8"))
        sys.stdout.write("\n".join(score(result, a.days)) + "\n")
    else:
        count = write(a.folder, a.robots, a.days, a.each, a.seed)
        sys.stdout.write(f"{count} recordings\n")


if __name__ == "__main__":
    main()
