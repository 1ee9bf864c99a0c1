# SPDX-License-Identifier: Apache-2.0
"""`loco compare`: plot runs of one robot on the same axes, and find metrics that differ."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup

from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_learning.drawing.chart import PALETTE
from loco_learning.metrics import differences as blocks
from loco_learning.metrics import quantities
from loco_learning.metrics import registry as metrics
from loco_learning.metrics.quantities import moves
from loco_learning.runs.log import Log

from ..bag.foreign.opening import open_bag
from ..logs.bag_log import read_log
from ..logs.recording import is_foreign
from ..outcome import file_at
from ..page import html
from ..page.plot import Line, Panel, Plot
from ..page.style import spans
from ..terminal import console
from . import recorded
from .figures import close_look
from .joint_figures import short
from .parts import label, unit

PAGE = Path("results/compare.html")
LIMIT = 2 * len(PALETTE)  # largest number of runs; those after the first colours are dashed


def show_comparison(a: argparse.Namespace) -> int:
    """Write the page about some bags; print the verdict, the differing metrics and the path."""
    if any(map(is_foreign, a.bag)):
        text, sentences = recorded.comparison(a.bag, a.mapping)
        written = write_whole(file_at(a.out, PAGE), text)
        for line in sentences:
            console.print(line)
        console.print(str(written))
        return 0
    logs = read_runs(a.bag)
    written, comparisons = write_whole(file_at(a.out, PAGE), page(logs)), compared(logs)
    for line in (verdict(logs, comparisons)[0], *falls(logs), *map(sentence, comparisons)):
        console.print(line)
    console.print(str(written))
    return 0


def read_runs(bags: list[Path]) -> dict[str, Log]:
    """Logs of runs, by the name of their bag.

    Raises:
        ParameterError: There are fewer than two runs or more than `LIMIT`, two with the same name,
            or runs of different robots or control periods.
        BagError: A bag is no run of a robot.
    """
    names = [bag.resolve().name for bag in bags]
    if not 2 <= len(bags) <= LIMIT:
        raise ParameterError(f"name 2 to {LIMIT} bags to compare, got {len(bags)}")
    if len(set(names)) < len(names):
        raise ParameterError(f"bags of one name cannot be told apart: {', '.join(names)}")
    logs = {name: read_log(open_bag(bag)) for name, bag in zip(names, bags, strict=True)}
    first, *candidates = logs
    for name in candidates:
        for what, value in (("robot", _robot), ("control period", lambda log: f"{log.dt:g} s")):
            one, other = value(logs[first]), value(logs[name])
            if one != other:
                raise ParameterError(
                    f"{first} has the {what} {one} and {name} {other}; compare runs of one {what}"
                )
    return logs


@dataclass(frozen=True)
class Compared:
    """Comparison of a run with the first one, in one phase.

    Attributes:
        run: Name of the run.
        window: Compared blocks.
        rows: Metrics; differing ones first.
    """

    run: str
    window: blocks.Window
    rows: list[blocks.Difference]

    @property
    def differing(self) -> list[blocks.Difference]:
        """Metrics whose difference exceeds the noise and the threshold of relevance."""
        return [row for row in self.rows if row.kind]


def compared(logs: Mapping[str, Log]) -> list[Compared]:
    """Differences of all runs from the first, by phase.

    Raises:
        ParameterError: The runs have no phase in common.
    """
    name, *candidates = logs
    phases = blocks.shared(logs)
    if not phases:
        raise ParameterError("the runs have no phase in common; compare runs of like experiments")
    first, comparisons = logs[name], []
    for other in candidates:
        for phase in phases:
            rows = blocks.differences(first, logs[other], phase, len(phases) * len(candidates))
            rows.sort(key=lambda row: (not row.kind, not row.judged))
            comparisons.append(Compared(other, blocks.window(first, logs[other], phase), rows))
    return comparisons


def page(logs: Mapping[str, Log]) -> str:
    """HTML text of the page; all runs are compared with the first."""
    comparisons, first = compared(logs), next(iter(logs.values()))
    headline, well = verdict(logs, comparisons)
    header = html.join(
        [
            html.verdict(headline, well),
            html.paragraph(f"{_robot(first)}. {repeated(logs)}"),
            html.bullets([*falls(logs), *map(sentence, comparisons)]),
            html.cards([_card(row, one) for one in comparisons for row in one.differing][:6]),
        ]
    )
    parts = [
        html.part("Metrics", lambda: _table(logs, comparisons)),
        html.part("Joints", lambda: html.figure(joints(logs), "Joints", _JOINTS)),
    ]
    if moves(first):
        parts.append(html.part("Base", lambda: html.figure(base(logs), "Base", _BASE)))
    return html.document(f"Comparison of {' and '.join(logs)}", header, parts)


def verdict(logs: Mapping[str, Log], found: Sequence[Compared]) -> tuple[str, bool | None]:
    """Verdict as short text, and whether it is positive; None if nothing could be compared."""
    name, *candidates = logs
    falling = [run for run in candidates if logs[run].fall != logs[name].fall]
    runs = [run for run in candidates
            if run in falling or any(one.differing for one in found if one.run == run)]  # fmt: skip
    assessed = [row for one in found for row in one.rows if row.judged]
    if runs:
        return f"{', '.join(runs)} {'differs' if len(runs) == 1 else 'differ'} from {name}", False
    if not assessed:
        longest = max(found, key=lambda one: one.window.count)
        return f"too short to be judged: {_short(longest.window)}", None
    return f"no difference from {name} in {len(assessed)} metrics", True


def falls(logs: Mapping[str, Log]) -> list[str]:
    """Sentences on runs that fell."""
    return [f"{run} fell at {html.number(log.t[-1])} s: {log.fall}."
            for run, log in logs.items() if log.fall]  # fmt: skip


def sentence(one: Compared) -> str:
    """Names of the metrics that differ in a phase of a run, or why none was compared."""
    where = f"{one.run}, phase “{one.window.phase}”"
    n_assessed = sum(row.judged for row in one.rows)
    if not n_assessed:
        return f"{where}: not judged, {_short(one.window)}."
    names = ", ".join(label(row.metric).lower() for row in one.differing)
    return f"{where}: {names or 'nothing'} differs, of {n_assessed} metrics."


def _short(window: blocks.Window) -> str:
    lasts = html.number(window.ticks * window.dt)
    return f"“{window.phase}” lasts {lasts} s, {html.number(window.needed)} s are enough"


def _card(row: blocks.Difference, one: Compared) -> tuple[str, str, str]:
    values = " → ".join(map(html.number, (row.first, row.other)))
    return f"{label(row.metric)}, {one.run}", values, f"{unit_of(row)} {_when(row)}".strip()


def unit_of(row: blocks.Difference) -> str:
    """Unit of a metric; empty if there is none."""
    return unit(metrics.METRICS[row.metric].unit)


def _when(row: blocks.Difference) -> str:
    """Verdict on a metric as text."""
    if row.kind == blocks.PASSING:
        return f"passing, by {html.number(row.largest, 3)} from {html.number(row.at)} s on"
    return row.kind if row.judged else "not judged"


def repeated(logs: Mapping[str, Log]) -> str:
    """Sentence on the differences of the runs' joint angles from those of the first run."""
    first, *repeats = logs.values()
    gaps = []
    for log in repeats:
        count = min(len(first), len(log))
        gaps.append(float(np.nanmax(np.abs(first.q[:count] - log.q[:count]), initial=0.0)))
    if max(gaps) == 0.0:
        return "The joints move alike to the last bit, as long as the shortest run lasts."
    return f"The joints are up to {html.number(max(gaps))} rad (or m) from those of the first run."


