# SPDX-License-Identifier: Apache-2.0
"""`loco gap fleet`: gaps of many recordings of many robots, with live progress and time left."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import io
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.files import claim, write_whole
from loco_control.params import from_dict, to_dict
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.fleet import contents, fleet, table, tasks
from loco_learning.gap.fleet.fleet import Fleet
from loco_learning.gap.fleet.params import FleetParams
from loco_learning.gap.fleet.table import Recording
from loco_learning.gap.importing import tables
from loco_learning.gap.setup.contents import SETUP
from loco_learning.jobs.kept import Memory
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from ...bag.foreign.opening import suffix_of
from ...settings import merge, overrides
from ...terminal import bar, console
from .. import run as runner
from ..importing import DRAFTS, drafted, load
from . import page

RESULT, PAGE, JOURNAL, DRAFT = "fleet.json", "fleet.html", "fleet.jsonl", f"drafts/{table.FILE}"
TABLES = PARQUET, CSV = "fleet.parquet", "fleet.csv"
LISTED = 10  # recordings in the terminal
STORED = 0.01  # time in which a stored result is read [s]


def show_fleet(a: argparse.Namespace) -> int:
    """Run `loco gap fleet`.

    Returns:
        The exit code: 2 if the set-up of a robot must be corrected first.

    Raises:
        LocoError: An option, the table or the robot is invalid, or no recording can be used.
    """
    if not a.robot:
        raise ParameterError(
            "loco gap fleet wants --robot: a robot, robot.yaml, model.yaml or URDF"
        )
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    if not a.folder.exists():
        raise MissingFileError(f"there is no folder of recordings at {a.folder}")
    root = a.folder if a.folder.is_dir() else a.folder.parent
    out = a.out or Path("results") / f"fleet_{root.resolve().name}"
    claim(out, RESULT, JOURNAL, DRAFT, *DRAFTS)
    gap, params = settings(a)
    rows, notes = recordings(a.folder, root, out)
    first = str(root / rows[0].file)
    robot, mapping, remarks = drafted(a.robot, [first], str(a.mapping or ""), out)
    for line in (*notes, *remarks):
        console.print(f"  {line}")
    base = models.load_any(robot)
    path = Path(base.robot)  # workers on other hosts have another working folder
    model = Model(str(path.resolve()), base.overrides, base.effects) if path.exists() else base
    plant = model.make_robot()
    read = partial(
        load, robot=plant, mapping_file=str(Path(mapping).resolve()) if mapping else None
    )
    setting = tasks.Setting(read, model, gap, params)
    inputs = model, plant, Path(mapping).read_text(encoding="utf-8") if mapping else "", gap, params
    with bar("{task.percentage:3.0f} %") as progress:
        report = _Progress(progress, progress.add_task("reading", total=1.0))
        with Memory(out / JOURNAL, inputs, tasks.RESULTS, stays=True) as memory:
            done = fleet.find(Fleet(rows), root, setting, memory, a.scheduler or a.workers, report)
    result = contents.contents(done, a.robot, {**to_dict(gap), **to_dict(params)})
    write(done, result, out)
    show(result, out)
    return 2 if any(row["verdict"] == SETUP for row in page.searches(result)) else 0


class _Progress:
    """Progress in a bar, or, where there is no terminal, a line for each tenth with time left."""

    def __init__(self, progress: Any, task: Any):
        self._progress, self._task, self._tenths = progress, task, 0
        self._last = self._start = time.monotonic(), 0.0

    def __call__(self, share: float, stage: str) -> None:
        self._progress.update(self._task, completed=share, description=stage)
        if time.monotonic() - self._last[0] < STORED:  # no work, but a result of an earlier call
            self._start = time.monotonic(), share
        self._last = time.monotonic(), share
        if self._progress.disable and int(10.0 * share) > self._tenths:
            self._tenths, done = int(10.0 * share), share - self._start[1]
            seconds = (self._last[0] - self._start[0]) * (1.0 - share) / max(done, 1e-9)
            left = f", {seconds / 60.0:.1f} min left" if done else ""
            sys.stderr.write(f"{10 * self._tenths:3d} % {stage}{left}\n")


def settings(a: argparse.Namespace) -> tuple[GapParams, FleetParams]:
    """Settings of searches and of the fleet.

    Raises:
        LocoError: A value is out of range, or a name is unknown.
    """
    options = {"effects": list(a.effects)} if a.effects else {}
    options = merge({**options, "seed": a.seed}, overrides(a.set, None))
    keys = {f.name for f in dataclasses.fields(FleetParams)}
    params = from_dict(FleetParams, {k: v for k, v in options.items() if k in keys}, "fleet")
    job = runner.Job("", (), options={k: v for k, v in options.items() if k not in keys})
    return runner.options_of(job), params


def recordings(source: Path, root: Path, out: Path) -> tuple[list[Recording], list[str]]:
    """Rows of the table, and sentences on a draft of it.

    Args:
        source: The table, or the folder with it or with recordings as ROBOT/DAY/FILE.
        root: Folder that the files are relative to.
        out: Folder of the results, which may have a draft.

    Raises:
        LocoError: There is no recording, or a row of the table is wrong.
    """
    file, draft = source / table.FILE if source.is_dir() else source, out / DRAFT
    if file.is_file():
        return table.load(file, root), []
    files = table.scan(root, _is_recording)
    if not draft.is_file():
        write_whole(draft, table.dumps(table.COLUMNS, files))
    rows = table.load(draft, root)
    new = {row.file for row in files} - {row.file for row in rows}
    notes = [f"{draft} is a draft from the folders ROBOT/DAY, to be corrected"]
    if new:
        notes.append(
            f"not in it, and left out: {page.counted(len(new), 'recording')}, {min(new)} first"
        )
    return rows, notes


def _is_recording(path: Path) -> bool:
    named = tables.is_table(path) if path.is_file() else False
    return not path.name.startswith(".") and bool(suffix_of(path) or named)


def write(done: Fleet, result: Mapping[str, Any], out: Path) -> None:
    """Write `RESULT`, the table of recordings and `PAGE`."""
    runner.write_json(out / RESULT, result)
    rows, name = contents.rows(done), PARQUET if importlib.util.find_spec("pyarrow") else CSV
    write_whole(out / name, parquet(rows) if name == PARQUET else as_csv(rows))
    for other in TABLES:
        if other != name:
            (out / other).unlink(missing_ok=True)
    write_whole(out / PAGE, page.page(result))


def as_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Text of a CSV file with a row for each recording."""
    return table.dumps(list(rows[0]), [list(row.values()) for row in rows])


def parquet(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """A Parquet file with a row for each recording."""
    arrow, parts = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    file = io.BytesIO()
    parts.write_table(arrow.Table.from_pylist([dict(row) for row in rows]), file)
    return file.getvalue()


def show(result: Mapping[str, Any], out: Path) -> None:
    """Print each effect with its robots, and what was left out."""
    for line in page.lines(result):
        console.print(line)
    for what in ("unexplained", "skipped"):
        for row in result[what][:LISTED]:
            reason = row.get("reason") or f"{row['after']:.3g} noise floors stay"
            console.print(f"  {what}: {row['file']}: {reason}")
        if len(result[what]) > LISTED:
            console.print(f"  {what}: {len(result[what]) - LISTED} more, in {out / RESULT}")
    console.print(f"  page: {out / PAGE}")
