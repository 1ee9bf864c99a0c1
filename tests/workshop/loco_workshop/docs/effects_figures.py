# SPDX-License-Identifier: Apache-2.0
"""Figures of the effects: responses of the plant without and with an effect.

One small figure per effect for `docs/effects.md`, each from a suitable deterministic
experiment on a test bench or on Tigrillo.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots

from .effects_fingerprints import FINGERPRINTS, Fingerprint

Record = dict[str, np.ndarray]
GREY, ORANGE = "#8a8f98", "#d65a1e"


def record(f: Fingerprint, listed: list[dict[str, Any]]) -> Record:
    """Signals of the experiment, one value per sample."""
    rows: list[dict[str, float]] = []
    robot = robots.load(f.robot)
    rest, n, m = robot.standing, len(robot.joints), len(robot.feet)
    chain = effects.from_list([*f.base, *listed])
    with Simulation(effects=chain, robot=robot, seed=1, standing=rest + f.begin) as sim:
        for k in range(round(f.duration / sim.dt)):
            t = k * sim.dt
            command = MotionCommand(k, t, rest + f.q(t), np.zeros(n))
            trunk = TrunkTorque(k, t, np.full(n, f.tau(t)), np.zeros(6), np.ones(m, bool))
            state, j = sim.step(command, trunk), f.joint
            position = sim.ground_truth().position
            rows.append(
                {
                    "t": t,
                    "q": sim.true_q[j],
                    "dq": sim.true_dq[j],
                    "tau": state.tau[j],
                    "said": state.q[j],
                    "wanted": f.q(t),
                    "forward": position[0],
                    "left": position[1],
                    "height": position[2],
                    "ahead": state.linear_acceleration[0],
                    "turn": state.angular_velocity[1],
                    "pitch": 2.0 * state.orientation[1],
                }
            )
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def draw(name: str, path: Path) -> None:
    """Write the figure of an effect."""
    matplotlib.use("Agg")
    f = FINGERPRINTS[name]
    nominal, with_it = record(f, []), record(f, [{"name": name, **f.values}])
    with plt.rc_context({"font.size": 7.5, "axes.spines.top": False, "axes.spines.right": False}):
        figure, axes = plt.subplots(figsize=(3.4, 1.9), dpi=110, layout="constrained")
        for rows, colour, width in ((nominal, GREY, 2.2), (with_it, ORANGE, 1.2)):
            rows_drawn = rows["t"] >= f.after
            axes.plot(rows[f.x][rows_drawn], rows[f.y][rows_drawn], color=colour, lw=width)
        axes.set_xlabel(f.labels[0])
        axes.set_ylabel(f.labels[1])
        figure.savefig(path)
        plt.close(figure)
    image = Image.open(path).convert("RGB").quantize(24)
    image.save(path, optimize=True)


def draw_all(folder: Path, names: Iterable[str] = ()) -> list[Path]:
    """Write the figures of the named effects, default all; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in names or effects.names():
        written.append(folder / f"{name}.png")
        draw(name, written[-1])
    return written
