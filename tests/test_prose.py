# SPDX-License-Identifier: Apache-2.0
"""Docstrings read alone: no fragments, no headless clauses, none missing.

An entry of ``Args``, ``Attributes``, ``Returns``, ``Yields`` or ``Raises`` is a noun phrase or a
sentence that needs no neighbour.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("src/loco_control", "src/loco_sim", "src/loco_learning", "ros_ws/src/loco_bringup")
SOURCES += ("tests/workshop/loco_workshop",)
SECTIONS = ("Args", "Attributes", "Returns", "Yields", "Raises")
ENTRY = re.compile(r"\*{0,2}[A-Za-z_][\w.]*(?:, \*{0,2}\w+)*:(?: (?P<text>.*)|$)")

# How a fragment begins: a clause without a head, or a pointer to what another entry says.
FRAGMENT = re.compile(
    r"(?:Of|From|For|To|By|With|Without|In|On|At|Since|If|Where|When|How|What|Who|Whose|Which|That"
    r"|Because|Likewise|Ditto|Or|And|But|Also|Else|Theirs|Its|Not|Instead)\b"
    r"|As (?:there|in|for|of|above|below|before|they|it|with|`)"
)
# Sentences about a pronoun alone say nothing by themselves.
ANAPHOR = re.compile(
    r"(?:It|They|He|She)\b(?: [\w`'.]+){,3}$"
    r"|(?:One|These|Those|Such|None|Both|All|There (?:is|are|was|were))\b(?: [\w`'.]+)?$"
)
# Words that make no noun phrase by themselves, however they are joined.
EMPTY = set(
    """
    which who what how many much few more most there here then it its them they theirs these
    those this that one ones all both each other others same such so as of or and not no on
    off in at to by with given wanted asked made found told said heard called known pickled
    measured long first last above below before after again new old likewise ours a an the
    """.split()
)
HEADLESS = re.compile(r"(?:What|How|Where|Who|Whose|Which)\b")


class Fault(NamedTuple):
    """One place where the words do not stand alone."""

    line: int
    why: str


def is_fragment(entry: str) -> bool:
    """Whether the text of an entry needs its neighbours to be understood."""
    words = re.findall(r"[\w`'.]+", entry)
    if not words:
        return True
    if FRAGMENT.match(entry):
        return True
    if ANAPHOR.match(entry):
        return True
    return len(words) <= 2 and all(word.strip(".`'").lower() in EMPTY for word in words)


def entries(doc: str) -> Iterator[tuple[str, str]]:
    """Section and text of each entry of a docstring in Google style."""
    section, depth, text = "", 0, None
    for line in [*doc.expandtabs().splitlines(), "end"]:
        indent = len(line) - len(line.lstrip())
        ends = line.strip() and indent <= depth
        if section and (ends or indent == depth + 4) and text is not None:
            yield section, " ".join(text).strip()
            text = None
        if ends or not section:
            section = line.strip()[:-1] if line.strip()[:-1] in SECTIONS else ""
            section = section if line.strip().endswith(":") else ""
            depth = indent
        elif indent == depth + 4 and line.strip():
            match = ENTRY.match(line.strip())
            plain = section in ("Returns", "Yields")
            text = [line.strip()] if plain or not match else [match["text"] or ""]
        elif text is not None:
            text.append(line.strip())


@cache
def parsed(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text())


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Statements in a node, in which alone functions and classes are defined."""
    for field in ("body", "orelse", "handlers", "finalbody", "cases"):
        yield from getattr(node, field, ())


def every_class(tree: ast.Module) -> Iterator[ast.ClassDef]:
    """All classes of a module, at any depth."""
    todo: list[ast.AST] = [tree]
    while todo:
        children = list(statements(todo.pop()))
        yield from (child for child in children if isinstance(child, ast.ClassDef))
        todo += children


def documented(tree: ast.Module) -> Iterator[tuple[ast.AST, str, bool]]:
    """Each module, class and function with its name and whether it is public."""
    yield tree, "", True
    todo: list[tuple[ast.AST, bool, bool]] = [(tree, True, False)]
    while todo:
        node, public, inside = todo.pop()
        for child in statements(node):
            if isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                shown = public and not inside and not child.name.startswith("_")
                yield child, child.name, shown
                todo.append((child, shown, not isinstance(child, ast.ClassDef)))
            else:
                todo.append((child, public, inside))


