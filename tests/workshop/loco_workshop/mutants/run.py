# SPDX-License-Identifier: Apache-2.0
"""`loco mutants`: run the tests of a module on each of its mutants."""

from __future__ import annotations

import hashlib
import json
import random
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Queue

import yaml

from loco_control.exceptions import LocoError, MissingFileError
from loco_control.files import write_whole
from loco_learning.jobs.journal import Journal

from . import nursery
from .mutate import Mutant, by_hand, mutants

# Modules that decide on the name of an effect and prevent false ones, by folder of the gap.
_NAMING = {
    "verdict": (
        "decide", "doubt", "estimates", "judge", "rivals", "rounding", "scale", "sensitivity",
        "stable", "traded",
    ),
    "probability": ("prices", "weights"),
    "statistics": (
        "evidence", "free", "identify", "leftover", "noise", "profile", "robust", "solve",
    ),
    "fitting": ("fit", "residual", "screen", "search", "seen"),
}  # fmt: skip
# Modules that protect a robot, a recording or a verdict, with the tests that must detect changes.
PROTECTING: dict[str, tuple[str, ...]] = {
    "src/loco_sim/loco_sim/plant/safety.py": ("tests/loco_sim/plant/test_safety.py",),
    "src/loco_sim/loco_sim/plant/fallback.py": ("tests/loco_sim/plant/test_fallback.py",),
    "src/loco_sim/loco_sim/ros/estop.py": ("tests/ros/test_estop.py",),
    "src/loco_sim/loco_sim/ros/plant_node.py": (
        "tests/ros/test_plant_tick.py", "tests/ros/test_plant_node.py",
        "tests/ros/test_plant_clock.py", "tests/ros/test_estop.py",
    ),
    "src/loco_sim/loco_sim/ros/driver_node.py": ("tests/ros/test_driver_node.py",),
    "src/loco_sim/loco_sim/hardware/dynamixel.py": ("tests/loco_sim/hardware/test_dynamixel.py",),
    "src/loco_sim/loco_sim/hardware/wiring.py": ("tests/loco_sim/hardware/test_wiring.py",),
    "src/loco_sim/loco_sim/robot/urdf_check.py": ("tests/loco_sim/robot/test_urdf_check.py",),
    "src/loco_control/loco_control/ros/join.py": ("tests/ros/test_join.py",),
    "src/loco_control/loco_control/reading.py": ("tests/loco_control/test_reading.py",),
    "src/loco_control/loco_control/files.py": ("tests/loco_control/test_files.py",),
    "ros_ws/src/loco_bringup/loco_bringup/graph/guard.py": (
        "tests/loco_bringup/graph/test_guard.py",
    ),
    "ros_ws/src/loco_bringup/loco_bringup/bag/recover.py": (
        "tests/loco_bringup/bag/test_recover.py",
    ),
    **{
        f"src/loco_learning/loco_learning/gap/{folder}/{name}.py": (
            f"tests/loco_learning/gap/{folder}/test_{name}.py",
        )
        for folder, names in _NAMING.items()
        for name in names
    },
}  # fmt: skip
# Mutants that behave like the original, by module and `Mutant.key`, with the reason.
EQUIVALENT: dict[str, dict[str, str]] = yaml.safe_load(
    Path(__file__).with_name("equivalent.yaml").read_text(encoding="utf-8")
)
# Mutants made by hand, by module and fault: old text, new text and, if it survives, the reason.
BY_HAND: dict[str, dict[str, list[str]]] = yaml.safe_load(
    Path(__file__).with_name("by_hand.yaml").read_text(encoding="utf-8")
)
NOTICED = ("killed", "timeout")
# Result by exit code of pytest; 2: the tests could not be imported. Negative: a signal.
_END = {"0": "survived", "1": "killed", "2": "killed", "timeout": "timeout"}
LONG = 60.0  # wall time of tests [s] above which compilation does not matter
PATIENCE = 5.0  # time-out of a mutant, in multiples of the original's duration


