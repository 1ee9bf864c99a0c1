# SPDX-License-Identifier: Apache-2.0
"""Sections common to all reports: facts, metrics, effects, messages, configuration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from markupsafe import Markup

from loco_control.exceptions import BagError
from loco_control.params import to_dict
from loco_learning.metrics import registry as metrics
from loco_learning.params import CriterionParams
from loco_learning.runs.log import Log
from loco_learning.study.trial import Verdict
from loco_sim import effects as sim_effects

from ..bag.reader import Bag
from ..page import html
from ..page.html import Part, number, part
from ..page.style import Chapter

FPS = 14.0
SIZE = (400, 268)  # size of animations [pixel]


def drawn(chapters: Iterable[Chapter], log: Any) -> list[Part]:
    """Sections, one per figure of a log."""
    return [
        part(c.title, lambda c=c: html.figure(lambda: c.draw(log), c.title, c.text))
        for c in chapters
    ]


def end_markup(log: Log) -> Markup:
    """Badge for the end of the run: completed, interrupted or fallen."""
    end = f"{len(log) * log.dt:.1f}"
    if log.fall:
        return html.verdict(f"fell at {end} s: {log.fall}", False)
    if not log.complete:
        duration = log.experiment.ticks * log.dt
        return html.verdict(f"the recording ends at {end} of {duration:.1f} s", False)
    fixed = log.experiment.plant.fixed_base
    return html.verdict(f"{end} s, to the end" if fixed else f"{end} s without a fall", True)


def cards(
    values: Mapping[str, Mapping[str, float]],
    metric_names: Iterable[str],
    references: Mapping[str, str] | None = None,
) -> Markup:
    """Main numbers of the last sufficiently long phase.

    Args:
        values: Values by phase and metric; NaN where a metric does not apply.
        metric_names: Names of the metrics to show.
        references: Text with a reference value, by name of the metric.
    """
    long = [(name, row) for name, row in values.items() if math.isfinite(row["torque_max"])]
    if not long:
        return Markup()
    phase, row = long[-1]
    rows = [
        (label(name), number(row[name]), _remark(name, references or {}))
        for name in metric_names
        if math.isfinite(row.get(name, math.nan))
    ]
    return html.cards(rows, f"These numbers are of the phase “{phase}”.")


def _remark(name: str, references: Mapping[str, str]) -> str:
    remarks = (unit(metrics.METRICS[name].unit), references.get(name, ""))
    return "; ".join(text for text in remarks if text)


def label(name: str) -> str:
    """Display name of a metric."""
    phrase = name.replace("_", " ")
    for short in ("nrmse", "grf", "mse", "mae", "fmse", "mawe", "snr"):
        phrase = " ".join(w.upper() if w == short else w for w in phrase.split())
    return phrase[0].upper() + phrase[1:]


def unit(name: str) -> str:
    """Unit of a metric; empty if there is none."""
    return "" if name == "-" else name


def run_facts(bag: Bag, seed: int, robot: str) -> dict[str, str]:
    """Facts that every bag of a run contains: seed, robot, clock, drops, versions."""
    meta = bag.metadata
    dropped = "not counted: no recorder"
    if "received" in meta:
        dropped = f"{meta.get('dropped', '?')} of {meta['received']}"
    return {
        "Seed": str(seed),
        "Robot": robot,
        "Ran as": f"{meta.get('layout', 'unknown')}, clock {meta.get('clock', 'unknown')}",
        "Recorded": meta.get("recorded_at", "unknown"),
        "Messages dropped": dropped,
        "Versions": " · ".join(f"{k} {v}" for k, v in bag.versions.items()) or "unknown",
    }


def verdict_text(verdict: Verdict, bounds: CriterionParams) -> str:
    """Text with the conditions of the failure criterion that were met."""
    text = f"failed: {', '.join(verdict.failed)}" if verdict.failed else "no failure"
    if math.isnan(verdict.nrmse):
        return f"{text} (the prediction never drove for two strides)"
    return (
        f"{text} (NRMSE {number(verdict.nrmse)} at most, bound {bounds.nrmse:g}; slip "
        f"{number(verdict.slip)} of {bounds.phase_slip:g} stride; amplitude "
        f"{number(verdict.amplitude)} at least, bound {bounds.freeze:g})"
    )


def metric_table(values: Mapping[str, Mapping[str, float]]) -> Markup:
    """Table of every metric per phase with unit, equation and meaning; a dash if missing."""
    present = {name for row in values.values() for name in row}
    rows = [
        [
            Markup("{}<small>{}</small>").format(label(m.name), " ".join(m.doc.split())),
            *(number(row.get(m.name, math.nan)) for row in values.values()),
            m.unit,
            m.equation,
        ]
        for m in metrics.METRICS.values()
        if m.name in present
    ]
    head = ["Metric", *values, "Unit", "Equation"]
    numeric = range(1, 1 + len(values))
    return html.paragraph(_METRICS, soft=True) + html.table(head, rows, numeric)


def effect_table(log: Log) -> Markup:
    """Table of the plant's effects with parameters that differ from their defaults.

    Raises:
        BagError: The experiment has no effects.
    """
    effects = sim_effects.from_list(log.experiment.effects)
    if not effects:
        raise BagError("the experiment has no effects: the plant is the bare robot")
    rows = []
    for effect in effects:
        fields = {f.name: f for f in dataclasses.fields(effect)}
        changed = [name for name in fields if getattr(effect, name) != fields[name].default]
        settings = [
            f"{name} = {getattr(effect, name)} {unit(fields[name].metadata.get('unit', '-'))}"
            for name in changed
            if name not in ("start", "stop")
        ]
        window = f"{effect.start:g} s to " + (
            "the end" if math.isinf(effect.stop) else f"{effect.stop:g} s"
        )
        rows.append([html.code(effect.name), "; ".join(settings), window])
    return html.table(["Effect", "Parameters", "When"], rows)


def message_table(bag: Bag) -> Markup:
    """Table of a bag's topics with type, count and rate in simulated time."""
    length = bag.end - bag.start
    rows = [
        [
            html.code(t.name),
            html.code(t.type),
            str(t.count),
            number((t.count - 1) / length) if t.count > 1 and length > 0.0 else "–",
        ]
        for t in sorted(bag.topics.values(), key=lambda t: t.name)
    ]
    return html.table(["Topic", "Type", "Messages", "Rate [Hz]"], rows, numeric=(2, 3))


def configuration(experiment: object) -> Markup:
    """The experiment as YAML in a collapsed block."""
    return html.folded("Experiment, all values", html.yaml_block(to_dict(experiment)))


_METRICS = (
    "Over all ticks of each phase. “Equation” is that of the thesis, section 3.6; “ours” has none. "
    "A dash: does not apply, or the phase is too short."
)