def faults(source: str | ast.Module) -> list[Fault]:
    """Faults of the words of a module, given as text or tree."""
    result, tree = [], ast.parse(source) if isinstance(source, str) else source
    for node, name, public in documented(tree):
        line = getattr(node, "lineno", 1)
        doc = ast.get_docstring(node)
        if doc is None:
            if public:
                result.append(Fault(line, f"{name or 'the module'} has no docstring"))
            continue
        if HEADLESS.match(doc) and not doc.split("\n")[0].endswith("?"):
            result.append(Fault(line, f"headless: {doc.splitlines()[0]}"))
        result += [
            Fault(line, f"{section} of {name}: {entry}")
            for section, entry in entries(doc)
            if is_fragment(entry)
        ]
    return result


@cache
def classes() -> dict[str, tuple[set[str], set[str]]]:
    """Bases and documented methods of all classes, by the name of the class."""
    result: dict[str, tuple[set[str], set[str]]] = {}
    for path in files().values():
        for node in every_class(parsed(path)):
            methods = {
                child.name
                for child in node.body
                if isinstance(child, ast.FunctionDef) and ast.get_docstring(child)
            }
            result[node.name] = bases_of(node), methods
    return result


def bases_of(node: ast.ClassDef) -> set[str]:
    """Names of the bases of a class."""
    return {getattr(base, "attr", getattr(base, "id", "")) for base in node.bases}


def inherits(bases: set[str], method: str) -> bool:
    """Whether a base class documents a method."""
    known = [classes()[base] for base in bases if base in classes()]
    return any(method in methods or inherits(above, method) for above, methods in known)


def files() -> dict[str, Path]:
    """All source files by their path in the repository."""
    paths = [p for source in SOURCES for p in sorted((ROOT / source).rglob("*.py"))]
    return {p.relative_to(ROOT).as_posix(): p for p in paths if p.name != "setup.py"}


def faults_of(path: Path) -> list[Fault]:
    """Faults of a file; a method may leave its docstring to that of a base class."""
    tree = parsed(path)
    inherited = {
        (child.lineno, f"{child.name} has no docstring")
        for node in every_class(tree)
        for child in node.body
        if isinstance(child, ast.FunctionDef) and inherits(bases_of(node), child.name)
    }
    return [f for f in faults(tree) if (f.line, f.why) not in inherited]


def test_docstrings_read_alone():
    found = {}
    for name, path in files().items():
        if faulty := faults_of(path):
            found[name] = [f"line {fault.line}: {fault.why}" for fault in faulty]
    assert found == {}


@pytest.mark.parametrize(
    "entry",
    [
        "Of the record.", "Which.", "As there.", "As in `run`.", "That they were given to.",
        "What it shows.", "To it, from the hip.", "Where.", "", "They do not.", "It is.",
        "Pickled.", "For messages, e.g. the topic.", "How many.",
    ],
)  # fmt: skip
def test_a_fragment_is_found(entry):
    text = f'"""A module."""\ndef f(x):\n    """Do it.\n\n    Args:\n        x: {entry}\n    """\n'
    assert len(faults(text)) == 1


@pytest.mark.parametrize(
    "entry",
    [
        "Name of the option.", "Time step [s].", "Settings.", "Whether the base is fixed.",
        "A file that can be read.", "It has no rows, or a row is shorter than the header.",
        "Positions [m], (n, 3).", "There is no bag.", "Joint angles, hip first [rad].", "Seconds.",
    ],
)  # fmt: skip
def test_a_noun_phrase_is_none(entry):
    text = f'"""A module."""\ndef f(x):\n    """Do it.\n\n    Args:\n        x: {entry}\n    """\n'
    assert faults(text) == []


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ('"""What it does."""', 1),
        ('"""How late ticks were.\n\nMore."""\n', 1),
        ('"""A module."""\nclass A:\n    def f(self):\n        pass\n', 2),
        ('"""A module."""\nclass _A:\n    def f(self):\n        pass\n', 0),
        ('"""A module."""\ndef f():\n    """Do."""\n    def g():\n        pass\n', 0),
        ('"""A module.\n\nReturns:\n    Of it.\n"""\n', 1),
        ('"""A module.\n\nArgs:\n    x, y: Of it\n        and more.\n    z: Length [m].\n"""\n', 1),
        ("x = 1\n", 1),
    ],
)
def test_faults_are_counted(text, count):
    assert len(faults(text)) == count