@dataclass(frozen=True)
class Verdict:
    """Result of one mutant.

    Attributes:
        module: Path of the module relative to the root of the clone.
        line: Line of the change.
        change: Function, and source before and after the change.
        end: ``killed``, ``timeout``, ``survived``, ``equivalent``, or ``error`` if pytest itself
            failed or found no test.
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
    journal: Journal,
    tell: Callable[[Verdict], None],
    survivors: bool = False,
    only_by_hand: bool = False,
) -> list[Verdict]:
    """Test mutants of modules.

    A mutant that the module's own tests do not detect survives if no test of `elsewhere` does.

    Args:
        root: Root of the clone.
        modules: Keys of `PROTECTING`.
        limit: Largest number of mutants in all modules together, drawn at random; 0 for all.
        seed: Seed of the draw.
        workers: Number of mutants tested in parallel.
        journal: Earlier verdicts of the same modules and tests, which are not repeated.
        tell: Called with each verdict.
        survivors: Whether earlier verdicts ``killed`` remain valid after a change of the tests.
        only_by_hand: Whether to test the mutants made by hand alone.

    Raises:
        MissingFileError: This is an installed package, not a clone.
        LocoError: The tests of a module fail on the unchanged module.
    """  # fmt: skip
    if not (root / "tests").is_dir():
        raise MissingFileError(f"no tests folder in {root}; run this from a clone")
    verdicts, made = [], []
    for module in modules:
        text = (root / module).read_text(encoding="utf-8")
        of_module = by_hand(text, BY_HAND.get(module, {}))
        of_module += [] if only_by_hand else mutants(text)
        made += [(module, mutant) for mutant in of_module]
    if 0 < limit < len(made):
        made = random.Random(seed).sample(made, limit)
    for module in modules:
        drawn = sorted((each for of, each in made if of == module), key=lambda m: m.line)
        others = elsewhere(root, module) if drawn else ()
        source, tests = _digest(root, [module]), _digest(root, [*PROTECTING[module], *others])
        by_change = {
            row["change"]: row["end"] for row in journal.rows
            if row["module"] == module and row["source"] == source
            and (row["tests"] == tests or (survivors and row["end"] in NOTICED))
        } | dict.fromkeys(EQUIVALENT.get(module, {}), "equivalent")  # fmt: skip
        for chosen in (PROTECTING[module], others):
            left = []
            for mutant, verdict in _judged(root, module, chosen, drawn, workers, by_change):
                is_new = verdict.change not in by_change
                if is_new and verdict.end == "survived" and others and chosen is not others:
                    left.append(mutant)
                    continue
                if is_new:
                    journal.append({**asdict(verdict), "source": source, "tests": tests})
                verdicts.append(verdict)
                tell(verdict)
            drawn = left
    return verdicts


def elsewhere(root: Path, module: str) -> tuple[str, ...]:
    """Other tests that concern a module: in the folder named as its own, and those that import it.

    Args:
        root: Root of the clone.
        module: Key of `PROTECTING`.
    """
    own, top = PROTECTING[module], (root / module).parent
    while (top / "__init__.py").exists():
        top = top.parent
    *package, name = (root / module).relative_to(top).with_suffix("").parts
    dotted = re.escape(".".join(package))
    imports = re.compile(rf"^ *(from|import) {dotted}(\.{name}\b| import .*\b{name}\b)", re.M)
    folder = Path(root, "tests", *package)
    found = [
        path.relative_to(root).as_posix() for path in sorted((root / "tests").rglob("test_*.py"))
        if path.parent == folder or imports.search(path.read_text(encoding="utf-8"))
    ]  # fmt: skip
    return tuple(path for path in found if path not in own)


def _digest(root: Path, paths: Iterable[str]) -> str:
    contents = [(root / path).read_bytes() for path in paths]
    return hashlib.sha256(b"\0".join(contents)).hexdigest()[:16]


def _judged(
    root: Path, module: str, tests: tuple[str, ...], drawn: list[Mutant], workers: int,
    known: dict[str, str],
) -> Iterator[tuple[Mutant, Verdict]]:  # fmt: skip
    """Verdicts of tests about mutants in order; known verdicts are not repeated."""
    with ExitStack() as stack:
        free: Queue[Nursery] = Queue()
        missing = [each for each in drawn if each.key not in known]
        for _ in range(min(workers, len(missing))):
            free.put(stack.enter_context(Nursery(root, module, tests)))
        if missing:
            first = free.get()
            allowed = _patience(first, tests, (root / module).read_text(encoding="utf-8"))
            free.put(first)

        def judge(mutant: Mutant) -> Verdict:
            end, began = known.get(mutant.key, ""), time.perf_counter()
            if not end:
                nursery = free.get()
                end = _END.get(answer := nursery.ask(mutant.text, allowed), "")
                end = end or ("killed" if answer.startswith("-") else "error")
                free.put(nursery)
            seconds = time.perf_counter() - began
            return Verdict(module, mutant.line, mutant.key, end, round(seconds, 3))

        with ThreadPoolExecutor(workers) as pool:
            yield from zip(drawn, pool.map(judge, drawn), strict=True)


def _patience(nursery: Nursery, tests: tuple[str, ...], text: str) -> float:
    """Time-out of a mutant [s]: a multiple of the original's time, after compilation."""
    for _ in range(2):
        began = time.perf_counter()
        if (end := nursery.ask(text, 1800.0)) != "0":
            raise LocoError(f"tests fail without a change ({end}): {' '.join(tests)}")
        seconds = time.perf_counter() - began
        if seconds > LONG:
            break
    return PATIENCE * (seconds + 2.0)


