# SPDX-License-Identifier: Apache-2.0
"""Charts of a calibration: convergence (figure 5.2b), average periods (figure 5.4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..drawing.chart import DASHED, GREY, PALETTE, Axis, Chart, Frame, dots, line, short
from .mawe import UNITS
from .parameters import parameter_set
from .results import Comparison, Result, spectrum

# Colours as in figure 5.4, in shades that are safe for colour-blind readers.
ROBOT, DEFAULT, CALIBRATED = "#0072b2", "#2a9d6f", "#d55e00"
COLOURS = {"robot": ROBOT, "default": DEFAULT, "calibrated": CALIBRATED}
HARMONICS = 12  # harmonics shown; a sine of the hips has only one


def convergence(result: Result) -> Chart:
    """Smallest error so far over the generations, one line per seed, as figure 5.2b."""
    layers, last = [], max(len(fit.history) for fit in result.fits)
    for number, fit in enumerate(result.fits):
        name, colour = f"seed {fit.seed}", PALETTE[number % len(PALETTE)]
        layers.append(line(name, range(len(fit.curve)), fit.curve, colour, size=1.6))
        layers.append(dots(name, [fit.plateau], [fit.curve[fit.plateau]], colour))
    before = [result.fits[0].before] * 2
    layers.append(line("default body", [0, last], before, DEFAULT, shape=DASHED))
    y = Axis(f"windowed error ({result.loss}) [{UNITS[result.loss]}]", logarithmic=True)
    return Chart([Frame(Axis("generation"), y, layers)])


Period = tuple[str, str, np.ndarray, np.ndarray]  # name, colour, mean and deviation, (N, J) [rad]


def period_frames(joints: Sequence[str], length: float, periods: Sequence[Period]) -> list[Frame]:
    """Average periods of some robots, a frame for each joint; dashed, one deviation around.

    Args:
        joints: Names of the joints, columns of the periods.
        length: Length of a period [s].
        periods: Name, colour, mean and standard deviation of each robot; the first is measured.
    """
    frames = []
    for j, joint in enumerate(joints):
        layers = []
        for name, colour, mean, deviation in periods:
            t, size = np.arange(len(mean)) / len(mean) * length, 1.6 if layers else 2.4
            for by in (-1.0, 1.0):
                bound = np.degrees(mean[:, j] + by * deviation[:, j])
                layers.append(line(name, t, bound, colour, size=0.8, shape=DASHED))
            layers.append(line(name, t, np.degrees(mean[:, j]), colour, size=size))
        axes = Axis("time in the period [s]"), Axis("joint angle [deg]")
        frames.append(Frame(*axes, layers, short(joint), height=200))
    return frames


def periods(row: Comparison, result: Result) -> Chart:
    """Average period of every passive joint in one recording, as figure 5.4."""
    curves = [(_name(name, result), colour, row.curves[name], row.curves[f"{name}_spread"])
              for name, colour in COLOURS.items()]  # fmt: skip
    return Chart(period_frames(result.joints, row.period, curves))


def _name(curve: str, result: Result) -> str:
    return "surrogate robot" if result.surrogate and curve == "robot" else curve


def all_periods(result: Result) -> Chart:
    """The same for all recordings, a row for each."""
    frames = []
    for row in result.comparisons:
        name = row.name.removeprefix("surrogate_").replace("_", " ")
        frames += [replace(f, title=f"{name}, {f.title}") for f in periods(row, result).frames]
    return Chart(frames, columns=len(result.joints))


def spectra(row: Comparison, result: Result) -> Chart:
    """Amplitudes of each passive joint's first harmonics: the transfer functions of eq. (5.2)."""
    frames, count = [], np.arange(1, HARMONICS + 1)
    for j, joint in enumerate(result.joints):
        layers = [
            line(_name(name, result), count / row.period,
                 np.degrees(spectrum(row.curves[name])[count, j]),
                 colour, size=2.4 if name == "robot" else 1.4)
            for name, colour in COLOURS.items()
        ]  # fmt: skip
        axes = Axis("frequency [Hz]"), Axis("amplitude [deg]", logarithmic=True)
        frames.append(Frame(*axes, layers, short(joint), height=200))
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
        layers.append(dots("calibrated, each seed", at, rows, CALIBRATED,
                           texts=values[::-1]))  # fmt: skip
    default = parameters.to_unit(parameters.default)[::-1]
    layers.append(dots("default", default, rows, DEFAULT))
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


FIGURES: dict[str, Callable[[Result], Chart]] = {
    "convergence": convergence, "periods": all_periods, "bodies": bodies,
}  # fmt: skip
