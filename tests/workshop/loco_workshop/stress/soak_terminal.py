# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco soak`: progress, table, CSV and figure."""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_bringup.terminal import bar, console
from loco_control.files import check_writable
from loco_learning.drawing import png
from loco_learning.drawing.chart import DASHED, GREY, PALETTE, Axis, Chart, Frame, Layer, line
from loco_learning.runs.experiment import load

from ..reliability.figures import keep
from . import soak as soaking


def show_soak(a: argparse.Namespace) -> int:
    """Run `loco soak` and write the results; returns 1 if a resource grows, else 0."""
    folder = a.out or Path("results") / "soak"
    check_writable(folder)
    experiment = load(a.experiment)
    with bar("{task.completed:,.0f}/{task.total:,} ticks", "{task.fields[rtf]:.1f} x") as progress:
        task = progress.add_task(experiment.name, total=a.ticks, rtf=0.0)

        def tell(p: soaking.runner.Progress) -> None:
            progress.update(task, completed=p.sim_time / experiment.dt, rtf=p.real_time_factor)

        outcome = soaking.soak(experiment, a.ticks, folder / "soak.csv", a.layout, tell, a.clock)
    samples = soaking.read(folder / "soak.csv")
    verdicts = soaking.judge(samples)
    png.write(draw(samples), folder / "soak.png")
    text = page(experiment.name, f"{a.layout}, {a.clock}", samples, outcome, verdicts)
    (folder / "soak.md").write_text(text)
    console.print(text, markup=False)
    console.print(f"  {folder}: soak.md, soak.csv, soak.png")
    if outcome.interrupted:
        return 130
    grows = sum(v.says == "grows" for v in verdicts)
    figures = {"ticks": samples[-1].tick if samples else 0, "layout": a.layout, "grow": grows}
    keep(folder, "soak", {experiment.name: (not grows and len(samples) > 0, figures)})
    return int(grows > 0)


def page(
    name: str,
    how: str,
    samples: list[soaking.Sample],
    outcome: soaking.runner.Outcome,
    verdicts: list[soaking.Verdict],
) -> str:
    """Markdown table of the verdicts; `how` is layout and clock."""
    ticks, wall = (samples[-1].tick, samples[-1].wall) if samples else (0, 0.0)
    memory = [v for v in verdicts if v.what == "memory"]
    lines = [
        f"`{name}`, {how}: {ticks:,} ticks in {wall / 60:.0f} min, "
        f"{len(samples):,} samples; {outcome.text}; {outcome.dropped} messages dropped",
        "",
        "| process | memory [MB] | growth [MB in 10⁶ ticks] | memory is "
        "| descriptors | threads | files of /dev/shm |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for v in memory:
        counts = [c for c in verdicts if c.process == v.process and c.what != "memory"]
        cells = (f"{c.start:.0f} → {c.end:.0f}, {c.says}" for c in counts)
        growth = f"{v.slope:+.2f} ± {v.error:.2f}"
        lines.append(
            f"| {v.process} | {v.start:.1f} → {v.end:.1f} | {growth} | {v.says} | "
            + " | ".join(cells) + " |"
        )  # fmt: skip
    lines += ["", f"Flat is: below {soaking.LIMIT:g} MB in 10⁶ ticks at the upper end of the 95 % "
              f"interval; the first {soaking.WARM_UP:.0%} are not judged."]  # fmt: skip
    return "\n".join(lines) + "\n"


def draw(samples: list[soaking.Sample]) -> Chart:
    """Chart of memory and counts of each process over the ticks.

    Args:
        samples: Samples of all processes.
    """
    names = list(dict.fromkeys(s.process for s in samples))
    whats = (
        ("memory", "memory, change [MB]"), ("descriptors", "descriptors [-]"),
        ("threads", "threads [-]"), ("shm_files", "files of /dev/shm [-]"),
    )  # fmt: skip
    end = max((s.tick for s in samples), default=0) / 1e6
    frames = []
    for what, label in whats:
        layers, top = list[Layer](), 1.0
        for i, name in enumerate(names):
            rows = [s for s in samples if s.process == name]
            values = [getattr(s, what) for s in rows]
            if what == "memory":
                values = [v - values[int(soaking.WARM_UP * len(values))] for v in values]
            top = max(top, *values)
            ticks = [s.tick / 1e6 for s in rows]
            layers.append(line(name, ticks, values, PALETTE[i % len(PALETTE)]))
        at = [soaking.WARM_UP * end] * 2
        layers.append(line("judged from here", at, [0.0, top], GREY, shape=DASHED))
        limits = None if what == "memory" else (0.0, 1.06 * top)
        frames.append(Frame(Axis("ticks [10⁶]"), Axis(label, limits=limits), layers))
    return Chart(frames)
