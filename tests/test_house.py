# SPDX-License-Identifier: Apache-2.0
"""The size of the code and the words in it: limits that may become lower, not higher."""

from __future__ import annotations

import ast
import io
import tokenize
from collections import Counter
from pathlib import Path

import pytest
import yaml
from tests.test_layering import FOLDERS, ROOT, cycles, graph, modules_of

PACKAGES = [name for name in FOLDERS if name != "loco_workshop"]  # what users install
LIMITS = yaml.safe_load(Path(__file__).with_name("house.yaml").read_text())
HOUSE_WORDS = set(Path(__file__).with_name("house_words.txt").read_text().split())
NO_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
NO_CODE |= {tokenize.ENDMARKER}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
BRANCHES = (ast.If, ast.For, ast.While, ast.ExceptHandler, ast.IfExp, ast.BoolOp)
BRANCHES += (ast.comprehension, ast.Assert, ast.match_case)


def docstring_lines(tree: ast.AST) -> set[int]:
    """Numbers of the lines of docstrings."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines |= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


def code_lines(text: str) -> int:
    """Number of lines with a token that belongs to no comment and no docstring."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines |= set(range(token.start[0], token.end[0] + 1))
    return len(lines - docstring_lines(ast.parse(text)))


def bound_names(tree: ast.AST) -> list[str]:
    """Names of functions, classes, arguments, variables and attributes, where they are bound."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, DOCUMENTED[1:]):
            names.append(node.name)
        elif isinstance(node, ast.arg):
            names.append(node.arg)
        elif isinstance(node, (ast.Name, ast.Attribute)) and isinstance(node.ctx, ast.Store):
            names.append(node.id if isinstance(node, ast.Name) else node.attr)
    return [name.strip("_").lower() for name in names if name.strip("_")]


def house_words(names: list[str]) -> Counter[str]:
    """Bound names that are private words of this project, with their counts."""
    return Counter(name for name in names if name in HOUSE_WORDS)


def files(package: str) -> dict[Path, str]:
    """Texts of the modules of a package."""
    return {path: path.read_text() for path in modules_of(package).values()}


def arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Number of named arguments, without `self` and `cls`."""
    names = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    return len(names) - (names[:1] in (["self"], ["cls"])) + len(function.args.kwonlyargs)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_stays_within_its_budget_of_code_lines(package):
    size = sum(code_lines(text) for text in files(package).values())
    assert size <= LIMITS["code_lines"][package], "delete something, or say why in house.yaml"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_share_of_house_words_does_not_grow(package):
    names = [n for text in files(package).values() for n in bound_names(ast.parse(text))]
    words = house_words(names)
    share = 100.0 * sum(words.values()) / len(names)
    assert share <= LIMITS["house_words_percent"][package], words.most_common(20)


@pytest.mark.parametrize("package", PACKAGES)
def test_functions_with_many_arguments_or_branches_do_not_become_more(package):
    functions = [
        node
        for text in files(package).values()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    long = [f.name for f in functions if arguments(f) > 8]
    assert len(long) <= LIMITS["over_8_arguments"][package], long
    many = [f.name for f in functions if sum(isinstance(n, BRANCHES) for n in ast.walk(f)) > 20]
    assert len(many) <= LIMITS["over_20_branches"][package], many


def test_circles_of_folders_do_not_become_more():
    modules = {name: path for package in PACKAGES for name, path in modules_of(package).items()}
    folder_of = {name: path.parent.relative_to(ROOT).as_posix() for name, path in modules.items()}
    folders: dict[str, set[str]] = {folder: set() for folder in folder_of.values()}
    for name, folder in folder_of.items():
        folders[folder] |= {folder_of[other] for other in graph()[name] & folder_of.keys()}
    for folder, others in folders.items():
        others.discard(folder)
    assert len(cycles(folders)) <= LIMITS["folder_cycles"], cycles(folders)


# --- the measures measure ---------------------------------------------------------


def test_docstrings_comments_and_blank_lines_are_no_code():
    text = (
        '"""Doc\nof two lines."""\n\n# comment\nx = (\n    1,  # one\n)\ndef f():\n    """Doc."""\n'
    )
    assert code_lines(text + "    return x\n") == 5


def test_names_are_counted_where_they_are_bound():
    tree = ast.parse(
        "def found(known):\n    self.kept, x = known, found\n    return [x for x in y]"
    )
    assert sorted(bound_names(tree)) == ["found", "kept", "known", "x", "x"]
    assert house_words(bound_names(tree)) == Counter(found=1, known=1, kept=1)


def test_self_is_no_argument():
    tree = ast.parse("def f(self, a, /, b, *c, d=1, **e): ...")
    assert arguments(tree.body[0]) == 3
