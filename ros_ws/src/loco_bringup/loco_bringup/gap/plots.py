# SPDX-License-Identifier: Apache-2.0
"""Plots of a gap: measurement and both models on the same axes, residuals, and spectra."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from loco_learning.drawing import png
from loco_learning.drawing.chart import DASHED, GREY, PALETTE, Axis, Chart, Frame, dots, line
from loco_learning.gap.localisation import figures
from loco_learning.gap.localisation.curves import FIT, Curve, Curves, load
from loco_learning.gap.preview.visible import LARGE, NO, YES

from ..page.plot import BUDGET, Line, Panel, Plot
from ..page.style import TINTS
from . import text

MEASURED, BEFORE, AFTER, NOISE = "#9aa3ad", "#d55e00", "#0072b2", "#222222"
BOTH = "before", "after"
COLORS = BEFORE, AFTER
PAUSE = 1.0  # gap between two records on the time axis [s]
RUNAWAY = 4.0  # axis limit for a diverged model, in half ranges of the measurement


def signals(curves: Curves, models: Sequence[str] = BOTH) -> Plot:
    """Plot of the channels with the largest gap, and of the models' residuals there.

    Args:
        curves: Curves of the evaluated models.
        models: ``before`` and ``after``, or only ``before`` if nothing is added to the model.
    """
    columns = curves.worst(figures.MOST_SIGNALS)
    curve = figures.worst_record(curves, columns)
    panels = [panel for c in columns for panel in _panels(curves, curve, c, models)]
    return Plot(curve.t, panels, axis=_axis(curve), view=_view(curve, columns))


def worst(curves: Curves, models: Sequence[str] = BOTH) -> Plot:
    """Plot of the channel with the largest gap; arguments as for `signals`."""
    columns = curves.worst(1)
    curve = figures.worst_record(curves, columns)
    panels = _panels(curves, curve, columns[0], models)
    return Plot(curve.t, panels, axis=_axis(curve), view=_view(curve, columns))


def notebook(arrays: Path, result: Mapping[str, Any]) -> str:
    """HTML text of a result in a notebook: its summary, and a PNG of the plot `worst`.

    Args:
        arrays: File of the curves; without it, as after a wrong set-up, there is no picture.
        result: Contents of ``gap.json``.
    """
    summary = f"<pre>{escape(text.summary(result))}</pre>"
    if not arrays.is_file():
        return summary
    plot, frames = worst(load(arrays), text.told(result)), []
    for panel in plot.panels:
        layers = []
        for one in panel.lines:
            finite, style = np.isfinite(one.values), {"shape": DASHED} if one.dashed else {}
            x, y = plot.x[finite], one.values[finite]
            layers.append(line(one.name, x, y, one.color, size=one.width, **style))
        across = Axis(plot.axis, limits=plot.view)
        frames.append(Frame(across, Axis(panel.label, limits=panel.limits), layers))
    with tempfile.TemporaryDirectory() as place:
        drawn = png.write(Chart(frames), Path(place, "gap.png")).read_bytes()
    source = f"data:image/png;base64,{base64.b64encode(drawn).decode()}"
    return f'{summary}<img alt="The largest gap, before and after" src="{source}">'


def _panels(curves: Curves, curve: Curve, c: int, models: Sequence[str]) -> list[Panel]:
    """Panel with measurement and models in one channel, and panel with the residuals."""
    values = [curve.measured[:, c], *(getattr(curve, which)[:, c] for which in models)]
    lines = [Line("measured", values[0], MEASURED, 3.0)]
    lines += [Line(_name(models, i), y, COLORS[i]) for i, y in enumerate(values[1:])]
    label, floor = f"{curves.label(c)} [{curves.unit(c)}]", curve.floor[:, c]
    missed = [curve.residual(which)[:, c] for which in models]
    below = [Line("noise floor", sign * floor, NOISE, 0.8, dashed=True) for sign in (1.0, -1.0)]
    below += [Line(_name(models, i), y, COLORS[i]) for i, y in enumerate(missed)]
    limits = _limits(np.concatenate([floor, -floor, missed[0]]), missed[-1])
    return [
        Panel(label, lines, limits=_limits(*values)),
        Panel(f"missed of {label}", below, limits=limits),
    ]


def _name(models: Sequence[str], i: int) -> str:
    """Name of a model in a legend."""
    return f"model {models[i]}" if len(models) > 1 else "model"


def _view(curve: Curve, columns: list[int]) -> tuple[float, float]:
    """Interval of time in which the gap is largest [s]."""
    visible = curve.t[figures.window(curve, columns, figures.span(curve))]
    return float(visible[0]), float(visible[-1])


def spectra(curves: Curves) -> Plot:
    """Amplitudes of the measured signal and of both models' residuals, by frequency band."""
    columns = curves.worst(figures.MOST_SIGNALS)
    curve = figures.worst_record(curves, columns)
    bands = figures.spectrum(curve.t, np.zeros(len(curve.t)))[0]
    panels = []
    for c in columns:
        floor = float(np.sqrt(np.mean(curve.floor[:, c] ** 2)))
        noise = np.full(len(bands), floor * np.sqrt(2.0 / len(curve.t)))
        rows = (
            ("measured", curve.measured, MEASURED, 2.0),
            ("missed before", curve.residual("before"), BEFORE, 1.2),
            ("missed after", curve.residual("after"), AFTER, 1.2),
        )
        lines = [Line("noise floor", noise, NOISE, 0.8, dashed=True)]
        for name, values, color, width in rows:
            density = figures.spectrum(curve.t, values[:, c])[1]
            levels = density if len(density) else np.full(len(bands), np.nan)
            lines.append(Line(name, levels, color, width))
        panels.append(Panel(f"{curves.label(c)} [{curves.unit(c)}]", lines, logarithmic=True))
    return Plot(bands, panels, axis="frequency [Hz]")


