# SPDX-License-Identifier: Apache-2.0
"""Figures of a gait search: convergence, and an animation of the gait."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.gait.generator import GaitParams

from ..runs.gait_file import Gait
from ..search import evaluations

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#34568b", "#c0392b", "#2a7f4f", "#b8860b", "#6a3d9a", "#444444")


def convergence(folders: Sequence[str | Path], title: str) -> Figure:
    """Best speed so far, median of each generation and step size over the evaluations.

    Args:
        folders: One per seed, each with the record of a search.
        title: Title of the figure.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained", dpi=120)
    FigureCanvasAgg(figure)  # no display, and no global state as in pyplot
    speed, step = figure.subplots(1, 2, width_ratios=(3, 2))
    for number, folder in enumerate(folders):
        header, rows = evaluations.read(folder)
        c = evaluations.columns(rows, header["population"])
        colour = COLOURS[number % len(COLOURS)]
        label = f"seed {header['seed']}: {-c['best'][-1]:.3f} m/s" if len(c["best"]) else "empty"
        speed.plot(c["evaluations"], -c["best"], color=colour, label=label)
        speed.plot(
            c["evaluations"],
            _walking(rows, header["population"]),
            color=colour,
            alpha=0.35,
            linewidth=0.9,
        )
        step.semilogy(c["evaluations"], c["sigma"], color=colour)
    speed.axhline(0.0, color="#888888", linewidth=0.6)
    speed.set(xlabel="evaluations", ylabel="forward speed [m/s]")
    speed.set_title("best so far; thin: median of those that did not fall", fontsize=9)
    speed.legend(frameon=False, loc="lower right", fontsize=8)
    step.set(xlabel="evaluations", ylabel="step size, share of the ranges [-]")
    figure.suptitle(title, fontsize=11)
    for ax in (speed, step):
        ax.spines[["top", "right"]].set_visible(False)
    return figure


def _walking(rows: list[dict[str, Any]], population: int) -> np.ndarray:
    """Median speed of the successful rollouts of each complete generation, (generations,)."""
    complete = len(rows) // population * population
    speeds = [np.nan if row["reason"] else -row["value"] for row in rows[:complete]]
    with warnings.catch_warnings():  # for generations without a successful rollout
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

    from ..runs.rollout import rollout

    log = rollout(experiment_of(gait))
    part = log.cut(slice(max(0, len(log) - round(seconds / log.dt)), None))
    robot = log.experiment.plant
    columns = (part.t, part.position, part.orientation, part.q)
    render_gif(path, *columns, fps=20.0, size=(420, 260), robot=robot, speed=speed)


def experiment_of(gait: Gait, **changes: Any) -> Any:
    """Experiment that runs a gait on the body for which it was found."""
    if isinstance(gait.target, GaitParams):
        from .legged import experiment

        values = {"name": gait.name, "overrides": gait.overrides, "duration": gait.duration}
        return experiment(gait.robot, values).replace(**{"gait": gait.target, **changes})
    from ..runs.experiment import Experiment

    values: Mapping[str, Any] = {
        "name": gait.name,
        "robot": gait.robot,
        "overrides": gait.overrides,
        "duration": gait.duration,
        "target": gait.target,
    }
    return Experiment(**{**values, **changes})
