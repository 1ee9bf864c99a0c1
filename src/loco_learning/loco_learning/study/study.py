# SPDX-License-Identifier: Apache-2.0
"""Studies: variants of an experiment times grid times seeds, on a pool, each case resumable."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.resources
import json
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_control.reading import understood

from ..jobs import pool
from ..metrics.registry import METRICS
from ..params import PHASES
from ..plain import read_yaml
from ..runs import experiment as experiments
from ..runs.experiment import Experiment, override
from . import grid
from .case import CLOCKED, REFUSED, CaseResult, run_case

log = logging.getLogger(__name__)

KEYS = (
    "extends", "name", "description", "variants", "axes", "seeds", "phase", "metrics", "figures",
    "map", "overrides",
)  # fmt: skip
TIMED = 3  # cases that run first, to estimate the cost of the rest


@dataclass(frozen=True)
class Case:
    """One run of a study."""

    variant: str
    seed: int
    base: Experiment
    axes: tuple[grid.Axis, ...] = ()
    point: tuple[int, ...] = ()
    text: str = ""  # the variant as JSON, if already computed

    @property
    def name(self) -> str:
        """Name of the case and of its file."""
        return "_".join([self.variant, *(f"{i:02d}" for i in self.point), str(self.seed)])

    @property
    def at(self) -> dict[str, Any]:
        """Position in the grid: value by axis."""
        return {axis.name: axis.values[i] for axis, i in zip(self.axes, self.point, strict=True)}

    @property
    def settings(self) -> dict[str, Any]:
        """Values of the grid, by dotted name."""
        return grid.settings(self.axes, self.point)

    @cached_property
    def experiment(self) -> Experiment:
        """The variant with the settings of the grid."""
        return override(self.base, self.settings) if self.axes else self.base

    @property
    def key(self) -> str:
        """Digest of all inputs of the run."""
        content = json.dumps([self.text or _text(self.base), self.settings, self.seed])
        return hashlib.sha256(content.encode()).hexdigest()[:16]


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
        text_by_name = {name: _text(experiment) for name, experiment in self.variants.items()}
        for k, seed in enumerate(self.seeds):
            for name, experiment in self.variants.items():
                if k and self.axes and not experiment.draws:
                    continue
                for point in grid.points(self.axes):
                    yield Case(name, seed, experiment, self.axes, point, text_by_name[name])

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


def _text(experiment: Experiment) -> str:
    return json.dumps(to_dict(experiment))


def names() -> list[str]:
    """Names of the studies in the package."""
    return sorted(path.name[:-5] for path in _folder().iterdir() if path.name.endswith(".yaml"))


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
    path = _find(name_or_path)
    values = _read(path)
    variants = values.get("variants")
    if not isinstance(variants, dict) or not variants:
        raise ParameterError(f"{path.stem}.variants must name at least one experiment")
    changes = {**values.get("overrides", {}), **(overrides or {})}
    variants_by_name = {str(k): _variant(path, str(k), v, changes) for k, v in variants.items()}
    axes = grid.read_axes(values.get("axes", {}), path.stem)
    _try(variants_by_name, axes)
    return Study(
        name=str(values.get("name", path.stem)),
        description=str(values.get("description", "")),
        variants=variants_by_name,
        seeds=_seeds(path, values.get("seeds", [0]) if seeds is None else seeds),
        phase=_known("phase", values.get("phase", "test"), PHASES),
        metrics=_metrics(values.get("metrics", ["nrmse", "speed"])),
        figures=_figures(values.get("figures", [])),
        axes=axes,
        map=grid.read_map(values.get("map"), axes, path.stem, METRICS),
        origins={str(k): (str(v["experiment"]), {**v, **changes}) for k, v in variants.items()},
    )


def _try(variants: dict[str, Experiment], axes: tuple[grid.Axis, ...]) -> None:
    """Make the experiments at both ends of each axis, which raises an error if they are invalid."""
    if not axes:
        return
    first, last = tuple(0 for _ in axes), tuple(len(axis.values) - 1 for axis in axes)
    for experiment in variants.values():
        for point in (first, last):
            override(experiment, grid.settings(axes, point))


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
        if result and REFUSED not in result.verdict["failed"]
        and not (timed and any(CLOCKED not in row for row in result.metrics.values()))
    }  # fmt: skip
    missing = [case for case in cases if case.name not in done]
    first = [missing[i] for i in _repeat(len(missing))] if on_cost else []
    remaining = [case for case in missing if case not in first]
    several, curves = min(workers, len(missing)), bool(study.figures)
    place = pool.start(
        run_case, workers=several if several > 1 else 0, scheduler=scheduler if missing else ""
    )
    with place as jobs:
        folder.mkdir(parents=True, exist_ok=True)
        for batch in (first, remaining):
            arguments = [
                (c.name, c.variant, c.seed, c.base, c.settings, c.at, c.key, curves, timed)
                for c in batch
            ]
            for _, result in jobs.results(arguments):
                result.save(folder / f"{result.name}.npz")
                done[result.name] = result
                if progress:
                    progress(len(done), len(cases), result)
            if first and remaining and batch is first and on_cost:
                seconds = sum(done[c.name].seconds for c in first) / len(first)
                if on_cost(Cost(len(first), seconds, len(remaining))) is False:
                    break
    return [done[case.name] for case in cases if case.name in done]


def _repeat(count: int) -> list[int]:
    """Indices of `TIMED` cases from the start, the middle and the end; empty for few cases."""
    if count < 4 * TIMED:
        return []
    return [(2 * k + 1) * count // (2 * TIMED) for k in range(TIMED)]


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


def _read(path: Path, after: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Values of a study file; its keys replace those of the study that it extends."""
    path = path.resolve()
    if path in after:
        names = " > ".join(p.stem for p in (*after, path))
        raise ParameterError(f"study {path} extends itself: {names}")
    values = read_yaml(path)
    for key in values:
        if key not in KEYS:
            raise NameUnknownError(f"key in study {path.stem}", key, KEYS)
    base = values.pop("extends", None)
    if base is None:
        return values
    if not isinstance(base, str):
        raise ParameterError(f"{path}: extends must be the name of a study, got {base!r}")
    adjacent = path.parent / base
    return {**_read(_find(adjacent if adjacent.is_file() else base), (*after, path)), **values}


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text.endswith((".yaml", ".yml")):
        if not Path(text).is_file():
            raise MissingFileError(f"no study file {text}")
        return Path(text)
    if text not in names():
        raise NameUnknownError("study", text, names())
    return Path(str(_folder() / f"{text}.yaml"))


def _folder() -> Any:
    return importlib.resources.files("loco_learning") / "studies"


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
    return override(experiment, {**changes_of_variant, **changes})


def _seeds(path: Path, seeds: Any) -> tuple[int, ...]:
    all_integers = isinstance(seeds, (list, tuple)) and seeds and all(type(s) is int for s in seeds)
    if not all_integers or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise ParameterError(
            f"{path.stem}.seeds must be a list of different whole numbers from 0, got {seeds!r}"
        )
    return tuple(seeds)


def _known(kind: str, name: Any, names: Any) -> str:
    if name not in names:
        raise NameUnknownError(kind, str(name), names)
    return str(name)


def _metrics(requested: Any) -> tuple[str, ...]:
    return tuple(_known("metric", name, METRICS) for name in requested)


def _figures(requested: Any) -> tuple[str, ...]:
    from .figures import FIGURES

    return tuple(_known("figure", name, FIGURES) for name in requested)
