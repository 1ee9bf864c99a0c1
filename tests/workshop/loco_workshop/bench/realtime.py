# SPDX-License-Identifier: Apache-2.0
"""`loco bench realtime`: lateness of ticks, compared with a loop that only wakes up.

The host pauses a virtual machine occasionally, which no program can prevent. Therefore the
bare loop runs at the same time as the graph: both have the same pauses, and the difference
is due to loco. Alternating runs would have different pauses, a few per minute. Since the
graph takes CPU time from the bare loop, the bare loop is also measured alone.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from loco_bringup.graph import run as runner
from loco_bringup.terminal import bar
from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import load

EXPERIMENT = "hyq_trot_reflex"
ALONE = "bare loop, alone"
# Requests to the kernel.
KERNELS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "SCHED_FIFO": {"fifo": 80, "lock_memory": True, "timer_slack": 1},
}
# Largest ratios to the values of the simultaneous bare loop.
MISSED, LATE = 1.5, 1.2


def bench_realtime(
    seconds: float = 60.0, rate: float = 250.0, layout: str = "composed"
) -> list[dict[str, Any]]:
    """Lateness of the HyQ graph and of the bare loop, with and without SCHED_FIFO.

    Args:
        seconds: Duration of each measurement [s].
        rate: Ticks per second [Hz].
        layout: Layout of the graph, ``composed`` or ``processes``.

    Raises:
        ParameterError: `seconds` is below 2.
    """
    if seconds < 2.0:  # noqa: PLR2004 (some hundred ticks)
        raise ParameterError(f"seconds must be at least 2, got {seconds:g}")
    rows = []
    with bar("{task.completed:.0f}/{task.total:.0f} s") as progress:
        task = progress.add_task("", total=2 * len(KERNELS) * seconds)
        for i, (kernel, requests) in enumerate(KERNELS.items()):
            start = 2 * i * seconds

            def tell(t: float, begin: float = start, kernel: str = kernel) -> None:
                progress.update(task, completed=begin + t, description=kernel)

            graph, parallel = _together(seconds, rate, layout, requests, tell)
            solo = _finished(_bare(seconds, rate, requests))
            failures = [line for line in graph["granted"] if "refused" in line]
            targets = "; ".join(failures) or _targets(graph, parallel)
            ticks = round(seconds * rate)
            rows += [
                _row(f"graph, {layout}", kernel, graph, ticks, targets),
                _row("bare loop, same time", kernel, parallel, ticks),
                _row(ALONE, kernel, solo, ticks),
            ]
    return rows


def _together(
    seconds: float,
    rate: float,
    layout: str,
    requests: dict[str, Any],
    tell: Callable[[float], None],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Lateness of the graph, and of the bare loop, which starts when the graph ticks."""
    experiment = load(EXPERIMENT, {"duration": seconds, "control_rate": rate})
    loops: list[subprocess.Popen] = []

    def look(progress: runner.Progress) -> None:
        if progress.sim_time > 0.0 and not loops:
            loops.append(_bare(seconds, rate, requests))
        tell(progress.sim_time)

    with tempfile.TemporaryDirectory(prefix="loco_realtime_") as folder:
        try:
            outcome = runner.run(
                experiment, Path(folder) / "bag", layout, "realtime", on_progress=look,
                realtime=requests, stop_on_fall=False,
            )  # fmt: skip
        except BaseException:
            for process in loops:
                process.kill()
            raise
    other = _finished(loops[0])
    if outcome.interrupted:
        raise KeyboardInterrupt
    return {**outcome.timing, "granted": outcome.granted}, other


def _bare(seconds: float, rate: float, requests: dict[str, Any]) -> subprocess.Popen:
    command = [
        sys.executable,
        "-m",
        "loco_workshop.bench.bare_loop",
        str(seconds),
        str(rate),
    ]
    return subprocess.Popen([*command, json.dumps(requests)], stdout=subprocess.PIPE, text=True)


def _finished(process: subprocess.Popen) -> dict[str, Any]:
    with process:
        return json.loads(process.communicate()[0])


def _targets(graph: dict[str, Any], beside: dict[str, Any]) -> str:
    """Ratios to the bare loop, and whether they meet the targets."""
    late = _ratio(graph["lateness_p99_ms"], beside["lateness_p99_ms"])
    missed = _ratio(graph["missed_ticks"], beside["missed_ticks"])
    return (
        f"p99 {late:.2f} x: {'holds' if late <= LATE else 'does not hold'}, "
        f"missed {missed:.2f} x: {'holds' if missed <= MISSED else 'does not hold'}"
    )


def _ratio(value: float, base: float) -> float:
    """Ratio of a value to the baseline; 1 if both are zero."""
    return value / base if base else 1.0 if value == base else float("inf")


def _row(
    loop: str, kernel: str, figures: dict[str, Any], ticks: int, targets: str = ""
) -> dict[str, Any]:
    late = {q: f"{figures[f'lateness_{q}_ms']:.3f}" for q in ("p50", "p99", "max")}
    return {
        "loop": loop,
        "scheduling": kernel,
        **{f"{q} ms": value for q, value in late.items()},
        "missed": f"{figures['missed_ticks']:.0f} of {ticks + figures['dropped_ticks']:.0f}",
        "targets": targets,
    }
