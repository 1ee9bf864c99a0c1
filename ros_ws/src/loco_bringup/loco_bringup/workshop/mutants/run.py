# SPDX-License-Identifier: Apache-2.0
"""Runs the tests of a module on each of its mutants: `loco mutants`."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml

from loco_control.exceptions import LocoError, MissingFileError
from loco_control.files import write_whole

from .mutate import Mutant, mutants

ROOTS = ("src/loco_control", "src/loco_sim", "src/loco_learning", "ros_ws/src/loco_bringup")
# Modules that protect a robot or a recording, with the tests that must notice a change.
PROTECTING: dict[str, tuple[str, ...]] = {
    "src/loco_sim/loco_sim/plant/safety.py": ("tests/loco_sim/plant/test_safety.py",),
    "src/loco_sim/loco_sim/plant/fallback.py": ("tests/loco_sim/plant/test_fallback.py",),
    "src/loco_sim/loco_sim/ros/estop.py": ("tests/ros/test_estop.py",),
    "src/loco_sim/loco_sim/ros/plant_node.py": (
        "tests/ros/test_plant_node.py", "tests/ros/test_plant_clock.py", "tests/ros/test_estop.py",
    ),
    "src/loco_sim/loco_sim/robot/urdf_check.py": ("tests/loco_sim/robot/test_urdf_check.py",),
    "src/loco_control/loco_control/reading.py": ("tests/loco_control/test_reading.py",),
    "src/loco_control/loco_control/files.py": ("tests/loco_control/test_files.py",),
    "ros_ws/src/loco_bringup/loco_bringup/graph/guard.py": (
        "tests/loco_bringup/graph/test_guard.py",
    ),
    "ros_ws/src/loco_bringup/loco_bringup/bag/recover.py": (
        "tests/loco_bringup/bag/test_recover.py",
    ),
}  # fmt: skip
# Mutants that behave as the original does, by module and `Mutant.key`, and why.
EQUIVALENT: dict[str, dict[str, str]] = yaml.safe_load(
    Path(__file__).with_name("equivalent.yaml").read_text(encoding="utf-8")
)
PATIENCE = 5.0  # a mutant may take this many times as long as the original, before it is killed


@dataclass(frozen=True)
class Verdict:
    """End of one mutant.

    Attributes:
        module: Path of the module from the root of the clone.
        line: Line of the change.
        change: Function, and what became of what.
        end: ``killed``, ``timeout``, ``survived`` or ``equivalent``.
        seconds: Wall time of its tests [s].
    """

    module: str
    line: int
    change: str
    end: str
    seconds: float


def survey(
    root: Path,
    modules: list[str],
    limit: int,
    seed: int,
    workers: int,
    tell: Callable[[Verdict], None],
) -> list[Verdict]:
    """Test mutants of modules.

    Args:
        root: Root of the clone.
        modules: Keys of `PROTECTING`.
        limit: Largest number of mutants of each module, drawn at random; 0 is all.
        seed: Seed of the draw.
        workers: Mutants that are tested at a time.
        tell: Called with each verdict.

    Raises:
        MissingFileError: This is an installed package, not a clone.
        LocoError: The tests of a module fail without a change.
    """  # fmt: skip
    if not (root / "tests").is_dir():
        raise MissingFileError(f"no tests folder in {root}; run this from a clone")
    verdicts = []
    for module in modules:
        text = (root / module).read_text(encoding="utf-8")
        with _copy(root) as copy:
            allowed = PATIENCE * _baseline(root, copy, module)
        drawn = mutants(text)
        if 0 < limit < len(drawn):
            drawn = sorted(random.Random(seed).sample(drawn, limit), key=lambda m: m.line)
        with ThreadPoolExecutor(workers) as pool:
            jobs = [pool.submit(_judge, root, module, each, allowed) for each in drawn]
            for job in jobs:
                verdicts.append(job.result())
                tell(verdicts[-1])
    return verdicts


def _judge(root: Path, module: str, mutant: Mutant, allowed: float) -> Verdict:
    if mutant.key in EQUIVALENT.get(module, {}):
        return Verdict(module, mutant.line, mutant.key, "equivalent", 0.0)
    with _copy(root) as copy:
        (copy / module).write_text(mutant.text, encoding="utf-8")
        began = time.perf_counter()
        try:
            end = "killed" if _tests(root, copy, module, allowed) else "survived"
        except subprocess.TimeoutExpired:
            end = "timeout"
    return Verdict(module, mutant.line, mutant.key, end, time.perf_counter() - began)


def _baseline(root: Path, copy: Path, module: str) -> float:
    """Seconds that the tests take without a change, kernels compiled."""
    for _ in range(2):
        began = time.perf_counter()
        if _tests(root, copy, module, 600.0):
            raise LocoError(
                f"the tests of {module} fail without a change: {' '.join(PROTECTING[module])}"
            )
    return time.perf_counter() - began + 10.0


def _tests(root: Path, copy: Path, module: str, allowed: float) -> int:
    """Exit code of the tests of a module, with the sources of a copy."""
    path = os.pathsep.join(str(copy / each) for each in ROOTS)
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider",
               *PROTECTING[module]]  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    run = subprocess.Popen(
        command, cwd=root, env=environment, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        return run.wait(timeout=allowed)
    finally:
        if run.poll() is None:
            os.killpg(run.pid, 9)
            run.wait()


@contextmanager
def _copy(root: Path) -> Iterator[Path]:
    """Copy of the packages' sources, with what numba has compiled."""
    with tempfile.TemporaryDirectory(prefix="loco_mutant_") as folder:
        for each in ROOTS:
            shutil.copytree(root / each, Path(folder) / each, symlinks=True)
        yield Path(folder)


def score(verdicts: list[Verdict]) -> float:
    """Share of the mutants that some test noticed, equivalent ones left out."""
    counted = [v for v in verdicts if v.end != "equivalent"]
    return sum(v.end != "survived" for v in counted) / len(counted) if counted else 1.0


def write(verdicts: list[Verdict], folder: Path) -> None:
    """`mutants.json`, and `mutants.md` with a table per module and the survivors."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "mutants.json", json.dumps([asdict(v) for v in verdicts], indent=1) + "\n")
    lines = [
        "| module | mutants | killed | equivalent | score |",
        "| --- | --- | --- | --- | --- |",
    ]
    for module in dict.fromkeys(v.module for v in verdicts):
        rows = [v for v in verdicts if v.module == module]
        same = sum(v.end == "equivalent" for v in rows)
        dead = sum(v.end in ("killed", "timeout") for v in rows)
        lines.append(f"| {module} | {len(rows)} | {dead} | {same} | {100 * score(rows):.0f} % |")
    survivors = [f"- {v.module}:{v.line} `{v.change}`" for v in verdicts if v.end == "survived"]
    text = "\n".join([*lines, "", "Survivors:", "", *(survivors or ["none"])])
    write_whole(folder / "mutants.md", text + "\n")
