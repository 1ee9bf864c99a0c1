# SPDX-License-Identifier: Apache-2.0
"""Tables of a report as HTML: facts about the run, metrics, effects, messages."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Sequence
from html import escape

from loco_control.exceptions import BagError, LocoError
from loco_learning import metrics
from loco_learning.joint_log import JointLog
from loco_learning.log import Log
from loco_learning.params import CriterionParams
from loco_learning.trial import Verdict, judge
from loco_sim import effects as sim_effects

from .bag import Bag
from .readout_check import ReadoutCheck
from .report_style import phase_name, phases

HEADLINES = (  # metric and digits of the cards on top
    "speed", "nrmse", "stride_frequency", "cost_of_transport", "positive_power", "grf_max",
)  # fmt: skip


def number(value: float) -> str:
    """A value with four digits, a dash where there is none."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞"
    return f"{value:.4g}".replace("e-0", "e-").replace("-", "−")


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numeric: Sequence[int] = ()) -> str:
    """HTML table. Cells are HTML already.

    Args:
        head: Names of the columns.
        rows: Cells of each row.
        numeric: Columns to align as numbers.
    """
    kind = [' class="n"' if i in numeric else "" for i in range(len(head))]
    top = "".join(f"<th{k}>{h}</th>" for k, h in zip(kind, head, strict=True))
    body = (
        "<tr>" + "".join(f"<td{k}>{c}</td>" for k, c in zip(kind, row, strict=True)) + "</tr>"
        for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{top}</tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def ending(log: Log | JointLog) -> tuple[bool, str]:
    """Whether the robot kept going to the end, and how the run ended."""
    end = f"{len(log) * log.dt:.1f}"
    if log.fall:
        return False, f"fell at {end} s: {log.fall}"
    if not log.complete:
        return False, f"the recording ends at {end} of {log.experiment.ticks * log.dt:.1f} s"
    return True, f"{end} s without a fall"


def cards(log: Log, values: dict[str, dict[str, float]]) -> str:
    """The main numbers of the last phase that was long enough."""
    rows = {name: v for name, v in values.items() if math.isfinite(v["speed"])}
    if not rows:
        return ""
    phase, row = list(rows.items())[-1]
    shown = [(metrics.METRICS[n], row[n]) for n in HEADLINES if math.isfinite(row[n])]
    boxes = "".join(
        f"<div><dt>{escape(label(metric.name))}</dt>"
        f"<dd>{number(value)} <small>{unit(metric.unit)}</small></dd></div>"
        for metric, value in shown
    )
    note = f'<p class="soft">These numbers are of the phase “{phase_name(log, phase)}”.</p>'
    return f'<dl class="cards">{boxes}</dl>{note}'


def label(name: str) -> str:
    """A metric's name for people."""
    words = name.replace("_", " ")
    for short in ("nrmse", "grf", "mse", "mae", "fmse", "mawe", "snr"):
        words = " ".join(w.upper() if w == short else w for w in words.split())
    return words[0].upper() + words[1:]


def unit(name: str) -> str:
    """A unit as HTML; nothing where there is none."""
    return "" if name == "-" else escape(name)


def facts(bag: Bag, log: Log, check: ReadoutCheck | LocoError) -> str:
    """What the run was: phases, seed, clock, versions, drops, verdict."""
    spans = (f"{phase_name(log, n)} {a:g}–{round(b, 3):g} s" for n, a, b in phases(log))
    versions = run_facts(bag, log.seed, log.experiment.robot)
    last = versions.pop("Versions")
    rows = {
        "Phases": " · ".join(spans),
        **versions,
        "Failure criterion": verdict_text(judge(log), log.experiment.criterion),
        "Readout check": str(check) if isinstance(check, LocoError) else check.summary(),
        "Versions": last,
    }
    return fact_table(rows)


def run_facts(bag: Bag, seed: int, robot: str) -> dict[str, str]:
    """What any bag of a run says of it: seed, robot, clock, drops, versions."""
    meta = bag.metadata
    versions = json.loads(meta.get("versions", "{}"))
    dropped = "not counted: no recorder"
    if "received" in meta:
        dropped = f"{meta['dropped']} of {meta['received']}"
    return {
        "Seed": str(seed),
        "Robot": robot,
        "Ran as": f"{meta.get('layout', 'unknown')}, clock {meta.get('clock', 'unknown')}",
        "Recorded": meta.get("recorded_at", "unknown"),
        "Messages dropped": dropped,
        "Versions": " · ".join(f"{k} {v}" for k, v in versions.items()) or "unknown",
    }


def fact_table(rows: dict[str, str]) -> str:
    """Table of texts by name."""
    body = "".join(f"<tr><th>{k}</th><td>{escape(v)}</td></tr>" for k, v in rows.items())
    return f'<table class="facts">{body}</table>'


def verdict_text(found: Verdict, bounds: CriterionParams) -> str:
    """Which parts of a failure criterion were met."""
    text = f"failed: {', '.join(found.failed)}" if found.failed else "no failure"
    if math.isnan(found.nrmse):
        return f"{text} (the prediction never drove for two strides)"
    return (
        f"{text} (NRMSE {number(found.nrmse)} at most, bound {bounds.nrmse:g}; slip "
        f"{number(found.slip)} of {bounds.phase_slip:g} stride; amplitude "
        f"{number(found.amplitude)} at least, bound {bounds.freeze:g})"
    )


def metric_table(log: Log, values: dict[str, dict[str, float]]) -> str:
    """Every metric of each phase, with unit, equation and meaning."""
    names = [name for name in values if name != "stand"] or list(values)
    return metric_rows(metrics.METRICS, values, {name: phase_name(log, name) for name in names})


def metric_rows(
    registry: dict[str, metrics.Metric],
    values: dict[str, dict[str, float]],
    names: dict[str, str],
) -> str:
    """Table of metrics.

    Args:
        registry: Which.
        values: By phase and metric.
        names: What the phases are called, those to show.
    """
    head = ["Metric", *names.values(), "Unit", "Equation"]
    rows = [
        [
            f"{escape(label(m.name))}<small>{escape(' '.join(m.doc.split()))}</small>",
            *(number(values[name][m.name]) for name in names),
            escape(m.unit),
            escape(m.equation),
        ]
        for m in registry.values()
    ]
    return table(head, rows, numeric=range(1, 1 + len(names)))


def effect_table(log: Log | JointLog) -> str:
    """Effects of the plant with the parameters that differ from their defaults.

    Raises:
        BagError: The experiment has no effects.
    """
    found = sim_effects.from_list(log.experiment.effects)
    if not found:
        raise BagError("the experiment has no effects: the plant is the bare robot")
    rows = []
    for effect in found:
        fields = {f.name: f for f in dataclasses.fields(effect)}
        given = [name for name in fields if getattr(effect, name) != fields[name].default]
        texts = [
            f"{name} = {getattr(effect, name)} {unit(fields[name].metadata.get('unit', '-'))}"
            for name in given
            if name not in ("start", "stop")
        ]
        window = f"{effect.start:g} s to " + (
            "the end" if math.isinf(effect.stop) else f"{effect.stop:g} s"
        )
        rows.append([f"<code>{escape(effect.name)}</code>", escape("; ".join(texts)), window])
    return table(["Effect", "Parameters", "When"], rows)


def message_table(bag: Bag) -> str:
    """Topics of a bag with type, count and rate in simulated time."""
    length = bag.end - bag.start
    rows = [
        [
            f"<code>{escape(t.name)}</code>",
            f"<code>{escape(t.type)}</code>",
            str(t.count),
            number((t.count - 1) / length) if t.count > 1 and length > 0.0 else "–",
        ]
        for t in sorted(bag.topics.values(), key=lambda t: t.name)
    ]
    return table(["Topic", "Type", "Messages", "Rate [Hz]"], rows, numeric=(2, 3))
