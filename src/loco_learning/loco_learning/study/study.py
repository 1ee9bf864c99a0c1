# SPDX-License-Identifier: Apache-2.0
"""Studies: variants of an experiment times grid times seeds, on a pool, each case resumable."""

from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_control.reading import understood

from ..jobs import pool
from ..metrics.registry import METRICS
from ..params import PHASES
from ..plain import Collection
from ..runs import experiment as experiments
from ..runs.experiment import Experiment, override
from . import grid
from .case import CLOCKED, REJECTED, Case, CaseResult, run_case
from .figures import FIGURES

log = logging.getLogger(__name__)

FILES = Collection(
    "study", "studies",
    ("extends", "name", "description", "variants", "axes", "seeds", "phase", "metrics", "figures",
     "map", "overrides"),
)  # fmt: skip
names = FILES.names
TIMED = 3  # cases that run first, to estimate the cost of the rest


@dataclass(frozen=True)
class Study:
    """A study from a checked file.

    `origins` has the experiment from which each variant is derived, and its changes.
    """

    name: str
    description: str
    variants: dict[str, Experiment]
    seeds: tuple[int, ...]
    phase: str  # phase of the metrics in the table
    metrics: tuple[str, ...]  # columns of the table
    figures: tuple[str, ...]
    axes: tuple[grid.Axis, ...] = ()
    map: grid.MapSpec | None = None
    origins: dict[str, tuple[str, dict[str, Any]]] = dataclasses.field(default_factory=dict)

    def cases(self) -> Iterator[Case]:
        """All variants at all points of the grid with all seeds.

        In a grid, a variant without any random draw runs with the first seed only.
        """
        configurations = {name: json.dumps(to_dict(each)) for name, each in self.variants.items()}
        for k, seed in enumerate(self.seeds):
            for name, experiment in self.variants.items():
                if k and self.axes and not experiment.draws:
                    continue
                for point in grid.points(self.axes):
                    yield Case(name, seed, experiment, self.axes, point, configurations[name])

    def with_points(self, counts: int | dict[str, int]) -> Study:
        """Copy of the grid with other numbers of points; axes with listed values are unchanged.

        Args:
            counts: Points of every axis, or by its name.
        """
        axes = tuple(
            axis.with_points(counts if isinstance(counts, int) else counts[axis.name])
            if isinstance(counts, int) or axis.name in counts else axis
            for axis in self.axes
        )  # fmt: skip
        return dataclasses.replace(self, axes=axes)


@dataclass(frozen=True)
class Cost:
    """Time that a study will take, estimated from timed cases."""

    timed: int  # number of timed cases
    seconds: float  # their mean processor time [s]
    missing: int  # number of cases still to run

    def __str__(self) -> str:
        hours = self.seconds * self.missing / 3600.0
        return (
            f"{self.missing} runs to go, about {self.seconds:.2f} s of processor time each (mean "
            f"of {self.timed} spread over the grid): {hours:.2g} core-hours"
        )


@understood("whole study")
def load(
    name_or_path: str | Path,
    seeds: tuple[int, ...] | None = None,
    overrides: dict[str, Any] | None = None,
) -> Study:
    """Read a study.

    Args:
        name_or_path: One of `names()`, or a path that ends in ``.yaml``.
        seeds: Seeds that replace those of the file.
        overrides: Values by dotted name for every variant, such as ``{"learner.test": 5}``.

    Raises:
        NameUnknownError: The study, or an experiment, metric, figure or key, does not exist.
        MissingFileError: The file does not exist.
        ParameterError: Broken YAML or an invalid value.
    """
    path = FILES.find(name_or_path)
    values = FILES.read(path, lambda base, values: {**base, **values})
    variants = values.get("variants")
    if not isinstance(variants, dict) or not variants:
        raise ParameterError(f"{path.stem}.variants must name at least one experiment")
    changes = {**values.get("overrides", {}), **(overrides or {})}
    variants_by_name = {str(k): _variant(path, str(k), v, changes) for k, v in variants.items()}
    axes = grid.read_axes(values.get("axes", {}), path.stem)
    for experiment in variants_by_name.values() if axes else ():  # both ends of each axis are legal
        for end in (0, -1):
            point = tuple(end % len(axis.values) for axis in axes)
            override(experiment, grid.settings(axes, point))
    return Study(
        name=str(values.get("name", path.stem)),
        description=str(values.get("description", "")),
        variants=variants_by_name,
        seeds=_seeds(path, values.get("seeds", [0]) if seeds is None else seeds),
        phase=_all_known("phase", [values.get("phase", "test")], PHASES)[0],
        metrics=_all_known("metric", values.get("metrics", ["nrmse", "speed"]), METRICS),
        figures=_all_known("figure", values.get("figures", []), FIGURES),
        axes=axes,
        map=grid.read_map(values.get("map"), axes, path.stem, METRICS),
        origins={str(k): (str(v["experiment"]), {**v, **changes}) for k, v in variants.items()},
    )


