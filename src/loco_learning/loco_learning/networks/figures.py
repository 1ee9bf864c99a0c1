# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 6 from the results of `msd_jobs`: 6.1 to 6.5 and 6.7 to 6.11."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from loco_control.files import write_whole

from .results import KMH, Results, author_power, band, converged_at, knee, loops_of, power_speed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)

BLUE, RED, GREY = "#34568b", "#c0392b", "0.6"

FIGURES: dict[str, tuple[str, Callable[[Results], Figure]]] = {}


def figure(name: str, needs: str = "gaits") -> Callable:
    """Register a figure under its number in the thesis, with the results it is drawn from."""

    def keep(function: Callable[[Results], Figure]) -> Callable:
        FIGURES[name] = (needs, function)
        return function

    return keep


def write(results: Results, folder: Path) -> list[Path]:
    """Draw all figures that the results allow; returns their files."""
    paths = []
    for name, (needs, draw) in FIGURES.items():
        if not getattr(results, needs):
            continue
        try:
            canvas = draw(results)
        except (KeyError, IndexError, ValueError) as error:
            log.warning("no figure %s: lacks results (%s)", name, error)
            continue
        path = folder / f"figure_{name.replace('.', '_')}.png"
        paths.append(write_whole(path, partial(canvas.savefig, format="png")))
    return paths


def _new(columns: int = 1, rows: int = 1, size: tuple[float, float] = (6.0, 3.4), **kwargs):
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = Figure(figsize=size, layout="constrained", dpi=110)
    FigureCanvasAgg(canvas)
    axes = np.atleast_1d(canvas.subplots(rows, columns, **kwargs)).reshape(-1)
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)
    return canvas, axes


def _bars(ax, values: dict[int, np.ndarray], colour: str, label: str) -> None:
    """Means with their spread over repetitions."""
    n = list(values)
    ax.errorbar(
        n, [v.mean() for v in values.values()], [v.std() for v in values.values()],
        color=colour, marker="o", ms=4, capsize=2, lw=1.2, label=label,
    )  # fmt: skip


@figure("6.1")
def _scores(r: Results) -> Figure:
    canvas, (ax,) = _new()
    _bars(ax, r.over_sizes(lambda g: g.best), BLUE, "best evaluation, with noise")
    _bars(ax, r.over_sizes(lambda g: g.clean), RED, "the same gait without noise")
    ax.set(xlabel="nodes", ylabel="score [-]", ylim=(0.0, None))
    ax.legend(frameon=False)
    return canvas


@figure("6.2")
def _courses(r: Results) -> Figure:
    sizes = [n for n in (3, 5, 10, 20) if (n, 0) in r.gaits]
    canvas, axes = _new(2, 2, (8.0, 5.0))
    for ax, n in zip(axes, sizes, strict=False):
        g = r.gaits[n, 0]
        x = g.population * np.arange(1, len(g.course) + 1)
        ax.plot(x, g.course[:, 1], color=GREY, lw=0.8, label="mean of the generation")
        ax.plot(x, g.course[:, 2], color=BLUE, lw=1.4, label="best so far")
        ax.axvline(converged_at(g), color=RED, ls=":", lw=1.0, label="90 % of the largest mean")
        ax.set(title=f"{n} nodes", xlabel="evaluations", ylabel="score [-]")
    axes[0].legend(frameon=False, fontsize=8)
    return canvas


@figure("6.3")
def _speed_power(r: Results) -> Figure:
    canvas, (left, right) = _new(2, size=(8.0, 3.4))
    _bars(left, {n: v * KMH for n, v in r.over_sizes(lambda g: g.speed).items()}, BLUE, "")
    left.set(xlabel="nodes", ylabel="speed [km/h]", ylim=(0.0, None))
    _bars(right, {n: v / 1e3 for n, v in r.over_sizes(author_power).items()}, RED, "")
    right.set(xlabel="nodes", ylabel="power, author's formula [kW]", ylim=(0.0, None))
    return canvas


