# SPDX-License-Identifier: Apache-2.0
"""Plots of a gap: measurement and both models on the same axes, what they miss, and spectra."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from loco_learning.drawing.chart import DASHED, GREY, PALETTE, Axis, Chart, Frame, dots, line
from loco_learning.gap.localisation import figures
from loco_learning.gap.localisation.curves import Curve, Curves
from loco_learning.gap.preview.visible import LARGE, NO, YES

from ..page.plot import Line, Panel, Plot
from . import text

MEASURED, BEFORE, AFTER, NOISE = "#9aa3ad", "#d55e00", "#0072b2", "#222222"
RUNAWAY = 4.0  # half ranges of the measurement that are shown of a model that runs away


def signals(curves: Curves) -> Plot:
    """Channels with the largest gap, and what both models miss there."""
    columns = curves.worst(figures.MOST_SIGNALS)
    curve = figures.worst_record(curves, columns)
    panels = []
    for c in columns:
        unit, floor = curves.unit(c), np.full(len(curve.t), curves.floor[c])
        said = (curve.measured[:, c], curve.before[:, c], curve.after[:, c])
        missed = (curve.residual("before")[:, c], curve.residual("after")[:, c])
        lines = [
            Line("measured", said[0], MEASURED, 3.0),
            Line("model before", said[1], BEFORE),
            Line("model after", said[2], AFTER),
        ]
        panels.append(Panel(f"{curves.label(c)} [{unit}]", lines, limits=_limits(*said)))
        lines = [
            Line("noise", floor, NOISE, 0.8, dashed=True),
            Line("noise", -floor, NOISE, 0.8, dashed=True),
            Line("model before", missed[0], BEFORE),
            Line("model after", missed[1], AFTER),
        ]
        limits = _limits(np.concatenate([floor, -floor, missed[0]]), missed[1])
        panels.append(Panel(f"missed of {curves.label(c)} [{unit}]", lines, limits=limits))
    shown = curve.t[figures.window(curve, columns, figures.span(curve))]
    return Plot(curve.t, panels, axis=_axis(curve), view=(shown[0], shown[-1]))


def spectra(curves: Curves) -> Plot:
    """Amplitudes of the measured signal and of what both models miss, in bands of frequency."""
    columns = curves.worst(figures.MOST_SIGNALS)
    curve = figures.worst_record(curves, columns)
    bands = figures.spectrum(curve.t, np.zeros(len(curve.t)))[0]
    panels = []
    for c in columns:
        noise = np.full(len(bands), curves.floor[c] * np.sqrt(2.0 / len(curve.t)))
        rows = (
            ("measured", curve.measured, MEASURED, 2.0),
            ("missed before", curve.residual("before"), BEFORE, 1.2),
            ("missed after", curve.residual("after"), AFTER, 1.2),
        )
        lines = [Line("noise", noise, NOISE, 0.8, dashed=True)]
        for name, values, color, width in rows:
            found = figures.spectrum(curve.t, values[:, c])[1]
            shown = found if len(found) else np.full(len(bands), np.nan)
            lines.append(Line(name, shown, color, width))
        panels.append(Panel(f"{curves.label(c)} [{curves.unit(c)}]", lines, logarithmic=True))
    return Plot(bands, panels, axis="frequency [Hz]")


def _axis(curve: Curve) -> str:
    return f"time [s] in {curve.name} ({curve.role})"


def _limits(*lines: np.ndarray) -> tuple[float, float] | None:
    """Range that holds the first line and the others, but no model that runs away."""
    first = lines[0][np.isfinite(lines[0])]
    if not len(first):
        return None
    middle, most = 0.5 * (first.max() + first.min()), RUNAWAY * max(0.5 * np.ptp(first), 1e-9)
    known = np.concatenate([x[np.isfinite(x)] for x in lines])
    low, high = max(known.min(), middle - most), min(known.max(), middle + most)
    pad = 0.06 * (high - low) + 1e-12
    return float(low - pad), float(high + pad)


def sizes(found: Mapping[str, Any]) -> Chart:
    """Smallest size that shows over the usual size, a dot for each effect at a place.

    Args:
        found: Contents of ``check.json``.
    """
    told = [row for row in found["effects"] if row["smallest"] and row["typical"]]
    names = list(dict.fromkeys(named(row) for row in reversed(told)))
    colors = {YES: PALETTE[2], LARGE: PALETTE[4], NO: PALETTE[1]}
    words = {YES: "shows at its usual size", LARGE: "shows if it is large", NO: "does not show"}
    layers = [line("usual size", [1.0, 1.0], [-0.5, len(names) - 0.5], GREY, shape=DASHED)]
    for seen, color in colors.items():
        own = [row for row in told if row["seen"] == seen]
        texts = [f"{named(row)} at {text.place_of(row['place'])}: from "
                 f"{text.number(row['smallest'])} {row['unit']}" for row in own]  # fmt: skip
        share = [row["smallest"] / row["typical"] for row in own]
        at = [names.index(named(row)) for row in own]
        layers.append(dots(words[seen], share, at, color, texts=texts))
    x = Axis("smallest size that shows [times the usual size]", logarithmic=True)
    return Chart([Frame(x, Axis("effect", names=names), layers, height=70 + 18 * len(names))])


def named(row: Mapping[str, Any]) -> str:
    """Effect, variant and parameter of a row in words."""
    return " ".join(filter(None, (text.words(row["effect"]), row["variant"], row["parameter"])))
