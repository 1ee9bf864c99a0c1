# SPDX-License-Identifier: Apache-2.0
"""`loco gap check`: quality of recordings before a search, on the terminal and as a page."""

from __future__ import annotations

import argparse
import itertools
import shlex
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from markupsafe import Markup

from loco_control.exceptions import LocoError, ParameterError
from loco_control.files import claim, write_whole
from loco_control.reading import read_yaml
from loco_learning.gap.preview import check as preview
from loco_learning.gap.preview.visible import LARGE, NO, YES
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup import mend
from loco_learning.gap.setup.finding import MAPPING, MODEL, from_plain
from loco_sim.plant import model as models

from ..page import html
from ..terminal import bar, console, table
from . import plots, text
from . import run as runner
from .importing import DRAFTS, drafted, load, mapping_of

PAGE, JSON = "check.html", "check.json"
READY, WARNED, UNUSABLE = "ready", "usable, with warnings", "not usable as it is"
WRONG = "set-up to be mended first"
MOST_ALIKE = 3  # largest number of indistinguishable effects named in a table cell
Checked = Mapping[str, Any]


def show_check(a: argparse.Namespace) -> int:
    """`loco gap check`: examine the recordings, print the result, write the page.

    Returns:
        The exit code: 2 if a recording is refused.

    Raises:
        LocoError: The robot is unknown, or no recording is usable.
    """
    if not a.robot:
        raise ParameterError("loco gap check wants --robot: a robot, model.yaml or URDF")
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    folder = a.out or Path("results") / f"check_{Path(a.bags[0]).name.split('.')[0]}"
    claim(folder, JSON, *DRAFTS)
    robot, file, notes = drafted(a.robot, a.bags, str(a.mapping or ""), folder)
    mapping = Path(file) if file else None
    with bar("{task.percentage:3.0f} %") as progress:
        task = progress.add_task("reading", total=1.0)

        def report(share: float, stage: str) -> None:
            progress.update(task, completed=share, description=stage)

        result = checked(robot, a.bags, mapping, a.workers, report)
    folder.mkdir(parents=True, exist_ok=True)
    runner.write_json(folder / JSON, result)
    write_whole(folder / PAGE, page(result))
    fixed = fix(robot, a.bags, mapping, result, folder) if a.fix else {}
    if a.json:
        sys.stdout.write(runner.dumps(result))
    else:
        show(result)
        console.print(f"  page: {folder / PAGE}")
        for line in (*notes, *next_lines(robot, a.bags, mapping, result, fixed)):
            console.print(f"  {line}")
    return 2 if result["refused"] or result["verdict"] == WRONG else 0


def checked(
    robot: str, bags: Sequence[str], mapping: Path | None, workers: int, report: Any
) -> dict[str, Any]:
    """Contents of ``check.json``.

    A recording that cannot be read is listed with the reason; the others are examined.

    Args:
        robot: Robot, robot.yaml or model.yaml.
        bags: Recordings.
        mapping: Mapping file, or None.
        workers: Number of processes.
        report: Called with the completed share and the stage.

    Raises:
        LocoError: The robot is unknown, or no recording is usable (with the reason of the first).
    """
    model = models.load_any(robot)
    plant, records = model.make_robot(), list[Record]()
    errors: dict[str, LocoError] = {}
    for bag in bags:
        try:
            records += load(bag, plant, mapping)
        except LocoError as error:
            errors[str(bag)] = error
    if not records:  # a fault in all recordings is a fault of the set-up
        records = [r for bag in bags for r in load(bag, plant, mapping, judge=False)]
        errors = {}
    rejected = [{"recording": bag, "reason": str(error)} for bag, error in errors.items()]
    result = preview.inspect(model, records, None, report, workers)
    return {**result, "refused": rejected, "verdict": verdict(result, rejected)}


def fix(
    robot: str, bags: Sequence[str], file: Path | None, check: Checked, folder: Path
) -> dict[str, Path]:
    """Write a new mapping and model that correct the set-up; existing files are kept.

    Args:
        robot: Robot, robot.yaml or model.yaml.
        bags: Recordings.
        file: Mapping file from the command line, or None.
        check: Contents of ``check.json``.
        folder: Folder of the files.

    Returns:
        Files by the option of `loco gap` that takes them; empty if nothing needs correction.

    Raises:
        ParameterError: The recordings have different mappings.
    """
    changes = mend.changes_of([from_plain(one) for one in check["setup"] if _sure(one)])
    options: dict[str, Path] = {}
    if any(change.file == MAPPING for change in changes):
        paths = {m.path for bag in bags if (m := mapping_of(Path(bag), file))}
        if len(paths) > 1:
            raise ParameterError(
                f"--fix writes one mapping, but these recordings have {len(paths)} "
                f"({', '.join(map(str, sorted(paths)))}); check them one by one"
            )
        values = read_yaml(paths.pop(), "mapping") if paths else {"format": 1}
        text = yaml.safe_dump(mend.mapping_with(values, changes), sort_keys=False)
        options["--mapping"] = write_whole(free(folder / MAPPING), text)
    model = mend.model_mended(models.load_any(robot), changes)
    if model:
        options["--robot"] = free(folder / MODEL)
        runner.relocated(model, folder).save(options["--robot"])
    return options


