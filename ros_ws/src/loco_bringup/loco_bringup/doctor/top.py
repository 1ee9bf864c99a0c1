# SPDX-License-Identifier: Apache-2.0
"""`loco top`: the live graph in the terminal, once a second."""

from __future__ import annotations

import argparse
import sys
import time

from ..graph.view import SILENCE_TIMEOUT, GraphObserver, Report, View

_COLUMNS = ("node", "pid", "cpu %", "MB", "ticks/s", "mean ms", "max ms", "late", "stale",
            "dropped", "state")  # fmt: skip
_LEVELS = ("ok", "warning", "ERROR", "stale")
_MAX_AGE = 30.0  # age after which a node is left out [s]


def show_top(a: argparse.Namespace) -> int:
    """`loco top`: print the graph every second until Ctrl-C, or once.

    Returns:
        0; with ``--once`` 1 if no node reported.
    """
    with GraphObserver() as observer:
        view = _first(observer)
        if a.once:
            sys.stdout.write(text(view))
            return 0 if view.reports else 1
        clear = "\x1b[H\x1b[J" if sys.stdout.isatty() else ""
        while True:
            sys.stdout.write(f"{clear}{time.strftime('%H:%M:%S')}  {text(view)}")
            sys.stdout.flush()
            view = observer.listen(a.interval)


def _first(observer: GraphObserver) -> View:
    """The graph, once every responsive node has reported, or after a time limit."""
    view = observer.listen(2.0)
    for _ in range(8):
        nodes = {e.node for e in view.endpoints if e.topic == "/diagnostics" and e.writes}
        if nodes and nodes <= view.reports.keys():
            break
        view = observer.listen(0.5)
    return view


def text(view: View) -> str:
    """The graph as lines of text."""
    reports = {name: r for name, r in sorted(view.reports.items()) if r.age < _MAX_AGE}
    if not reports:
        return "no node speaks on /diagnostics; `loco doctor` says why\n"
    rows = [_row(name, report) for name, report in reports.items()]
    widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
    lines = [_summary(name, r, view) for name, r in reports.items() if "sim_time" in r.values]
    lines += [_line(row, widths) for row in (_COLUMNS, *rows)]
    return "\n".join(lines) + "\n"


def _summary(name: str, plant: Report, view: View) -> str:
    space = name.rpartition("/")[0]
    phases = [e.text for e in view.events if e.kind == "phase" and e.namespace == space]
    parts = [
        f"{space or '/'}: {plant.number('sim_time'):.2f} s simulated",
        f"{plant.number('real_time_factor'):.2f} x real time",
        f"clock {plant.values.get('clock', '?')}",
        f"phase {phases[-1]}" if phases else "no phase",
    ]
    return ", ".join(parts)


def _row(name: str, r: Report) -> tuple[str, ...]:
    span = r.number("span_s", 1.0) or 1.0
    state = "silent" if r.age > SILENCE_TIMEOUT else _LEVELS[min(r.level, 3)]
    if r.message != "running" and r.age <= SILENCE_TIMEOUT:
        state += f": {r.message}"
    if state == "silent":
        state += f" for {r.age:.0f} s"
    ticking = "silence" in r.values
    return (
        name,
        r.values.get("pid", "-"),
        f"{r.number('cpu_percent'):.0f}",
        f"{r.number('memory_mb'):.0f}",
        f"{r.number('ticks') / span:.0f}" if ticking else "-",
        f"{r.number('period_mean_ms'):.2f}" if ticking else "-",
        f"{r.number('period_max_ms'):.1f}" if ticking else "-",
        r.values.get("late_ticks", "-"),
        r.values.get("stale", "-"),
        r.values.get("dropped", "-"),
        state,
    )


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    last = len(cells) - 1
    return "  ".join(
        cell if i == last else cell.ljust(width) if i == 0 else cell.rjust(width)
        for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
