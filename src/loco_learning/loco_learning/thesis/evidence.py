# SPDX-License-Identifier: Apache-2.0
"""Entries of a plan, and their results for the measures.

``plans.yaml`` lists for each plan and entry the study, its numbers of points and seeds, and the
engine. Each entry has a folder; all are resumable.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import shown, understood
from loco_sim.engines import default_engine

from ..plain import read_yaml
from ..study import study as studies
from ..study.case import CaseResult
from ..study.study import Study
from .registry import NotRunError, file


@dataclasses.dataclass(frozen=True)
class Entry:
    """One entry of a plan.

    Attributes:
        name: Name of the entry and of its folder.
        study: Name of the study; empty for a calibration or chapter 6.
        engine: Physics engine; by default that of this machine.
        points: Points of spaced axes: a number for all, or by axis; None as in the study.
        seeds: Number of seeds; None for all.
        overrides: Values by dotted name for every variant.
        base: Name of the entry that this one repeats with a change.
        change: The change in words.
        options: Settings of an entry that is not a study.
    """

    name: str
    study: str = ""
    engine: str = dataclasses.field(default_factory=default_engine)
    points: Any = None
    seeds: int | None = None
    overrides: dict[str, Any] = dataclasses.field(default_factory=dict)
    base: str = ""
    change: str = ""
    options: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def physics(self) -> str:
        """Engine that runs it; chapter 6 has an integrator of its own."""
        return "msd" if "preset" in self.options else self.engine

    def load(self) -> Study:
        """The study with the settings of this plan."""
        loaded = studies.load(self.study, overrides={**self.overrides, "sim.engine": self.engine})
        if self.seeds:
            loaded = dataclasses.replace(loaded, seeds=loaded.seeds[: self.seeds])
        return loaded.with_points(self.points) if self.points else loaded


def plan(name: str) -> dict[str, Entry]:
    """Entries of a plan by name.

    Args:
        name: Name in ``plans.yaml``, or a path of another plan, which ends in ``.yaml``.

    Raises:
        NameUnknownError: The plan does not exist.
        MissingFileError: The file does not exist.
        ParameterError: The file is not a plan.
    """
    if name.endswith(".yaml"):
        return _entries(name, read_yaml(Path(name)))
    plans = read_yaml(file("plans.yaml"))
    if name not in plans:
        raise NameUnknownError("plan", name, plans)
    return _entries(name, plans[name])


@understood("plan")
def _entries(where: str, rows: Mapping[str, Any]) -> dict[str, Entry]:
    keys = [field.name for field in dataclasses.fields(Entry)][1:]
    for name, row in rows.items():
        if not isinstance(row, Mapping):
            raise ParameterError(f"{where}: {name} must be like {{study: NAME}}, got {shown(row)}")
        for key in row:
            if key not in keys:
                raise NameUnknownError(f"key in {name} of {where}", str(key), keys)
        if bool(row.get("base")) != bool(row.get("change")):
            raise ParameterError(f"{where}: {name} must have both base and change, or neither")
        if row.get("base", name) not in rows:
            raise NameUnknownError(f"base of {name} in {where}", str(row["base"]), rows)
    return {str(name): Entry(str(name), **row) for name, row in rows.items()}


class Evidence:
    """Results of a plan, read on demand of a measure.

    With a `change`, the entries that have it are read instead of their bases: `changed` has their
    names.

    Args:
        entries: Entries of the plan.
        folder: Folder that holds a folder per entry.
        other_results: Results of entries that are not studies, by name, as functions of nothing.
        change: One of the plan's changes; empty for the entries as they are judged.
    """

    def __init__(
        self,
        entries: dict[str, Entry],
        folder: Path,
        other_results: dict[str, Callable[[], Any]] | None = None,
        change: str = "",
    ):
        self.entries, self.folder, self._other_results = entries, folder, other_results or {}
        self.change = change
        self.changed = {e.base: n for n, e in entries.items() if change and e.change == change}
        self._read: dict[str, Any] = {}

    def with_changes(self) -> list[Evidence]:
        """The same results with each change of the plan."""
        changes = dict.fromkeys(e.change for e in self.entries.values() if e.change)
        return [Evidence(self.entries, self.folder, self._other_results, c) for c in changes]

    def planned(self, name: str) -> Study:
        """A study, whether or not it was run.

        Raises:
            NotRunError: The plan does not contain it.
        """
        name = self.changed.get(name, name)
        if name not in self.entries:
            raise NotRunError(f"{name} is not in this plan")
        return self.entries[name].load()

    def study(self, name: str) -> tuple[Study, list[CaseResult]]:
        """A study and its results.

        Raises:
            NotRunError: The plan does not contain it, or some of its cases were not run.
        """
        name = self.changed.get(name, name)
        if name not in self._read:
            loaded = self.planned(name)
            self._read[name] = loaded, studies.stored(loaded, self.folder / name)
        loaded, cases = self._read[name]
        if missing := sum(1 for _ in loaded.cases()) - len(cases):
            raise NotRunError(f"{name}: {missing} of {missing + len(cases)} cases were not run")
        return loaded, cases

    def other(self, name: str) -> Any:
        """Result of an entry that is not a study.

        Raises:
            NotRunError: The entry has no result.
        """
        name = self.changed.get(name, name)
        if name not in self._other_results:
            raise NotRunError(f"{name} was not run")
        if name not in self._read:
            self._read[name] = self._other_results[name]()
        return self._read[name]


def column(cases: Sequence[CaseResult], metric: str, phase: str, variant: str = "") -> np.ndarray:
    """A metric of a phase, one value per case; NaN if the phase was not reached.

    Args:
        cases: Cases of a study.
        metric: Name of the metric.
        phase: Name of the phase.
        variant: Variant whose cases count; empty for all.
    """
    selected = (case for case in cases if variant in ("", case.variant))
    return np.array([case.metrics.get(phase, {}).get(metric, np.nan) for case in selected])


def by_seed(cases: Sequence[CaseResult]) -> list[list[CaseResult]]:
    """Cases of each seed, in the order of the seeds: the runs that a spread is over."""
    seeds = sorted({case.seed for case in cases})
    return [[case for case in cases if case.seed == seed] for seed in seeds]


def curves(
    cases: Sequence[CaseResult], axis: str, metric: str, phase: str
) -> tuple[np.ndarray, np.ndarray]:
    """Values of an axis, (n,), and a metric at each for each seed, (seeds, n); NaN if it fell."""
    grid = np.unique([float(case.at[axis]) for case in cases])
    groups = by_seed(cases)
    values = np.full((len(groups), len(grid)), np.nan)
    for row, group in zip(values, groups, strict=True):
        at = np.searchsorted(grid, [float(case.at[axis]) for case in group])
        row[at] = column(group, metric, phase)
    return grid, values
