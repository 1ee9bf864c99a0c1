# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels are cached on disk by their own file alone; what they call must count as well.

A module whose kernels call those of others says in `MADE_OF` which versions these had when
it was last compiled with them: a change there changes this file, and the cache is not used.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import loco_sim

ROOT = Path(loco_sim.__file__).parent


MARKS = "@njit", "@kernel", "@inlined"  # decorators of numba and of `loco_sim.jit`


def kernels(path: Path) -> bool:
    return any(mark in path.read_text() for mark in MARKS)


def called(path: Path) -> set[Path]:
    """Modules with kernels that a module imports, by themselves or through others."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        folder = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
        names = [folder.with_suffix(".py"), *(folder / f"{a.name}.py" for a in node.names)]
        for other in (name for name in names if name.is_file() and kernels(name)):
            found |= {other} | called(other)
    return found


MIXED = sorted(path for path in ROOT.rglob("*.py") if kernels(path) and called(path))


@pytest.mark.parametrize("path", MIXED, ids=lambda path: path.stem)
def test_a_cache_is_not_used_after_a_change_in_what_it_calls(path):
    text = "".join(other.read_text() for other in sorted(called(path)))
    name = ".".join(["loco_sim", *path.relative_to(ROOT).with_suffix("").parts])
    wanted = hashlib.sha256(text.encode()).hexdigest()[:12]
    found = getattr(importlib.import_module(name), "MADE_OF", "")
    assert found == wanted, f'write MADE_OF = "{wanted}" into {path.name}'


PLACE = """
from typing import NamedTuple
class Pair(NamedTuple):
    a: float
    b: float
"""
TWICE = """
from loco_sim.jit import {mark}
@{decorator}
def twice(pair):
    return 2.0 * pair[0]
"""
CALL = """
import sys
sys.path.insert(0, sys.argv[1])
from {place} import Pair
from twice import twice
assert twice(Pair(3.0, 4.0)) == 6.0
print(sum(twice.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("decorator", ["njit()", "kernel"])
def test_a_cache_with_a_class_that_has_moved_is_made_anew(tmp_path, decorator):
    text = TWICE.format(mark=decorator.rstrip("()"), decorator=decorator)
    (tmp_path / "twice.py").write_text(text)

    def hits(place):
        (tmp_path / f"{place}.py").write_text(PLACE)
        words = [sys.executable, "-c", CALL.format(place=place), str(tmp_path)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return int(done.stdout)

    assert [hits("here"), hits("here")] == [0, 1]
    (tmp_path / "here.py").unlink()
    assert [hits("there"), hits("there")] == [0, 1]


def test_kernels_of_tuples_have_caches_that_are_made_anew():
    plain = [p.stem for p in MIXED if "from numba import njit" in p.read_text()]
    assert not plain, "their kernels call others with tuples: take njit from loco_sim.jit"


def slices(path: Path) -> list[str]:
    """Assignments of kernels to slices, except of constants."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if hasattr(node, "lineno")]
    compiled = [
        node
        for node in nodes
        if any(
            "@" + ast.unparse(mark).partition("(")[0] in MARKS
            for mark in getattr(node, "decorator_list", ())
        )
    ]
    return [
        ast.unparse(node)
        for node in (node for kernel in compiled for node in ast.walk(kernel))
        if isinstance(node, ast.Assign) and not isinstance(node.value, ast.Constant)
        for target in node.targets
        if isinstance(target, ast.Subscript)
        and any(isinstance(part, ast.Slice) for part in ast.walk(target))
    ]


@pytest.mark.parametrize(
    "path", [p for p in sorted(ROOT.rglob("*.py")) if kernels(p)], ids=lambda path: path.stem
)
def test_no_kernel_assigns_an_array_to_a_slice(path):
    # Numba compiles the text of the error for shapes that differ with it: 2 to 4 s per process.
    assert not slices(path)