class Nursery:
    """Client of a fork server that tests mutants (`nursery.py`).

    Args:
        root: Root of the clone.
        module: Key of `PROTECTING`.
        tests: Test files, in the order in which they run.
    """

    def __init__(self, root: Path, module: str, tests: tuple[str, ...]):
        command = [sys.executable, "-m", nursery.__name__, str(root), module, *tests]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            start_new_session=True,
        )  # fmt: skip

    def __enter__(self) -> Nursery:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def ask(self, text: str, allowed: float) -> str:
        """Result of pytest for a source, or ``timeout`` after `allowed` seconds."""
        requests, replies = self._process.stdin, self._process.stdout
        requests.write(json.dumps({"text": text, "allowed": allowed}) + "\n")
        requests.flush()
        return replies.readline().strip()


def score(verdicts: list[Verdict]) -> float:
    """Share of mutants that a test detected, without equivalent ones."""
    counted = [v for v in verdicts if v.end != "equivalent"]
    return sum(v.end in NOTICED for v in counted) / len(counted) if counted else 1.0


def counts(verdicts: list[Verdict]) -> dict[str, dict[str, int]]:
    """Numbers of mutants and share that was noticed [%], by module."""
    modules = dict.fromkeys(v.module for v in verdicts)
    return {module: count([v for v in verdicts if v.module == module]) for module in modules}


def count(verdicts: list[Verdict]) -> dict[str, int]:
    """Number of mutants, of those noticed and equivalent, and share that was noticed [%]."""
    return {
        "mutants": len(verdicts),
        "noticed": sum(v.end in NOTICED for v in verdicts),
        "equivalent": sum(v.end == "equivalent" for v in verdicts),
        "noticed %": int(100 * score(verdicts)),
    }


def write(verdicts: list[Verdict], folder: Path) -> None:
    """Write `mutants.json`, and `mutants.md` with a table per module and the survivors."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "mutants.json", json.dumps([asdict(v) for v in verdicts], indent=1) + "\n")
    lines = [
        "| module | mutants | killed | equivalent | score |",
        "| --- | --- | --- | --- | --- |",
    ]
    for module, found in counts(verdicts).items():
        lines.append(f"| {' | '.join(map(str, (module, *found.values())))} % |")
    survivors = [
        f"- {v.module}:{v.line} `{v.change}`" + (" (pytest failed)" if v.end == "error" else "")
        for v in verdicts if v.end in ("survived", "error")
    ]  # fmt: skip
    text = "\n".join([*lines, "", "Survivors:", "", *(survivors or ["none"])])
    write_whole(folder / "mutants.md", text + "\n")
