# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 6 from the results of `jobs`: 6.1 to 6.5 and 6.7 to 6.11."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from ..drawing.chart import (
    DASHED,
    PALETTE,
    Axis,
    Chart,
    Frame,
    Layer,
    dots,
    line,
    spread,
)
from .results import KMH, Results, author_power, band, converged_at, knee, power_speed

log = logging.getLogger(__name__)

BLUE, RED, GREY, BLACK = "#0072b2", "#d55e00", "#999999", "#222222"

FIGURES: dict[str, tuple[str, Callable[[Results], Chart]]] = {}


def figure(name: str, needs: str = "gaits") -> Callable:
    """Register a figure under its number in the thesis, with the results that it needs."""

    def keep(function: Callable[[Results], Chart]) -> Callable:
        FIGURES[name] = (needs, function)
        return function

    return keep


def charts(results: Results) -> dict[str, Chart]:
    """All figures that the results allow, by their number in the thesis."""
    charts_by_name = {}
    for name, (needs, draw) in FIGURES.items():
        if not getattr(results, needs):
            continue
        try:
            charts_by_name[name] = draw(results)
        except (KeyError, IndexError, ValueError) as error:
            log.warning("no figure %s: lacks results (%s)", name, error)
    return charts_by_name


def _over_nodes(label: str, layers: list[Layer], logarithmic: bool = False) -> Frame:
    y = Axis(label, logarithmic, limits=_from_zero(layers, logarithmic))
    return Frame(Axis("nodes [-]"), y, layers)


def _from_zero(layers: list[Layer], logarithmic: bool = False) -> tuple[float, float] | None:
    """Range from zero to slightly above the largest value; None for a logarithmic axis."""
    top = max((float(np.nanmax(layer.y)) for layer in layers if len(layer.y)), default=1.0)
    return None if logarithmic or top <= 0.0 else (0.0, 1.06 * top)


@figure("6.1")
def _scores(r: Results) -> Chart:
    best, clean = (r.over_sizes(what).items() for what in (lambda g: g.best, lambda g: g.clean))
    layers = spread("best evaluation, with noise", list(best), BLUE)
    layers += spread("the same gait without noise", list(clean), RED)
    return Chart([_over_nodes("score [-]", layers)])


@figure("6.2")
def _courses(r: Results) -> Chart:
    frames = []
    for n in (n for n in (3, 5, 10, 20) if (n, 0) in r.gaits):
        g = r.gaits[n, 0]
        x, at = g.population * np.arange(1, len(g.course) + 1), converged_at(g)
        layers = [
            line("mean of the generation", x, g.course[:, 1], GREY, size=0.8),
            line("best so far", x, g.course[:, 2], BLUE, size=1.6),
            line("90 % of the largest mean", [at, at], [0.0, g.course[:, 2].max()], RED,
                 shape=DASHED),
        ]  # fmt: skip
        frames.append(Frame(Axis("evaluations [-]"), Axis("score [-]"), layers, f"{n} nodes"))
    return Chart(frames)


@figure("6.3")
def _speed_power(r: Results) -> Chart:
    speed = [(n, v * KMH) for n, v in r.over_sizes(lambda g: g.speed).items()]
    power = [(n, v / 1e3) for n, v in r.over_sizes(author_power).items()]
    return Chart([
        _over_nodes("speed [km/h]", spread("speed", speed, BLUE)),
        _over_nodes("power, author's formula [kW]", spread("power", power, RED)),
    ])  # fmt: skip


@figure("6.4", "omega")
def _frequencies(r: Results) -> Chart:
    f, everything, layers = r.frequencies, [], list[Layer]()
    for i, n in enumerate(sorted({n for n, _, _ in r.omega})):
        score = [
            np.mean([g.clean for (m, j, _), g in r.omega.items() if (m, j) == (n, k)])
            for k in range(len(f))
        ]
        everything.append(score)
        colour = PALETTE[i % len(PALETTE)]
        layers += [line(f"{n} nodes", f, score, colour), dots(f"{n} nodes", f, score, colour)]
    mean, deviation = np.mean(everything, axis=0), np.std(everything, axis=0)
    lines = [line("all sizes", f, mean, BLUE, size=1.8)]
    lines += [line("one deviation", f, mean + by * deviation, BLUE, shape=DASHED) for by in (-1, 1)]
    top = float(np.max(mean + deviation))
    lines += [
        line("-3 dB band", [limit, limit], [0.0, top], RED, shape=DASHED)
        for limit in band(np.array(f), mean)
    ]
    axes = Axis("frequency [Hz]", logarithmic=True), Axis("score without noise [-]")
    titles = "each size", "all sizes, and their band"
    return Chart([Frame(*axes, each, title)
                  for title, each in zip(titles, (layers, lines), strict=True)])  # fmt: skip


