# SPDX-License-Identifier: Apache-2.0
"""`loco chaos`: repeated signals to every process, failures of the system, faults on every topic.

A cell is a signal and a process, a failure of the system, or a topic with all its faults. Each
runs in its own process and writes a file of rows; a cell with a file is not run again.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.ros.messages.topics import TOPICS

from .faults import run_topic
from .rough import AHEAD, BACK, HAPPENS, KILLED, run_rough, wall_clock
from .signals import KILL, STOP, run_signal
from .traces import TAG


@dataclass(frozen=True)
class Cell:
    """One test condition: a signal to a process, a system failure, or all faults of a topic."""

    how: str  # SIGSTOP, SIGKILL, rough (system failures) or faults
    what: str

    @property
    def name(self) -> str:
        """Name of the cell in file names and for ``--only``."""
        return f"{self.how}_{self.what.strip('/').replace('/', '_').replace(' ', '_')}"


def cells(only: str = "") -> list[Cell]:
    """All cells, or those whose name contains the text `only`.

    Raises:
        NameUnknownError: No cell name contains the text.
    """
    kills = [*(("SIGKILL", who) for who in KILLED), *(("rough", what) for what in HAPPENS)]
    available = [Cell(*pair) for pair in (*STOP, *KILL, *kills, *(("faults", t) for t in TOPICS))]
    selected = [cell for cell in available if only in cell.name]
    if not selected:
        raise NameUnknownError("cell", only, [cell.name for cell in available])
    return selected


def run(
    chosen: list[Cell],
    repeats: int,
    seed: int,
    folder: Path,
    tell: Callable[[Cell], Any] = lambda cell: None,
) -> dict[str, list[dict[str, Any]]]:
    """Run the cells that have not run yet; returns the rows of all cells, by cell.

    Args:
        chosen: Cells to run.
        repeats: Repetitions of each signal and each fault.
        seed: Seed of times and random choices.
        folder: Folder of the results; an existing one is continued.
        tell: Called before each cell.

    Raises:
        ParameterError: `repeats` is below 1.
    """
    if repeats < 1:
        raise ParameterError(f"repeats must be at least 1, got {repeats}")
    folder = folder.resolve()
    (folder / "cells").mkdir(parents=True, exist_ok=True)
    by_cell = {}
    for cell in chosen:
        tell(cell)
        rows = rows_of(cell, folder, repeats, seed)
        by_cell[cell.name] = _run_cell(cell, repeats, seed, folder) if rows is None else rows
    return by_cell


def rows_of(cell: Cell, folder: Path, repeats: int, seed: int) -> list[dict[str, Any]] | None:
    """Rows of a cell that has run with these repetitions and seed, else None."""
    path = folder / "cells" / f"{cell.name}.json"
    if not path.is_file():
        return None
    stored = json.loads(path.read_text())
    return stored["rows"] if (stored["repeats"], stored["seed"]) == (repeats, seed) else None


def _run_cell(cell: Cell, repeats: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Run a cell in its own process; an environment variable marks all its child processes.

    A cell that ends with an error returns a row with the error, and is repeated the next time.
    """
    place = folder / "runs" / cell.name
    shutil.rmtree(place, ignore_errors=True)
    place.parent.mkdir(exist_ok=True)
    clock = wall_clock(place) if cell.what in (AHEAD, BACK) else {}
    job = json.dumps([cell.how, cell.what, repeats, seed, str(place)])
    log = folder / "cells" / f"{cell.name}.log"
    with open(log, "w") as stream:
        done = subprocess.run(
            [sys.executable, "-m", "loco_workshop.stress.chaos", job],
            env={**os.environ, **clock, TAG: f"{cell.name}-{os.getpid()}"},
            stdout=subprocess.PIPE,
            stderr=stream,
            text=True,
        )
    if done.returncode:
        lines = [f"exit code {done.returncode}", *log.read_text().strip().splitlines()]
        return [{"what": cell.what, "how": cell.how, "ok": False, "notes": lines[-1:]}]
    rows = json.loads(done.stdout.splitlines()[-1])
    content = {"repeats": repeats, "seed": seed, "rows": rows}
    (folder / "cells" / f"{cell.name}.json").write_text(json.dumps(content, indent=1))
    log.unlink()
    return rows


def main() -> None:
    """Run one cell described by JSON on the command line, and write its rows."""
    how, what, repeats, seed, place = json.loads(sys.argv[1])
    if how == "faults":
        rows = run_topic(what, repeats, seed, Path(place))
    elif what in {**KILLED, **HAPPENS} and how != "SIGSTOP":
        rows = run_rough(how, what, repeats, seed, Path(place))
    else:
        rows = run_signal(how, what, repeats, seed, Path(place))
    sys.stdout.write(json.dumps(rows) + "\n")


if __name__ == "__main__":
    main()