def run(
    study: Study,
    folder: str | Path,
    workers: int = 2,
    progress: Callable[[int, int, CaseResult], None] | None = None,
    scheduler: str = "",
    on_cost: Callable[[Cost], bool | None] | None = None,
) -> list[CaseResult]:
    """Run the missing cases of a study and return the results of all its cases in order.

    A case is complete if its file in `folder` is from the same experiment and
    seed; files are written completely or not at all, so a study can be interrupted at any time.

    Args:
        study: The study.
        folder: Folder of the results, one ``.npz`` per case.
        workers: Number of processes; 1 runs in this process.
        progress: Called with the numbers of finished and of all cases, and the latest result.
        scheduler: Address of a dask scheduler to use instead of child processes.
        on_cost: Called with the cost of the rest after `TIMED` cases spread over the missing
            ones; if it returns False, the study ends with the results so far.
    """
    folder = Path(folder)
    cases = list(study.cases())
    old = {case.name: _stored(folder, case) for case in cases}
    timed = CLOCKED in study.metrics
    done = {
        name: result for name, result in old.items()
        if result and REJECTED not in result.verdict["failed"]
        and not (timed and any(CLOCKED not in row for row in result.metrics.values()))
    }  # fmt: skip
    missing = [case for case in cases if case.name not in done]
    first = _spread_over(missing) if on_cost else []
    remaining = [case for case in missing if case not in first]
    several, curves = min(workers, len(missing)), bool(study.figures)
    place = pool.start(
        run_case, workers=several if several > 1 else 0, scheduler=scheduler if missing else ""
    )
    with place as jobs:
        folder.mkdir(parents=True, exist_ok=True)
        for batch in (first, remaining):
            for _, result in jobs.results([(case, curves, timed) for case in batch]):
                result.save(folder / f"{result.name}.npz")
                done[result.name] = result
                if progress:
                    progress(len(done), len(cases), result)
            if first and remaining and batch is first and on_cost:
                seconds = sum(done[c.name].seconds for c in first) / len(first)
                if on_cost(Cost(len(first), seconds, len(remaining))) is False:
                    break
    return [done[case.name] for case in cases if case.name in done]


def _spread_over(cases: list[Case]) -> list[Case]:
    """`TIMED` cases from the start, the middle and the end; none of few cases."""
    count = len(cases)
    return [cases[(2 * k + 1) * count // (2 * TIMED)] for k in range(TIMED) if count >= 4 * TIMED]


def stored(study: Study, folder: str | Path) -> list[CaseResult]:
    """Available results of a study, including refused cases, in the order of its cases."""
    results = (_stored(Path(folder), case) for case in study.cases())
    return [result for result in results if result]


def _stored(folder: Path, case: Case) -> CaseResult | None:
    path = folder / f"{case.name}.npz"
    if not path.is_file():
        return None
    try:
        result = CaseResult.load(path)
    except ParameterError as error:
        log.warning("%s is run again: %s", case.name, error)
        return None
    return result if result.key == case.key else None


def _variant(path: Path, name: str, spec: Any, changes: dict[str, Any]) -> Experiment:
    if not isinstance(spec, dict) or "experiment" not in spec:
        raise ParameterError(f"{path.stem}.variants.{name} must be {{experiment: NAME, ...}}")
    changes_of_variant = {key: value for key, value in spec.items() if key != "experiment"}
    base = str(spec["experiment"])
    if base.endswith((".yaml", ".yml")):
        base = str(path.parent / base)
    experiment = experiments.load(base)
    if experiment.node_set == "msd":
        raise ParameterError(
            f"{path.stem}.variants.{name}: a study runs robots; "
            f"{base} is of masses and springs, whose studies are `loco reproduce msd`"
        )
    return experiments.load(base, {**changes_of_variant, **changes})  # defaults follow its robot


def _seeds(path: Path, seeds: Any) -> tuple[int, ...]:
    all_integers = isinstance(seeds, (list, tuple)) and seeds and all(type(s) is int for s in seeds)
    if not all_integers or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise ParameterError(
            f"{path.stem}.seeds must be a list of different whole numbers from 0, got {seeds!r}"
        )
    return tuple(seeds)


def _all_known(kind: str, requested: Any, names: Any) -> tuple[str, ...]:
    for name in requested:
        if name not in names:
            raise NameUnknownError(kind, str(name), names)
    return tuple(map(str, requested))
