# SPDX-License-Identifier: Apache-2.0
"""Figures of a gait search: convergence, and an animation of the gait."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.gait.generator import GaitParams

from ..drawing.chart import PALETTE, Axis, Chart, Frame, Layer, line
from ..runs.experiment import Experiment
from ..runs.gait_file import Gait
from ..runs.rollout import rollout
from ..search import evaluations
from . import legged


def convergence(folders: Sequence[str | Path], title: str) -> Chart:
    """Best speed so far, median of each generation and step size over the evaluations.

    Args:
        folders: One per seed, each with the record of a search.
        title: Title of the figure.
    """
    speeds, steps = list[Layer](), list[Layer]()
    for number, folder in enumerate(folders):
        header, rows = evaluations.read(folder)
        c = evaluations.columns(rows, header["population"])
        colour, best = PALETTE[number % len(PALETTE)], -c["best"]
        name = f"seed {header['seed']}: " + (f"{best[-1]:.3f} m/s" if len(best) else "empty")
        walking = _walking(rows, header["population"])
        speeds += [line(name, c["evaluations"], best, colour, size=1.9),
                   line(name, c["evaluations"], walking, colour, size=0.7)]  # fmt: skip
        steps.append(line(name, c["evaluations"], c["sigma"], colour, size=1.9))
    x, step = Axis("evaluations"), Axis("step size, share of the ranges [-]", logarithmic=True)
    text = f"{title}, best so far; thin: median without falls"
    return Chart([Frame(x, Axis("forward speed [m/s]"), speeds, text), Frame(x, step, steps)])


def _walking(rows: list[dict[str, Any]], population: int) -> np.ndarray:
    """Median speed of the successful rollouts of each complete generation, (generations,)."""
    complete = len(rows) // population * population
    speeds = [np.nan if row["reason"] else -row["value"] for row in rows[:complete]]
    with warnings.catch_warnings():  # generations may have no successful rollout
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanmedian(np.reshape(speeds, (-1, population)), axis=1)


def animate(gait: Gait, path: str | Path, seconds: float = 2.0, speed: float = 0.5) -> None:
    """Write a GIF of the last seconds of a gait on its body.

    Args:
        gait: Gait to show.
        path: File to write.
        seconds: Simulated time shown [s].
        speed: Playback speed over real time.
    """
    from loco_sim.world.render import render_gif

    log = rollout(experiment_of(gait))
    part = log.cut(slice(max(0, len(log) - round(seconds / log.dt)), None))
    robot = log.experiment.plant
    columns = (part.t, part.position, part.orientation, part.q)
    render_gif(path, *columns, fps=20.0, size=(420, 260), robot=robot, speed=speed)


def experiment_of(gait: Gait, **changes: Any) -> Any:
    """Experiment that runs a gait on the body for which it was found."""
    values = {"name": gait.name, "overrides": gait.overrides, "duration": gait.duration}
    if isinstance(gait.target, GaitParams):
        return legged.experiment(gait.robot, values).replace(**{"gait": gait.target, **changes})
    return Experiment(**{**values, "robot": gait.robot, "target": gait.target, **changes})
