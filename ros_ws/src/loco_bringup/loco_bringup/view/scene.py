# SPDX-License-Identifier: Apache-2.0
"""Scene of a recorded run for a viewer: link poses, foot forces, signals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from loco_learning.runs.log import Log
from loco_sim.robot.frames import link_frames
from loco_sim.world.figure import Figure

Shape = tuple[np.ndarray, np.ndarray]  # triangles [m], (t, 3, 3), and colours, (t, 3)


@dataclass(frozen=True)
class Scene:
    """Displayed data of a run.

    Attributes:
        t: Time of each tick [s], (T,).
        turns: Rotation matrix of each link, link to world, (T, 3, 3), by name.
        places: Origin of each link in the world frame [m], (T, 3), by name.
        shapes: Triangle mesh of each link that has one, by name.
        forces: Force of the ground on each foot [N], (T, 3), by name; empty if not recorded.
        signals: Curves, (T,), by ``group/name``.
        phases: Start of each learning phase [s], by name.
    """

    t: np.ndarray
    turns: dict[str, np.ndarray]
    places: dict[str, np.ndarray]
    shapes: dict[str, Shape]
    forces: dict[str, np.ndarray] = field(default_factory=dict)
    signals: dict[str, np.ndarray] = field(default_factory=dict)
    phases: dict[str, float] = field(default_factory=dict)


def scene_of(log: Log) -> Scene:
    """Scene of a run; a base without recorded position stays at the origin."""
    robot, ticks = log.experiment.plant, len(log)
    base, position = np.tile(np.eye(3), (ticks, 1, 1)), np.zeros((ticks, 3))
    if log.has("position", "orientation"):
        base, position = Rotation.from_quat(log.orientation).as_matrix(), log.position
    turns, positions = {}, {}
    for link, (turn, origin) in link_frames(robot, log.q).items():
        turns[link] = base @ turn
        positions[link] = position + np.einsum("tij,tj->ti", base, origin)
    forces = {}
    if log.has("grf"):
        forces = {foot: log.grf[:, i] for i, foot in enumerate(robot.feet)}
    phases = {name: float(log.t[ticks.start]) for name, ticks in log.phases().items()}
    return Scene(log.t, turns, positions, Figure(robot).shapes(), forces, _signals(log), phases)


def _signals(log: Log) -> dict[str, np.ndarray]:
    """Joint angles and torques, commands of the drives, stance, and the network's error."""
    robot, curves = log.experiment.plant, {}
    groups = {"angle": ("q", robot.joints), "torque": ("tau", robot.joints),
              "stance": ("stance", robot.feet)}  # fmt: skip
    for group, (column, names) in groups.items():
        if log.has(column):
            for i, name in enumerate(names):
                curves[f"{group}/{name}"] = getattr(log, column)[:, i].astype(float)
    if log.has("command"):
        driven = [robot.joints[i] for i in robot.driven]
        curves |= {f"command/{name}": log.command[:, i] for i, name in enumerate(driven)}
    if log.has("error"):
        curves["network/error"] = log.error
    return curves