@figure("6.5", "powers")
def _power(r: Results) -> Chart:
    watts, layers = np.array(sorted({p for p, _, _ in r.powers})), list[Layer]()
    for i, f in enumerate(sorted({f for _, f, _ in r.powers})):
        speed, colour = [power_speed(r, p, f) for p in watts], PALETTE[i % len(PALETTE)]
        layers += [line(f"{f:g} Hz", watts / 1e3, speed, colour),
                   dots(f"{f:g} Hz", watts / 1e3, speed, colour)]  # fmt: skip
    layers.append(dots("thesis, 20 kW", [20.0], [14.0], BLACK, size=5.0))
    axes = Axis("power budget [kW]"), Axis("speed [m/s]", limits=_from_zero(layers))
    return Chart([Frame(*axes, layers)])


@figure("6.7", "noise")
def _noise(r: Results) -> Chart:
    sweep = r.noise[min(r.noise)]
    noise, distance = sweep.arrays["noise"], sweep.arrays["distance"]
    at, top = knee(sweep), float(np.max(distance))
    each = dots("runs", np.repeat(noise, distance.shape[1]), distance.ravel(), RED, size=2.0)
    layers = [each, line("mean", noise, distance.mean(axis=1), BLUE, size=1.8),
              line("knee", [at, at], [0.0, top], GREY, shape=DASHED)]  # fmt: skip
    x = Axis("noise on the amplitudes, relative [-]", logarithmic=True)
    return Chart([Frame(x, Axis("distance in 10 s [m]"), layers)])


@figure("6.8", "loops")
def _learning(r: Results) -> Chart:
    loop = r.loops[20, 0]
    t, error = loop.arrays["t"], np.maximum(loop.arrays["error"], 1e-7)
    layers = [line("error", t, error, BLUE, size=0.8)]
    for name in ("closing", "test"):
        at, limits = loop.values[name], [error.min(), error.max()]
        layers.append(line(f"{name} begins", [at, at], limits, GREY))
    y = Axis("error of the readout, rms over links [-]", logarithmic=True)
    return Chart([Frame(Axis("time [s]"), y, layers)])


def _by_size(r: Results, key: str) -> list[tuple[int, np.ndarray]]:
    groups = r.loops_by_size.items()
    return [(n, np.array([c.values[key] for c in loops])) for n, loops in groups]


@figure("6.9", "loops")
def _distances(r: Results) -> Chart:
    layers = spread("open loop", _by_size(r, "open"), BLUE)
    layers += spread("closed loop", _by_size(r, "closed"), RED)
    return Chart([Frame(Axis("nodes [-]"), Axis("distance in the last 10 s [m]"), layers)])


@figure("6.10", "loops")
def _cycles(r: Results) -> Chart:
    frames = []
    for n in (n for n in (5, 10, 15, 20) if (n, 0) in r.loops):
        path = r.loops[n, 0].arrays["cycle"]
        layers = [line("test", *path.T, RED, size=0.5),
                  line("its last tenth", *path[-len(path) // 10 :].T, BLACK)]  # fmt: skip
        axes = (Axis(f"{rank} component [m/s²]") for rank in ("1st", "2nd"))
        frames.append(Frame(*axes, layers, f"{n} nodes"))
    return Chart(frames)


@figure("6.11", "loops")
def _errors(r: Results) -> Chart:
    layers = spread("closing and test", _by_size(r, "nrmse"), BLUE)
    layers += spread("test", _by_size(r, "nrmse_test"), RED)
    return Chart([_over_nodes("NRMSE of the readout [-]", layers, logarithmic=True)])
