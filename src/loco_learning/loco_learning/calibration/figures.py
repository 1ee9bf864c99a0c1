# SPDX-License-Identifier: Apache-2.0
"""Figures of a calibration: convergence (figure 5.2b), average periods (figure 5.4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.chart import GREY, Axis, Chart, Frame, dots, line
from .mawe import UNITS
from .parameters import parameter_set
from .results import Comparison, Result, spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours as in figure 5.4, in shades that are safe for colour-blind readers.
ROBOT = {"color": "#0072b2", "lw": 2.6, "solid_capstyle": "butt"}
DEFAULT = {"color": "#2a9d6f", "lw": 1.2, "ls": (0, (5, 2))}
CALIBRATED = {"color": "#d55e00", "lw": 1.4}
LINES = {"robot": ROBOT, "default": DEFAULT, "calibrated": CALIBRATED}
WIDTH = 7.4  # [in]
HARMONICS = 12  # harmonics shown; a sine of the hips has only one

FIGURES: dict[str, Callable[[Result], Figure]] = {}


def figure(function: Callable[[Result], Figure]) -> Callable[[Result], Figure]:
    """Register a figure under the name of its function."""
    FIGURES[function.__name__] = function
    return function


def _canvas(rows: int, columns: int, height: float, **kwargs: object) -> tuple[Figure, np.ndarray]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained", dpi=120)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **kwargs)
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes


@figure
def convergence(result: Result) -> Figure:
    """Smallest error so far over the generations, one line per seed, as figure 5.2b."""
    fig, ((ax,),) = _canvas(1, 1, 3.0)
    for fit in result.fits:
        count = [0, *(g.index for g in fit.history)]
        best = fit.curve
        ax.step(count, best, where="post", lw=1.1, label=f"seed {fit.seed}")
        at = fit.plateau
        ax.plot(count[at], best[at], "o", ms=4, color=ax.lines[-1].get_color())
    before = result.fits[0].before
    ax.axhline(before, color=DEFAULT["color"], lw=0.9, ls=DEFAULT["ls"])
    ax.annotate("default body", (1.0, before), (0, 3), xycoords=("axes fraction", "data"),
                textcoords="offset points", ha="right", color=DEFAULT["color"])  # fmt: skip
    ax.set(xlabel="generation", ylabel=f"windowed error ({result.loss}) [{UNITS[result.loss]}]")
    ax.set(yscale="log", ylim=(0.8 * min(fit.error for fit in result.fits), 1.4 * before))
    fig.legend(loc="outside upper left", ncols=len(result.fits) + 1,
               title="dots: 95 % of the way down")  # fmt: skip
    return fig


@figure
def periods(result: Result) -> Figure:
    """Average period of every passive joint for every recording, as figure 5.4."""
    rows, joints = result.comparisons, result.joints
    fig, axes = _canvas(len(rows), len(joints), 0.6 + 1.75 * len(rows), sharey="row", sharex="row")
    for columns, row in zip(axes, rows, strict=True):
        for j, (ax, joint) in enumerate(zip(columns, joints, strict=True)):
            _draw(ax, row, j)
            if row is rows[0]:
                ax.set_title(joint.removesuffix("_joint").replace("_", " "))
        columns[0].set_ylabel(f"{_short(row.name)}\nknee angle [deg]")
    for ax in axes[-1]:
        ax.set_xlabel("time in the period [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    what = "surrogate robot" if result.surrogate else "robot"
    labels = [what if text == "robot" else f"{text} model" for text in labels]
    fig.legend(handles, labels, loc="outside upper left", ncols=3)
    return fig


def _short(name: str) -> str:
    return name.removeprefix("surrogate_").replace("_", " ")


def _draw(ax, row: Comparison, j: int) -> None:
    count = len(row.curves["robot"])
    t = np.arange(count) / count * row.period
    for name, style in LINES.items():
        mean = np.degrees(row.curves[name][:, j])
        deviation = np.degrees(row.curves[f"{name}_spread"][:, j])
        ax.fill_between(
            t, mean - deviation, mean + deviation, color=style["color"], alpha=0.18, lw=0
        )
        ax.plot(t, mean, label=name, **style)


def spectra(row: Comparison, result: Result) -> Chart:
    """Amplitudes of each passive joint's first harmonics: the transfer functions of eq. (5.2)."""
    frames = []
    count = np.arange(1, HARMONICS + 1)
    for j, joint in enumerate(result.joints):
        layers = [
            line(name, count / row.period, np.degrees(spectrum(row.curves[name])[count, j]),
                 str(style["color"]), size=2.4 if name == "robot" else 1.4)
            for name, style in LINES.items()
        ]  # fmt: skip
        axes = Axis("frequency [Hz]"), Axis("amplitude [deg]", logarithmic=True)
        frames.append(
            Frame(*axes, layers, joint.removesuffix("_joint").replace("_", " "), height=200)
        )
    return Chart(frames)


def bodies(result: Result) -> Chart:
    """Parameters of each seed between their bounds."""
    parameters = parameter_set(result.options["parameters"])
    names = [p.text for p in parameters.parameters][::-1]
    rows, gap = np.arange(len(names)), np.full(len(names), np.nan)
    ticks = np.column_stack([0 * rows, 0 * rows + 1, gap]).ravel()
    layers = [line("bounds", ticks, np.column_stack([rows, rows, gap]).ravel(), GREY, size=2.0)]
    for fit in result.fits:
        pairs = zip(parameters.parameters, fit.values.values(), strict=True)
        values = [f"seed {fit.seed}: {p.text} {value:.4g} {p.unit}" for p, value in pairs]
        at = parameters.to_unit(fit.values)[::-1]
        layers.append(dots("calibrated, each seed", at, rows, str(CALIBRATED["color"]),
                           texts=values[::-1]))  # fmt: skip
    default = parameters.to_unit(parameters.default)[::-1]
    layers.append(dots("default", default, rows, str(DEFAULT["color"])))
    thesis_marks = [
        (p.to_unit(p.thesis), y)
        for p, y in zip(parameters.parameters[::-1], rows, strict=True)
        if p.thesis is not None
    ]
    if thesis_marks:
        layers.append(
            dots("thesis, Table 5.1", *zip(*thesis_marks, strict=True), "#222222", size=2.5)
        )
    axes = (
        Axis("place between the bounds [-]", limits=(-0.03, 1.03)),
        Axis("parameter", names=names),
    )
    return Chart([Frame(*axes, layers, height=70 + 26 * len(names))])