def _sure(finding: Checked) -> bool:
    """Whether a finding has one way to mend it."""
    return bool(finding["mends"]) and not finding["others"]


def free(path: Path) -> Path:
    """The first of path, path_2, path_3, ... that does not exist."""
    numbered = (path.with_stem(f"{path.stem}_{k}") for k in itertools.count(2))
    return next(p for p in itertools.chain([path], numbered) if not p.exists())


def next_lines(
    robot: str, bags: Sequence[str], file: Path | None, check: Checked, fixed: Mapping[str, Path]
) -> list[str]:
    """Corrected files, what they leave out, and the next command; or the option for them."""
    left = [f"--fix leaves out: {one['fault']} of {', '.join(one['joints']) or 'the robot'}, as "
            + ("several ways mend it: choose one" if one["others"] else "no line surely mends it")
            for one in check["setup"] if not _sure(one)]  # fmt: skip
    if not fixed:
        return left + ["--fix writes these lines into new files"] * any(map(_sure, check["setup"]))
    options = {"--robot": robot} | ({"--mapping": file} if file else {}) | {**fixed}
    parts = itertools.chain(map(str, bags), *((key, str(path)) for key, path in options.items()))
    return [*(f"written: {path}" for path in fixed.values()), *left,
            f"then:    loco gap {shlex.join(parts)}"]  # fmt: skip


def verdict(check: Checked, rejected: Sequence[Any]) -> str:
    """One of `READY`, `WARNED`, `UNUSABLE` and `WRONG`."""
    if not rejected and any(one["stops"] for one in check["setup"]):
        return WRONG
    warned = check["missing"] or check["setup"] or any(r["warnings"] for r in check["recordings"])
    return UNUSABLE if rejected else WARNED if warned else READY


def sentences(check: Checked) -> list[str]:
    """Problems of the recordings as sentences, worst first."""
    lines = [f"{r['recording']} is refused: {r['reason']}" for r in check["refused"]]
    lines += [one["says"] for one in check["setup"]]
    lines += [f"{r['name']}: {w}" for r in check["recordings"] for w in r["warnings"]]
    return lines + list(check["missing"])


def readings(check: Checked) -> list[str]:
    """Notes on excerpts, and from reading the recordings, each once, with their names."""
    names: dict[str, list[str]] = {}
    for recording in check["recordings"]:
        for note in recording["notes"]:
            names.setdefault(note, []).append(recording["name"])
    return [*check["notes"], *(f"{', '.join(of)}: {note}" for note, of in names.items())]


def counts(check: Checked) -> dict[str, int]:
    """Number of candidate effects (effect and place) by whether the data would reveal them."""
    grades: dict[tuple[str, str, str], str] = {}
    for row in check["effects"]:
        key = row["effect"], row["variant"], row["place"]
        grades[key] = min(grades.get(key, NO), row["seen"], key=(YES, LARGE, NO).index)
    return {grade: list(grades.values()).count(grade) for grade in (YES, LARGE, NO)}


def by_effect(check: Checked) -> list[list[str]]:
    """Rows of a table: effect, places where it is detectable, smallest size, similar effects."""
    groups: dict[tuple[str, str], list[Any]] = {}
    for row in check["effects"]:
        groups.setdefault((row["effect"], row["parameter"]), []).append(row)
    lines = []
    for (effect, parameter), rows in sorted(groups.items()):
        visible = [r for r in rows if r["seen"] != NO]
        hidden = sorted({text.place_of(r["place"]) for r in rows if r["seen"] == NO})
        sizes = sorted(r["smallest"] for r in visible)
        similar = sorted({name for r in visible for name in r["alike"]})
        suffix = f" and {len(similar) - MOST_ALIKE} more" if len(similar) > MOST_ALIKE else ""
        several = len({p for e, p in groups if e == effect}) > 1
        name = text.words(effect) + (f" ({text.words(parameter)})" if several else "")
        unit = "" if rows[0]["unit"] == "-" else f" {rows[0]['unit']}"
        smallest = f"{text.number(sizes[0])}{unit}" if sizes else "–"
        if len(sizes) > 1 and sizes[-1] > 1.2 * sizes[0]:
            smallest = f"{text.number(sizes[0])} to {text.number(sizes[-1])}{unit}"
        lines.append([
            name, f"{len(visible)} of {len(rows)}", smallest,
            f"{text.number(rows[0]['typical'])}{unit}",
            ", ".join(hidden[:4]) + (f" and {len(hidden) - 4} more" if len(hidden) > 4 else ""),
            ", ".join(map(text.words, similar[:MOST_ALIKE])) + suffix,
        ])  # fmt: skip
    return lines


HEAD = ("Effect", "Shows at", "From", "Usual size", "Not at", "Looks the same as")


