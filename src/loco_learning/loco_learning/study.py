# SPDX-License-Identifier: Apache-2.0
"""A study: experiment variants times seeds, run on a pool, each case resumable."""

from __future__ import annotations

import importlib.resources
import json
import logging
import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.params import to_dict

from . import experiment as experiments
from .case import CaseResult, run_case
from .experiment import Experiment, override, read_yaml
from .mortal import end_with_parent
from .params import PHASES

if TYPE_CHECKING:
    from .joint_experiment import JointExperiment

log = logging.getLogger(__name__)

KEYS = ("name", "description", "variants", "seeds", "phase", "metrics", "figures", "overrides")


@dataclass(frozen=True)
class Case:
    """One run of a study."""

    variant: str
    seed: int
    experiment: Experiment | JointExperiment

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.variant}_{self.seed}"


@dataclass(frozen=True)
class Study:
    """What a study file says, checked."""

    name: str
    description: str
    variants: dict[str, Experiment | JointExperiment]
    seeds: tuple[int, ...]
    phase: str  # whose metrics the table shows
    metrics: tuple[str, ...]  # columns of the table
    figures: tuple[str, ...]

    def cases(self) -> Iterator[Case]:
        """All variants with all seeds."""
        for seed in self.seeds:
            for variant, experiment in self.variants.items():
                yield Case(variant, seed, experiment)


def names() -> list[str]:
    """Names of the studies that come with the package."""
    return sorted(path.name[:-5] for path in _folder().iterdir() if path.name.endswith(".yaml"))


def load(
    name_or_path: str | Path,
    seeds: tuple[int, ...] | None = None,
    overrides: dict[str, Any] | None = None,
) -> Study:
    """Read a study.

    Args:
        name_or_path: One of `names()`, or a path that ends in ``.yaml``.
        seeds: Instead of those of the file.
        overrides: Values by dotted name for every variant, such as ``{"learner.test": 5}``.

    Raises:
        NameUnknownError: No such study, experiment, metric, figure or key.
        MissingFileError: No such file.
        ParameterError: Broken YAML or a wrong value.
    """
    path = _find(name_or_path)
    values = read_yaml(path)
    for key in values:
        if key not in KEYS:
            raise NameUnknownError(f"key in study {path.stem}", key, KEYS)
    variants = values.get("variants")
    if not isinstance(variants, dict) or not variants:
        raise ParameterError(f"{path.stem}.variants must name at least one experiment")
    changes = {**values.get("overrides", {}), **(overrides or {})}
    return Study(
        name=str(values.get("name", path.stem)),
        description=str(values.get("description", "")),
        variants={str(k): _variant(path, str(k), v, changes) for k, v in variants.items()},
        seeds=_seeds(path, values.get("seeds", [0]) if seeds is None else seeds),
        phase=_known("phase", values.get("phase", "test"), PHASES),
        metrics=_metrics(values.get("metrics", ["nrmse", "speed"])),
        figures=_figures(values.get("figures", [])),
    )


def run(
    study: Study,
    folder: str | Path,
    workers: int = 2,
    progress: Callable[[int, int, CaseResult], None] | None = None,
) -> list[CaseResult]:
    """Run what is missing of a study and return the results of all its cases in order.

    A case is done when its file in `folder` was made by the same experiment and
    seed; files are written whole or not at all, so a study can be stopped anywhere.

    Args:
        study: What to run.
        folder: Where the results lie, one ``.npz`` per case.
        workers: Processes; 1 runs in this process.
        progress: Called with cases done, cases in all and the newest result.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    cases = list(study.cases())
    done = {case.name: old for case in cases if (old := _stored(folder, case))}
    count = len(done)
    missing = [case for case in cases if case.name not in done]
    for result in _results(missing, folder, workers):
        count += 1
        done[result.name] = result
        if progress:
            progress(count, len(cases), result)
    return [done[case.name] for case in cases]


def _results(cases: list[Case], folder: Path, workers: int) -> Iterator[CaseResult]:
    if workers <= 1 or len(cases) <= 1:
        for case in cases:
            yield run_case(case.name, case.variant, case.seed, case.experiment, folder)
        return
    # Children of a fork would share the state of DDS threads; and more than one BLAS thread
    # per process costs milliseconds a step.
    context = multiprocessing.get_context("spawn")
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    with ProcessPoolExecutor(min(workers, len(cases)), context, end_with_parent) as pool:
        futures = [
            pool.submit(run_case, case.name, case.variant, case.seed, case.experiment, folder)
            for case in cases
        ]
        for future in as_completed(futures):
            yield future.result()


def _stored(folder: Path, case: Case) -> CaseResult | None:
    path = folder / f"{case.name}.npz"
    if not path.is_file():
        return None
    try:
        result = CaseResult.load(path)
    except ParameterError as error:
        log.warning("%s is run again: %s", case.name, error)
        return None
    same = json.dumps(to_dict(case.experiment)) == json.dumps(result.experiment)
    return result if same and result.seed == case.seed else None


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


def _variant(
    path: Path, name: str, spec: Any, changes: dict[str, Any]
) -> Experiment | JointExperiment:
    if not isinstance(spec, dict) or "experiment" not in spec:
        raise ParameterError(f"{path.stem}.variants.{name} must be {{experiment: NAME, ...}}")
    own = {key: value for key, value in spec.items() if key != "experiment"}
    base = str(spec["experiment"])
    if base.endswith((".yaml", ".yml")):
        base = str(path.parent / base)
    experiment = experiments.load(base)
    if experiment.node_set == "msd":
        raise ParameterError(
            f"{path.stem}.variants.{name}: a study runs experiments of kind hyq or joint; "
            f"{base} is of kind msd, whose studies are `loco reproduce msd`"
        )
    return override(experiment, {**own, **changes})


def _seeds(path: Path, seeds: Any) -> tuple[int, ...]:
    whole = isinstance(seeds, (list, tuple)) and seeds and all(type(s) is int for s in seeds)
    if not whole or len(set(seeds)) != len(seeds) or min(seeds) < 0:
        raise ParameterError(
            f"{path.stem}.seeds must be a list of different whole numbers from 0, got {seeds!r}"
        )
    return tuple(seeds)


def _known(kind: str, name: Any, known: Any) -> str:
    if name not in known:
        raise NameUnknownError(kind, str(name), known)
    return str(name)


def _metrics(wanted: Any) -> tuple[str, ...]:
    from . import joint_metrics, metrics

    known = {**metrics.METRICS, **joint_metrics.METRICS}
    return tuple(_known("metric", name, known) for name in wanted)


def _figures(wanted: Any) -> tuple[str, ...]:
    from .figures import FIGURES

    return tuple(_known("figure", name, FIGURES) for name in wanted)
