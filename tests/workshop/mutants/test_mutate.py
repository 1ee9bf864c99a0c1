# SPDX-License-Identifier: Apache-2.0
"""Mutants are valid modules that differ from the original in one place."""

import ast
import difflib
from pathlib import Path

import pytest

from loco_workshop.mutants.mutate import mutants
from loco_workshop.mutants.run import EQUIVALENT, PROTECTING

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("module", PROTECTING)
def test_each_mutant_is_a_module_with_one_change(module):
    source = (ROOT / module).read_text()
    plain = ast.unparse(ast.parse(source)).splitlines()
    found = mutants(source)
    assert len({mutant.key for mutant in found}) == len(found) > 10
    assert set(EQUIVALENT.get(module, {})) <= {mutant.key for mutant in found}
    for mutant in found:
        compile(mutant.text, module, "exec")
        lines = mutant.text.splitlines()
        changed = [o for o in difflib.SequenceMatcher(None, plain, lines).get_opcodes()
                   if o[0] != "equal"]  # fmt: skip
        assert len(changed) == 1, mutant


@pytest.mark.parametrize(
    ("source", "after"),
    [
        ("a = b < c", ["b <= c"]),
        ("a = b and c", ["b or c"]),
        ("a = 1", ["2"]),
        ("a = True", ["False"]),
        ("def f(x):\n    stop()\n    return x + y", ["pass", "x - y"]),
        ("def f(x: int = 3) -> 'text':\n    '''Doc.'''", ["4"]),
        ("a = parameter(1, 'text', 'm', 2, 3)", ["2"]),
        ("if a:\n    b = c", ["not a"]),
    ],
)
def test_what_is_changed(source, after):
    assert [mutant.after for mutant in mutants(source)] == after


def test_changes_that_read_the_same_are_numbered():
    keys = [mutant.key for mutant in mutants("def f(a, b):\n    return a[1] + b[1]\n")]
    assert keys == ["f: 1 -> 2", "f: 1 -> 2 #2", "f: a[1] + b[1] -> a[1] - b[1]"]


def test_tests_that_must_notice_exist():
    for module, tests in PROTECTING.items():
        assert (ROOT / module).is_file()
        assert all((ROOT / test).is_file() for test in tests)