def missed(curves: Curves) -> Plot:
    """Plot of the error of both models at every held-out value, in noise floors, by channel.

    Records follow one another. In long records each point is the rms of several rows, so that
    the mean square of a line is the mean square of all its values.
    """
    records, count, tints = curves.judging, len(curves.channels), list(TINTS.values())
    rows = sum(int(r.judged.sum()) for r in records)
    every = max(1, -(-2 * count * rows // BUDGET))
    times, both, spans, end = [], {which: [] for which in BOTH}, [], 0.0
    for number, r in enumerate(records):
        t = r.t[r.judged]
        first = np.arange(0, len(t), every)
        times.append(t[first] - t[0] + end)
        spans.append((tints[number % len(tints)], r.name, float(times[-1][0]), float(t[-1] - t[0] + end)))
        end = spans[-1][3] + PAUSE
        for which, parts in both.items():
            parts.append(_summed(np.square(r.whitened(which)[r.judged]), first))
    panels = []
    for c, n_values in enumerate(_counts(records)):
        lines = []
        for which, color in zip(BOTH, (BEFORE, AFTER), strict=True):
            energy = np.concatenate([part[:, c] for part in both[which]])
            mean = n_values / max(1, int(np.isfinite(energy).sum()))
            lines.append(Line(f"model {which}", np.maximum(np.sqrt(energy / mean), figures.FAINT), color))
        panels.append(Panel(f"{curves.label(c)}, {n_values} values", lines, logarithmic=True))
    return Plot(np.concatenate(times), panels, spans, axis="time in all that judges [s]")


def _summed(energy: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Sums of the finite values of each block of rows, (B, C); NaN if a block has none."""
    finite = np.isfinite(energy)
    sums = np.add.reduceat(np.where(finite, energy, 0.0), first, axis=0)
    return np.where(np.add.reduceat(finite, first, axis=0) > 0, sums, np.nan)


def _counts(records: Sequence[Curve]) -> list[int]:
    """Number of held-out values of each channel."""
    counts = [np.isfinite(r.whitened("before")).sum(axis=0) for r in records]
    return np.sum(counts, axis=0).tolist()


def _axis(curve: Curve) -> str:
    held = curve.t[curve.judged]
    role = f"held-out from {held[0]:.3g} s" if curve.role == FIT and held.size else curve.role
    return f"time [s] in {curve.name} ({role})"


def _limits(*lines: np.ndarray) -> tuple[float, float] | None:
    """Axis limits that include all lines, but cut off diverged models; None without values."""
    first = lines[0][np.isfinite(lines[0])]
    if not len(first):
        return None
    middle, margin = 0.5 * (first.max() + first.min()), RUNAWAY * max(0.5 * np.ptp(first), 1e-9)
    finite = np.concatenate([x[np.isfinite(x)] for x in lines])
    low, high = max(finite.min(), middle - margin), min(finite.max(), middle + margin)
    pad = 0.06 * (high - low) + 1e-12
    return float(low - pad), float(high + pad)


def sizes(check: Mapping[str, Any]) -> Chart:
    """Chart of smallest detectable over usual size, one dot per effect and place.

    Args:
        check: Contents of ``check.json``.
    """
    effects = [row for row in check["effects"] if row["smallest"] and row["typical"]]
    names = list(dict.fromkeys(named(row) for row in reversed(effects)))
    colors = {YES: PALETTE[2], LARGE: PALETTE[4], NO: PALETTE[1]}
    legend = {YES: "shows at its usual size", LARGE: "shows if it is large", NO: "does not show"}
    layers = [line("usual size", [1.0, 1.0], [-0.5, len(names) - 0.5], GREY, shape=DASHED)]
    for grade, color in colors.items():
        matching = [row for row in effects if row["seen"] == grade]
        labels = [f"{named(row)} at {text.place_of(row['place'])}: from "
                  f"{text.number(row['smallest'])} {row['unit']}" for row in matching]  # fmt: skip
        share = [row["smallest"] / row["typical"] for row in matching]
        at = [names.index(named(row)) for row in matching]
        layers.append(dots(legend[grade], share, at, color, texts=labels))
    x = Axis("smallest size that shows [times the usual size]", logarithmic=True)
    return Chart([Frame(x, Axis("effect", names=names), layers, height=70 + 18 * len(names))])


def named(row: Mapping[str, Any]) -> str:
    """Effect, variant and parameter of a row as text."""
    return " ".join(filter(None, (text.words(row["effect"]), row["variant"], row["parameter"])))