def recording_rows(check: Checked) -> list[list[str]]:
    """Rows of a table: recording, length, rate, jitter, missing samples, lag, signals."""
    rows = []
    for r in check["recordings"]:
        stamps = r["stamps"].get("q") or {}
        lag = sorted(r["lag_ms"].values())
        lag_range = f"{text.number(lag[0])} to {text.number(lag[-1])} ms" if lag else "–"
        rows.append([
            r["name"], r["held"], f"{text.number(r['seconds'])} s", f"{text.number(r['rate'])} Hz",
            f"{text.number(stamps.get('jitter_ms'))} ms" if stamps else "–",
            f"{stamps['missing']:.0f}" if stamps else "–", lag_range,
        ])  # fmt: skip
    return rows


def signals(check: Checked) -> list[str]:
    """Signals and commands, one line per set of recordings with the same ones."""
    having: dict[str, list[str]] = {}
    for r in check["recordings"]:
        line = ", ".join([*r["signals"], *(f"command {c}" for c in r["commands"])])
        having.setdefault(line, []).append(r["name"])
    if len(having) == 1:
        return [f"measured: {line}" for line in having]
    return [f"{text.listed(names)}: {line}" for line, names in having.items()]


RECORDING_HEAD = ("Recording", "Base", "Length", "Rate", "Jitter", "Missing", "Behind command")


def search_line(check: Checked) -> str:
    """Estimated duration of a search as text."""
    if not check["search_seconds"]:
        return "no effect was tried: the set-up has to be mended first"
    low, high = (_time(s) for s in check["search_seconds"])
    return f"a search takes about {low}, up to {high} where much is missing"


def _time(seconds: float) -> str:
    return f"{max(1, round(seconds))} s" if seconds < 100.0 else f"{round(seconds / 60.0)} min"


def visible(check: Checked) -> str:
    """Number of candidate effects that the data would reveal, in one line."""
    n = counts(check)
    return (
        f"of {sum(n.values())} effects at a place, {n[YES]} are visible at their usual size, "
        f"{n[LARGE]} only if large, {n[NO]} not at all"
    )


def show(check: Checked) -> None:
    """Print the result."""
    console.print(": ".join([check["verdict"], *[visible(check)] * bool(check["effects"])]))
    for line in sentences(check):
        console.print(f"  {line}")
    console.print(table("", RECORDING_HEAD, recording_rows(check)))
    for line in (*signals(check), *readings(check)):
        console.print(f"  {line}")
    if check["effects"]:
        console.print(table("", HEAD, by_effect(check)))
    console.print(f"  {search_line(check)}")


def page(check: Checked) -> str:
    """HTML text of the page."""
    head = html.join(
        [
            html.verdict(check["verdict"], check["verdict"] not in (UNUSABLE, WRONG)),
            *[html.paragraph(html.strong(visible(check).capitalize()))] * bool(check["effects"]),
            *(html.missing(line) for line in sentences(check)),
            html.paragraph(f"{search_line(check)[0].upper()}{search_line(check)[1:]}.", soft=True),
        ]
    )
    parts = [html.part("Recordings", lambda: _recordings(check))]
    if check["effects"]:
        parts += [
            html.part("What would show", lambda: _effects(check), long=True),
            html.part("Effect by joint", lambda: _matrix(check), long=True),
            html.part("Not tried", lambda: html.bullets(
                f"{text.words(n['effect'])}: {n['reason']}" for n in check["not_tried"])),
        ]
    return html.document(f"Recordings of {Path(str(check['robot'])).name}", head, parts)


def _recordings(check: Checked) -> Markup:
    rows = html.table(RECORDING_HEAD, recording_rows(check), range(2, 7))
    return html.join([rows, html.bullets([*signals(check), *readings(check)])])


def _effects(check: Checked) -> Markup:
    chart = html.figure(partial(plots.sizes, check), "What would show", _SIZES)
    rows = html.table(HEAD, by_effect(check), range(1, 4))
    return html.join([chart, html.paragraph(_VISIBLE_NOTE, soft=True), rows])


def _matrix(check: Checked) -> Markup:
    """Smallest detectable size by effect and place, one table per unit."""
    locations = list(dict.fromkeys(row["place"] for row in check["effects"]))
    rows: dict[str, dict[str, Any]] = {}
    for row in check["effects"]:
        rows.setdefault(f"{plots.named(row)} [{row['unit']}]", {})[row["place"]] = row
    marks = {YES: "good", LARGE: "so", NO: "bad"}
    cells = [
        (name, [
            (text.number(at[p]["smallest"]) if at[p]["seen"] != NO else "no", marks[at[p]["seen"]])
            if p in at else ("", "")
            for p in locations
        ])
        for name, at in rows.items()
    ]  # fmt: skip
    table_of = html.matrix([text.place_of(p) for p in locations], cells)
    return html.join([html.paragraph(_MATRIX, soft=True), table_of])


_VISIBLE_NOTE = (
    "Size from which on an effect adds three quarters of the noise to some channel, as the model "
    "predicts it under the recorded commands. Effects that look the same there change these "
    "recordings in the same way (cosine above 0.95): only their kind can be told."
)
_SIZES = (
    "Smallest size that shows beside the usual size, a dot for each place: what lies left of the "
    "dashed line shows at its usual size."
)
_MATRIX = "Smallest size that shows; green below what is usual, red where none does."
