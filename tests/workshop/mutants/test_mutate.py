# SPDX-License-Identifier: Apache-2.0
"""Mutants are valid modules that differ from the original in one place."""

import ast
from pathlib import Path

import pytest

from loco_control.exceptions import ParameterError
from loco_workshop.mutants.mutate import by_hand, mutants
from loco_workshop.mutants.run import BY_HAND, EQUIVALENT, PROTECTING

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
        pairs = zip(plain, mutant.text.splitlines(), strict=True)
        assert sum(before != after for before, after in pairs) == 1, mutant


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
        ("a = parameter(1, 'text', low=2, high=3)", ["2"]),
        ("a = zip(b, c, strict=True)", []),
        ("def f(x):\n    log.info(x)\n    tell(x)", ["pass"]),
        ("if a:\n    b = c", ["not a"]),
    ],
)
def test_what_is_changed(source, after):
    assert [mutant.after for mutant in mutants(source)] == after


@pytest.mark.parametrize("module", BY_HAND)
def test_each_mutant_made_by_hand_is_another_module(module):
    source = (ROOT / module).read_text()
    for mutant in by_hand(source, BY_HAND[module]):
        assert ast.dump(ast.parse(mutant.text)) != ast.dump(ast.parse(source)), mutant.key
    assert module in PROTECTING


def test_what_a_mutant_made_by_hand_changes_is_there_once():
    (mutant,) = by_hand("a = 1\nb = 2\n", {"b is 3": ["b = 2", "b = 3"]})
    assert (mutant.line, mutant.key, mutant.text) == (2, "by hand: b is 3", "a = 1\nb = 3\n")
    for old, count in (("c", 0), ("=", 2)):
        with pytest.raises(ParameterError, match=f"occurs {count} times"):
            by_hand("a = 1\nb = 2\n", {"no": [old, "x"]})


def test_changes_that_read_the_same_are_numbered():
    keys = [mutant.key for mutant in mutants("def f(a, b):\n    return a[1] + b[1]\n")]
    assert keys == ["f: 1 -> 2", "f: 1 -> 2 #2", "f: a[1] + b[1] -> a[1] - b[1]"]


def test_tests_that_must_notice_exist():
    for module, tests in PROTECTING.items():
        assert (ROOT / module).is_file()
        assert all((ROOT / test).is_file() for test in tests)
