# SPDX-License-Identifier: Apache-2.0
"""Scenes of a measured robot and models of it: from results of `loco gap`, or a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError
from loco_learning.gap.localisation import curves
from loco_learning.gap.localisation.curves import Curve, Curves
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_sim.plant import model as models
from loco_sim.robot.frames import link_frames
from loco_sim.robot.robot import Robot
from loco_sim.world.figure import Figure

from ..gap.importing import load
from ..gap.run import ARRAYS, MODEL
from .scene import Scene

ROBOTS = ("measured", "before", "after")
PAUSE = 1.0  # between two recordings [s]


def is_gap(path: Path) -> bool:
    """Whether a path is a folder of results of `loco gap`."""
    return (path / ARRAYS).is_file() and (path / MODEL).is_file()


def scenes_of(folder: Path) -> dict[str, Scene]:
    """Scenes of the measured robot, the initial model and the resulting model.

    All recordings follow one another, held-out ones first. Unmeasured joints keep the standing
    pose and the base is fixed, since recordings do not contain its position.

    Args:
        folder: Results of `loco gap`.

    Raises:
        BagError: No joint angle was measured.
        LocoError: The results cannot be read, or their robot no longer exists.
    """
    loaded, robot = curves.load(folder / ARRAYS), models.load(folder / MODEL).make_robot()
    return {name: _scene(loaded, robot, name) for name in ROBOTS}


def recorded(path: Path, robot: str, mapping: Path | None = None) -> dict[str, Scene]:
    """Scenes of the measured robot and of its model, which gets the recorded commands.

    Args:
        path: Recording of another program: a bag or a table.
        robot: Robot, robot.yaml or model.yaml.
        mapping: Mapping of its topics or columns; None for the one beside it.

    Raises:
        LocoError: The recording cannot be read, or its robot cannot be simulated.
    """
    model = models.load_any(robot)
    records = load(path, model.make_robot(), mapping, judge=False)
    forward = Forward(model, records, ForwardParams(signals=("q",)))
    channels = tuple((c.signal, c.name, c.unit) for c in forward.channels)
    rows = []
    for record, fit in zip(records, forward(), strict=True):
        columns = [record.joints.index(channel.name) for channel in forward.channels]
        q = record.signals["q"][:, columns]
        used = np.ones(len(q), dtype=bool)
        rows.append(Curve(record.name, curves.FIT, record.t, q, fit, fit, 0.0 * q, used,
                          np.zeros(0)))  # fmt: skip
    both, plant = Curves(channels, tuple(rows)), model.make_robot()
    return {"measured": _scene(both, plant, "measured"), "model": _scene(both, plant, "after")}


def _scene(recorded: Curves, robot: Robot, which: str) -> Scene:
    columns = {name: c for c, (signal, name, _) in enumerate(recorded.channels) if signal == "q"}
    if not columns:
        raise BagError("these recordings have no angles of joints, so nothing can be seen to move")
    records = sorted(recorded.records, key=lambda record: record.role == "fit")
    t, values, phases, end = [], [], {}, 0.0
    for record in records:
        phases[f"{record.name} ({record.role})"] = end
        t.append(record.t - record.t[0] + end)
        values.append(getattr(record, which))
        end = t[-1][-1] + PAUSE
    time, every = np.concatenate(t), np.concatenate(values)
    q = np.tile(robot.standing, (len(time), 1))
    for i, joint in enumerate(robot.joints):
        if joint in columns:
            q[:, i] = _filled(time, every[:, columns[joint]], robot.standing[i])
    turns, positions, above = {}, {}, np.array([0.0, 0.0, _height(robot)])
    for link, (turn, origin) in link_frames(robot, q).items():
        turns[link], positions[link] = turn, origin + above
    signals = {f"{s}/{name}": every[:, c] for c, (s, name, _) in enumerate(recorded.channels)}
    return Scene(time, turns, positions, Figure(robot).shapes(), {}, signals, phases)


def _height(robot: Robot) -> float:
    """Height of the base [m]: of the fixed base, or with the feet on the ground."""
    if robot.height is not None:
        return robot.height
    frames = link_frames(robot, np.asarray(robot.standing, dtype=float)[None], robot.feet)
    return -min((float(frames[foot][1][0, 2]) for foot in robot.feet), default=0.0)


def _filled(t: np.ndarray, values: np.ndarray, default: float) -> np.ndarray:
    """Values with missing ones interpolated linearly; `default` if all are missing."""
    finite = np.isfinite(values)
    return np.interp(t, t[finite], values[finite]) if finite.any() else np.full(len(t), default)