@figure("6.4", "omega")
def _frequencies(r: Results) -> Figure:
    canvas, (left, right) = _new(2, size=(8.5, 3.6), sharey=True)
    f = r.frequencies
    everything = []
    for n in sorted({n for n, _, _ in r.omega}):
        score = [
            np.mean([g.clean for (m, j, _), g in r.omega.items() if (m, j) == (n, k)])
            for k in range(len(f))
        ]
        everything.append(score)
        left.semilogx(f, score, marker="o", ms=3, lw=1.0, label=f"{n} nodes")
    left.legend(frameon=False)
    mean, spread = np.mean(everything, axis=0), np.std(everything, axis=0)
    right.semilogx(f, mean, color=BLUE)
    right.fill_between(f, mean - spread, mean + spread, color=BLUE, alpha=0.2)
    for edge in band(r):
        right.axvline(edge, color=RED, ls=":")
        right.annotate(f"{edge:.2f} Hz", (edge, 0.02), color=RED)
    left.set(xlabel="frequency [Hz]", ylabel="score without noise [-]")
    right.set(xlabel="frequency [Hz]", title="all sizes, and its -3 dB band")
    return canvas


@figure("6.5", "powers")
def _power(r: Results) -> Figure:
    canvas, (ax,) = _new()
    watts = sorted({p for p, _, _ in r.powers})
    for f in sorted({f for _, f, _ in r.powers}):
        speed = [power_speed(r, p, f) for p in watts]
        ax.plot(np.array(watts) / 1e3, speed, marker="o", ms=4, label=f"{f:g} Hz")
    ax.plot(20.0, 14.0, "k+", ms=10, label="thesis, 20 kW")
    ax.set(xlabel="power budget [kW]", ylabel="speed [m/s]", ylim=(0.0, None))
    ax.legend(frameon=False)
    return canvas


@figure("6.7", "noise")
def _noise(r: Results) -> Figure:
    canvas, (ax,) = _new()
    noise, distance = r.noise.arrays["noise"], r.noise.arrays["distance"]
    ax.semilogx(noise, distance, ".", color=RED, ms=4)
    ax.semilogx(noise, distance.mean(axis=1), color=BLUE)
    ax.axvline(knee(r.noise), color=GREY, ls=":")
    ax.set(xlabel="noise on the amplitudes, relative [-]", ylabel="distance in 10 s [m]")
    return canvas


@figure("6.8", "loops")
def _learning(r: Results) -> Figure:
    canvas, (ax,) = _new()
    loop = r.loops[20, 0]
    t, error = loop.arrays["t"], np.maximum(loop.arrays["error"], 1e-7)
    ax.semilogy(t, error, color=BLUE, lw=0.6)
    for name, start in (("closing", loop.values["closing"]), ("test", loop.values["test"])):
        ax.axvline(start, color=GREY, lw=0.8)
        ax.annotate(name, (start, 1.01), xycoords=ax.get_xaxis_transform(), color="0.4")
    ax.set(xlabel="time [s]", ylabel="error of the readout, rms over links [-]")
    return canvas


def _by_size(r: Results, key: str) -> dict[int, np.ndarray]:
    sizes = sorted({n for n, _ in r.loops})
    return {n: np.array([c.values[key] for c in loops_of(r, n)]) for n in sizes}


@figure("6.9", "loops")
def _distances(r: Results) -> Figure:
    canvas, (ax,) = _new()
    _bars(ax, _by_size(r, "open"), BLUE, "open loop")
    _bars(ax, _by_size(r, "closed"), RED, "closed loop")
    ax.set(xlabel="nodes", ylabel="distance in the last 10 s [m]")
    ax.legend(frameon=False)
    return canvas


@figure("6.10", "loops")
def _cycles(r: Results) -> Figure:
    sizes = [n for n in (5, 10, 15, 20) if (n, 0) in r.loops]
    canvas, axes = _new(2, 2, (7.0, 6.5))
    for ax, n in zip(axes, sizes, strict=False):
        path = r.loops[n, 0].arrays["cycle"]
        colours = np.linspace(0.0, 1.0, len(path))
        ax.scatter(*path.T, c=colours, cmap="YlOrBr", s=1.0, lw=0, rasterized=True)
        last = path[-len(path) // 10 :]
        ax.plot(*last.T, color="black", lw=0.7)
        ax.set(title=f"{n} nodes", xlabel="1st component [m/s²]", ylabel="2nd component [m/s²]")
    return canvas


@figure("6.11", "loops")
def _errors(r: Results) -> Figure:
    canvas, (ax,) = _new()
    _bars(ax, _by_size(r, "nrmse"), BLUE, "closing and test")
    _bars(ax, _by_size(r, "nrmse_test"), RED, "test")
    ax.set(xlabel="nodes", ylabel="NRMSE of the readout [-]", yscale="log")
    ax.legend(frameon=False)
    return canvas
