# SPDX-License-Identifier: Apache-2.0
"""`loco compare`: runs of one robot on the same axes, and which of their metrics differ."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup
from scipy.stats import ttest_ind

from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_learning.drawing.chart import PALETTE
from loco_learning.metrics import quantities
from loco_learning.metrics import registry as metrics
from loco_learning.runs.log import Log

from ..bag.reader import Bag
from ..logs.bag_log import read_log
from ..page import html
from ..page.plot import Line, Panel, Plot
from ..page.style import spans
from ..terminal import console
from .figures import close_look
from .joint_figures import short
from .parts import label, unit

PIECES = 6  # of a phase, whose metrics tell the noise of a run
CHANCE = 0.01  # that a difference which is called one is none


def show_comparison(a: argparse.Namespace) -> int:
    """Write the page of some bags and print its path."""
    logs = read_runs(a.bag)
    console.print(str(write_whole(a.out, page(logs))))
    return 0


def read_runs(bags: list[Path]) -> dict[str, Log]:
    """Runs by the name of their bag.

    Raises:
        ParameterError: There are fewer than two, more than there are colours, two of one name, or
            runs of different robots or control periods.
        BagError: One is no run of a robot.
    """
    names = [bag.resolve().name for bag in bags]
    if not 2 <= len(bags) <= len(PALETTE):
        raise ParameterError(f"name 2 to {len(PALETTE)} bags to compare, got {len(bags)}")
    if len(set(names)) < len(names):
        raise ParameterError(f"bags of one name cannot be told apart: {', '.join(names)}")
    logs = {name: read_log(Bag(bag)) for name, bag in zip(names, bags, strict=True)}
    first, *others = logs
    for name in others:
        for what, value in (("robot", _robot), ("control period", lambda log: f"{log.dt:g} s")):
            one, other = value(logs[first]), value(logs[name])
            if one != other:
                raise ParameterError(
                    f"{first} has the {what} {one} and {name} {other}; compare runs of one {what}"
                )
    return logs


def page(logs: Mapping[str, Log]) -> str:
    """HTML text of the page; all runs are compared with the first."""
    first = next(iter(logs.values()))
    phase = [name for name in first.phases() if all(name in log.phases() for log in logs.values())]
    if not phase:
        raise ParameterError("the runs have no phase in common; compare runs of like experiments")
    rows = differences(logs, phase[-1])
    beyond = [row for row in rows if row[-1]]
    judged = [row for row in rows if _known(row[2])]
    said = f"{len(beyond)} of {len(judged)} metrics differ from {next(iter(logs))} beyond noise"
    few = f" Of {len(rows) - len(judged)} of {len(rows)} metrics no noise is known: {_SHORT}."
    header = html.join(
        [
            html.verdict(said if judged else f"not judged: {_SHORT}", bool(judged) and not beyond),
            html.paragraph(
                f"{_robot(first)}, phase “{phase[-1]}”. {repeated(logs)}"
                f"{few if 0 < len(judged) < len(rows) else ''}"
            ),
            html.cards(
                [
                    (
                        label(name),
                        " / ".join(map(html.number, values)),
                        unit(metrics.METRICS[name].unit),
                    )
                    for name, values, *_ in beyond[:6]
                ]
            ),
        ]
    )
    parts = [
        html.part("Metrics", lambda: _table(logs, rows)),
        html.part("Joints", lambda: html.figure(joints(logs), "Joints", _JOINTS)),
        html.part("Base", lambda: html.figure(base(logs), "Base", _BASE)),
    ]
    return html.document(f"Comparison of {' and '.join(logs)}", header, parts)


def differences(
    logs: Mapping[str, Log], phase: str
) -> list[tuple[str, list[float], list[float], bool]]:
    """Metrics of a phase: name, value and spread of each run, and whether one run differs.

    The spread is the standard deviation between `PIECES` equal pieces of the phase. A run differs
    where Welch's test of the pieces says so, with a chance of `CHANCE` over all metrics and runs.

    Args:
        logs: Runs by name.
        phase: Name of the phase.
    """
    length = min(x.phases()[phase].stop - x.phases()[phase].start for x in logs.values())
    chosen = [m for name, m in metrics.METRICS.items() if all(m.suits(x) for x in logs.values())]
    rows = []
    for metric in chosen:
        values, pieces = [], []
        for log in logs.values():
            start = log.phases()[phase].start
            ticks = slice(start, start + length)
            edges = np.linspace(ticks.start, ticks.stop, PIECES + 1).astype(int)
            values.append(metric(log, ticks))
            found = [metric(log, slice(a, b)) for a, b in zip(edges, edges[1:], strict=False)]
            pieces.append(np.array(found)[np.isfinite(found)])
        if all(map(math.isfinite, values)):
            rows.append((metric.name, values, pieces))
    bound = CHANCE / max(1, len(rows) * (len(logs) - 1))
    return [
        (
            name,
            values,
            [_spread(p) for p in pieces],
            any(_differ(pieces[0], p, bound) for p in pieces[1:]),
        )
        for name, values, pieces in rows
    ]


def _spread(pieces: np.ndarray) -> float:
    return float(np.std(pieces, ddof=1)) if len(pieces) > 1 else math.nan


def _known(spreads: list[float]) -> bool:
    """Whether the noise of all runs is known."""
    return all(map(math.isfinite, spreads))


def _differ(one: np.ndarray, other: np.ndarray, bound: float) -> bool:
    if min(len(one), len(other)) < 2:
        return False
    if np.ptp(one) == np.ptp(other) == 0.0:
        return bool(one[0] != other[0])
    return bool(ttest_ind(one, other, equal_var=False).pvalue < bound)


def repeated(logs: Mapping[str, Log]) -> str:
    """Sentence that says how far the joints of the runs are from those of the first."""
    first, *others = logs.values()
    apart = []
    for log in others:
        count = min(len(first), len(log))
        apart.append(float(np.nanmax(np.abs(first.q[:count] - log.q[:count]), initial=0.0)))
    if max(apart) == 0.0:
        return "The joints move alike to the last bit, as long as the shortest run lasts."
    return f"The joints are up to {html.number(max(apart))} rad (or m) from those of the first run."


def joints(logs: Mapping[str, Log]) -> Plot:
    """Angles of the joints of all runs."""
    names = next(iter(logs.values())).experiment.plant.joints[:12]
    return _overlay(
        logs, {f"{short(n)} [rad]": (lambda log, i=i: log.q[:, i]) for i, n in enumerate(names)}
    )


def base(logs: Mapping[str, Log]) -> Plot:
    """Height and forward speed of the base of all runs."""
    return _overlay(
        logs,
        {
            "height [m]": lambda log: log.position[:, 2],
            "forward speed [m/s]": quantities.heading_speed,
        },
    )


def _overlay(logs: Mapping[str, Log], signals: Mapping[str, object]) -> Plot:
    longest = max(logs.values(), key=len)
    panels = []
    for name, signal in signals.items():
        lines = []
        for (run, log), color in zip(logs.items(), PALETTE, strict=False):
            values = np.full(len(longest), np.nan)
            values[: len(log)] = signal(log)
            lines.append(Line(run, values, color))
        panels.append(Panel(name, lines))
    return Plot(longest.t, panels, spans(longest), view=close_look(min(logs.values(), key=len)))


def _table(logs: Mapping[str, Log], rows: list) -> Markup:
    head = ["Metric", *(f"{name} ± spread" for name in logs), "Unit", "Beyond noise"]
    cells = [
        [
            label(name),
            *(
                html.number(v) + (f" ± {html.number(s, 2)}" if math.isfinite(s) else "")
                for v, s in zip(values, spreads, strict=True)
            ),
            unit(metrics.METRICS[name].unit),
            "yes" if beyond else "" if _known(spreads) else "not judged",
        ]
        for name, values, spreads, beyond in rows
    ]
    marks = ["so" if row[-1] else "" for row in rows]
    return html.paragraph(_METRICS, soft=True) + html.table(
        head, cells, range(1, 1 + len(logs)), marks
    )


def _robot(log: Log) -> str:
    return log.experiment.plant.name


_SHORT = f"the phase is too short to be cut into {PIECES} pieces"
_METRICS = (
    "Over the length of the shortest run. Spread: standard deviation between "
    f"{PIECES} equal pieces of the phase. Beyond noise: a run differs from the first by Welch's "
    "test of the pieces, with a chance of 1 % over the whole table that this is luck."
)
_JOINTS = "Measured angles of all runs, tick by tick from their beginning."
_BASE = "Ground truth of all runs."
