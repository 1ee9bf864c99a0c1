# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce`: repeat experiments of the thesis and judge each claim."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable
from loco_learning.calibration.params import CalibrationParams
from loco_learning.networks import jobs as msd_jobs
from loco_learning.networks import results as msd_results
from loco_learning.thesis import chapter5, chapter6, chapter7, chapter8, evidence, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import Verdict
from loco_sim.msd.params import PRESETS
from loco_sim.msd.params import preset as known

from ..calibrate import run as calibrator
from ..study.terminal import run_study, write
from ..terminal import bar, console
from . import page

# Parts of the thesis by name: prefixes of their claims' numbers.
WHAT = {"tigrillo": ("5.",), "msd": ("6.",), "hyq": ("7.", "9."), "clock": ("8.",),
        "all": ("5.", "6.", "7.", "8.", "9.")}  # fmt: skip
MEASURES = (
    chapter5,
    chapter6,
    chapter7,
    chapter8,
)  # imported since these modules register their functions
NOT_TIMED = "not timed; the command tells its progress"
BAG, GAITS = "bags/surrogate_sine", ("bags/surrogate_bound", "bags/surrogate_walk")


def run(a: argparse.Namespace) -> int:
    """Run the missing entries, judge all claims, write the page.

    Returns:
        0, also if claims disagree, which is a valid result.

    Raises:
        NameUnknownError: There is no such plan.
        ParameterError: `workers` is below 1.
    """
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    plan = "quick" if a.quick else a.plan
    if a.what == "msd":
        return reproduce_msd(plan, a.preset, a.out, a.workers, a.scheduler, a.cost)
    return reproduce(a.what, plan, a.out, a.workers, a.scheduler, a.cost)


def reproduce(
    what: str,
    plan: str,
    folder: Path | None = None,
    workers: int = 2,
    scheduler: str = "",
    only_cost: bool = False,
) -> int:
    """Run the entries of a plan that its claims of `what` need; judge and write the page."""
    folder = folder or Path("results") / f"thesis_{Path(plan).stem}"
    if not only_cost:
        check_writable(folder)
    entries = evidence.plan(plan)
    claims = [c for c in registry.claims()
              if c.number.startswith(WHAT[what]) and c.evidence[0] in entries]  # fmt: skip
    needed = {name for claim in claims for name in claim.evidence}
    for name, entry in entries.items():
        if (entry.base or name) in needed:
            _run(entry, folder / name, workers, scheduler, only_cost)
    if only_cost:
        return 0
    results = Evidence(entries, folder, _other_results(entries, folder))
    verdicts = registry.judge_all(claims, results)
    drawn = page.thesis_figures(results, folder)
    title, command = f"Claims of the thesis, {plan} plan", f"loco reproduce {what} --plan {plan}"
    written = page.write(title, command, verdicts, drawn, entries, folder)
    return show(verdicts, written)


def _run(entry: Entry, folder: Path, workers: int, scheduler: str, only_cost: bool) -> None:
    """Run the missing cases of an entry, in its folder."""
    if entry.study:
        loaded = entry.load()
        results = run_study(loaded, folder, workers, scheduler, only_cost)
        if not only_cost:
            write(loaded, results, folder)
    elif only_cost:
        console.print(f"{entry.name}: {NOT_TIMED}")
    elif entry.physics == "msd":
        base = folder.parent / entry.base / "runs" if entry.base else None
        _run_msd(entry, folder, workers, scheduler, base)
    else:
        options = CalibrationParams(generations=entry.options["generations"])
        job = calibrator.prepare(
            BAG, "tigrillo", options, GAITS, entry.options["seeds"], folder, workers, scheduler
        )
        if not (folder / calibrator.results.FILE).is_file():
            calibrator.calibrate(job)


def _other_results(entries: dict[str, Entry], folder: Path) -> dict:
    """Readers of results that are not studies, for the entries that have been run."""
    readers = {}
    if (folder / "calibration" / calibrator.results.FILE).is_file():
        readers["calibration"] = lambda: calibrator.results.load(folder / "calibration")
    for name, entry in entries.items():
        if entry.physics == "msd" and (folder / name / "runs").is_dir():
            readers[name] = partial(_msd_results, entry, folder / name)
    return readers


def show(verdicts: list[Verdict], written: Path) -> int:
    """Print the verdicts and the path of their page; returns 0."""
    for v in verdicts:
        lines = (
            f"{v.name:>5}  {v.verdict}: {v.claim.says}",
            f"       rule: {v.claim.rule_text}",
            f"       found: {v.text}",
            v.reason and f"       {v.reason}",
        )
        console.print("\n".join(filter(None, lines)))
    console.print(f"{registry.tally(verdicts)}; page: {written}")
    return 0


def reproduce_msd(
    plan: str,
    preset: str,
    folder: Path | None = None,
    workers: int = 2,
    scheduler: str = "",
    only_cost: bool = False,
) -> int:
    """Reproduce chapter 6, mass-spring-damper networks."""
    known(preset)
    folder = folder or Path("results") / f"msd_{preset}_{plan}"
    if only_cost:
        to_go, every = msd_jobs.remaining(msd_jobs.plan(plan), preset, folder / "runs")
        console.print(f"{to_go} of {every} runs to go, {NOT_TIMED}")
        return 0
    check_writable(folder)
    entry = Entry("msd", options={"plan": plan, "preset": preset})
    return show(*_run_msd(entry, folder, workers, scheduler))


def _run_msd(
    entry: Entry, folder: Path, workers: int, scheduler: str, finished: Path | None = None
) -> tuple[list[Verdict], Path]:
    """Run the missing jobs of chapter 6; verdicts on its claims, and their page."""
    plan, preset = entry.options["plan"], entry.options["preset"]
    with bar("{task.completed}/{task.total} runs", "{task.fields[last]}") as progress:
        task = progress.add_task(f"msd, {preset}", total=None, last="")

        def show_progress(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, last=name)

        msd_jobs.run(
            _msd_plan(entry), preset, folder / "runs", workers, scheduler, show_progress, finished
        )
    loaded = _msd_results(entry, folder)
    results = Evidence({"msd": entry}, folder, {"msd": lambda: loaded})
    claims = [c for c in registry.claims() if c.number.startswith(WHAT["msd"])]
    verdicts = [registry.judge(claim, results) for claim in claims]
    title = f"Chapter 6, preset {preset} ({PRESETS[preset].about}), {plan} plan"
    command = f"loco reproduce msd --plan {plan} --preset {preset}"
    drawn = page.msd_figures(loaded, folder)
    return verdicts, page.write(title, command, verdicts, drawn, {}, folder)


def _msd_results(entry: Entry, folder: Path) -> msd_results.Results:
    return msd_results.load(_msd_plan(entry), entry.options["preset"], folder / "runs")


def _msd_plan(entry: Entry) -> msd_jobs.Plan:
    return msd_jobs.plan(entry.options["plan"], **entry.options.get("settings", {}))