def joints(logs: Mapping[str, Log]) -> Plot:
    """Plot of the joint angles of all runs."""
    names = next(iter(logs.values())).experiment.plant.joints[:12]
    return _overlay(
        logs, {f"{short(n)} [rad]": (lambda log, i=i: log.q[:, i]) for i, n in enumerate(names)}
    )


def base(logs: Mapping[str, Log]) -> Plot:
    """Plot of the height and forward speed of the base in all runs."""
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
        for i, (run, log) in enumerate(logs.items()):
            values, color = np.full(len(longest), np.nan), PALETTE[i % len(PALETTE)]
            values[: len(log)] = signal(log)
            lines.append(Line(run, values, color, dashed=i >= len(PALETTE)))
        panels.append(Panel(name, lines))
    return Plot(longest.t, panels, spans(longest), view=close_look(min(logs.values(), key=len)))


def _table(logs: Mapping[str, Log], comparisons: Sequence[Compared]) -> Markup:
    name, *_ = logs
    head = ["Run", "Phase", "Metric", name, "The run", "Difference (interval)", "Matters from",
            "Unit", "Differs"]  # fmt: skip
    rows = [(one, row) for one in comparisons for row in one.rows]
    rows.sort(key=lambda pair: not pair[1].kind)
    cells = [
        [
            one.run, one.window.phase, label(row.metric), html.number(row.first),
            html.number(row.other), _interval(row),
            html.number(row.size, 2) if math.isfinite(row.size) else "–", unit_of(row), _when(row),
        ]
        for one, row in rows
    ]  # fmt: skip
    marks = ["so" if row.kind else "" for _, row in rows]
    return html.paragraph(_METRICS, soft=True) + html.table(head, cells, range(3, 7), marks)


def _interval(row: blocks.Difference) -> str:
    if not row.judged:
        return "–"
    low, high = (html.number(x, 2) for x in (row.low, row.high))
    return f"{html.number(row.other - row.first, 2)} ({low} to {high})"


def _robot(log: Log) -> str:
    return log.experiment.plant.name


_METRICS = (
    "Means over blocks of whole strides, at least a second each, as many as the shorter run has; "
    "blocks of the same tick are paired where both runs have the same target. Lasting: the interval "
    "of the mean difference (block bootstrap) excludes zero, and the difference matters. Passing: "
    "single blocks stand out of the others by more than matters, as after a push. The chance that "
    f"anything in the whole table is called a difference by luck is {blocks.CHANCE:.0%}."
)
_JOINTS = "Measured angles of all runs, tick by tick from their beginning."
_BASE = "Ground truth of all runs."
