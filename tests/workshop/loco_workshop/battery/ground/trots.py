# SPDX-License-Identifier: Apache-2.0
"""Bags of two trots of a robot with hidden effects, as such a robot would record them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import yaml

from loco_bringup.logs.rollout_bag import write_log
from loco_control.exceptions import LocoError
from loco_control.files import write_whole
from loco_learning.runs import experiment as experiments
from loco_learning.runs.rollout import rollout
from loco_sim import lazy

from ..physics.conditions import Condition
from ..physics.hidden import Hidden
from . import walkers
from .walkers import Walker

plant = lazy.module(f"{__package__}.plant")  # imported lazily: the engine is an optional dependency

GAIT = "hyq_trot_open"
STAND, TROT = 0.5, (3.0, 2.0)  # durations of standing and of both trots [s]
APART = 0.08  # smallest difference of their speeds [m/s]


def robot_of(walker: Walker, folder: Path) -> str:
    """Name of the robot for the workflow, or path of a new robot file if loco lacks the robot.

    Args:
        walker: The robot.
        folder: Folder of such robot files.
    """
    if walker.robot:
        return walker.robot
    path = folder / f"{walker.name}.yaml"
    if not path.is_file():
        urdf = path.with_suffix(".urdf")
        write_whole(urdf, ET.tostring(walker.tree(), encoding="unicode"))
        write_whole(path, yaml.safe_dump({"urdf": urdf.name, **walker.about}, sort_keys=False))
    return str(path)


def write(
    place: Path, robot: str, name: str, effects: Sequence[Hidden], how: Condition, seed: int
) -> None:
    """Write the bags ``fit_trot`` and ``hold_out``.

    Args:
        place: Folder of the bags.
        robot: Robot for the workflow, see `robot_of`.
        name: Name of the walker.
        effects: Hidden effects.
        how: Noise, and whether the model has small errors.
        seed: Seed of speeds, noise and model errors.

    Raises:
        LocoError: The robot falls.
    """
    walker, rng = walkers.get(name), np.random.default_rng([seed, 14])
    low, high = walker.speeds
    low_speed = float(rng.uniform(low, high - APART))
    speeds = [low_speed, float(rng.uniform(low_speed + APART, high))]
    for bag, trot, speed in zip(("fit_trot", "hold_out"), TROT, speeds, strict=True):
        values = {
            "robot": robot, "learner.stand": STAND, "learner.train": trot,
            "gait.speed": round(speed, 3), "sim.physics_rate": 250.0 * walker.steps,
        }  # fmt: skip
        e = experiments.load(GAIT, values)
        hides = partial(
            plant.Ground, walker, e.plant, effects=effects, noise=how.noise, off=how.off, seed=seed
        )
        log = rollout(e, plant=hides)
        if log.fall:
            raise LocoError(f"{name} falls: {log.fall}")
        write_log(log, place / bag)
