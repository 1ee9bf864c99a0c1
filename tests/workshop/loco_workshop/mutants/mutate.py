# SPDX-License-Identifier: Apache-2.0
"""Mutants of Python source: small changes, each of which should make a test fail.

Comparisons are shifted, signs and ``and``/``or`` are swapped, conditions are negated, numbers
and flags are changed, and calls with an unused result are removed.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from loco_control.exceptions import ParameterError

_SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A changed source file.

    Attributes:
        line: Line of the change, from 1.
        function: Enclosing function or method; empty at module level.
        before: Source of the changed part; of a mutant made by hand, the fault in words.
        after: Source of the part after the change; empty for a mutant made by hand.
        text: Source of the whole module after the change.
        number: Index among identical changes in the function, from 1.
    """

    line: int
    function: str
    before: str
    after: str
    text: str
    number: int = 1

    @property
    def key(self) -> str:
        """Identifier that does not depend on line numbers: function, change, index."""
        if not self.after:
            return f"{self.function}: {self.before}"
        text = f"{self.function}: {self.before} -> {self.after}"
        return text if self.number == 1 else f"{text} #{self.number}"


def mutants(source: str) -> list[Mutant]:
    """All mutants of a module in line order, with unique keys.

    Docstrings and type hints are not changed.
    """
    tree = ast.parse(source)
    _mark(tree)
    result = [*_of(tree, tree)]
    plain, at = ast.unparse(tree), 0
    for statement in tree.body:  # only the statement that is changed is written anew
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue  # a docstring, which is written otherwise in its module
        text = ast.unparse(statement)
        at = plain.index(text, at)
        before, after = plain[:at], plain[at + len(text) :]
        at += len(text)
        result += [
            replace(mutant, text=f"{before}{mutant.text}{after}")
            for node in ast.walk(statement)
            if not getattr(node, "skipped", False)
            for mutant in _of(node, statement)
            if mutant.before != mutant.after
        ]
    result.sort(key=lambda mutant: (mutant.line, mutant.before, mutant.after))
    counts: Counter[str] = Counter()
    for i, mutant in enumerate(result):
        counts[mutant.key] += 1
        result[i] = replace(mutant, number=counts[mutant.key])
    return result


def by_hand(source: str, made: Mapping[str, Sequence[str]]) -> list[Mutant]:
    """Mutants made by hand.

    Args:
        source: Source of the module.
        made: Old text, which occurs once in the source, and new text, by the fault in words.

    Raises:
        ParameterError: An old text does not occur, or more than once.
    """
    found = []
    for name, (old, new, *_) in made.items():
        if source.count(old) != 1:
            raise ParameterError(f"{name!r}: its text occurs {source.count(old)} times, not once")
        line = source[: source.index(old)].count("\n") + 1
        found.append(Mutant(line, "by hand", name, "", source.replace(old, new)))
    return found


def _mark(tree: ast.Module) -> None:
    """Store the enclosing function in each node, and mark nodes that are not executable code."""

    def visit(node: ast.AST, function: str, skipped: bool) -> None:
        node.function, node.skipped = function, skipped  # type: ignore[attr-defined]
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            function = f"{function}.{node.name}".strip(".")
        for name, value in ast.iter_fields(node):
            hint = name in ("annotation", "returns", "decorator_list")
            for i, child in enumerate(value if isinstance(value, list) else [value]):
                if isinstance(child, ast.AST):
                    bound = _is_parameter(node) and (name == "keywords" or name == "args" and i)
                    check = name == "keywords" and child.arg == "strict"  # of `zip`: an assertion
                    visit(child, function, skipped or hint or bool(bound) or check)

    visit(tree, "", False)


def _is_parameter(node: ast.AST) -> bool:
    """Whether a node calls `parameter` of `loco_control.params`, whose bounds are not mutated."""
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "parameter"


def _logs(statement: ast.Expr) -> bool:
    """Whether a statement writes to the log, which no behaviour depends on."""
    return ast.unparse(statement).startswith("log.")


def _of(node: ast.AST, tree: ast.Module | ast.stmt) -> Iterator[Mutant]:
    """Mutants of one node, which is changed, unparsed with its tree, and restored.

    Their text is that of the tree.
    """
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            if type(op) in _SWAPS:
                yield _changed(node, tree, node.ops, i, _SWAPS[type(op)]())
    elif isinstance(node, (ast.BinOp, ast.BoolOp, ast.AugAssign)) and type(node.op) in _SWAPS:
        yield _changed(node, tree, node, "op", _SWAPS[type(node.op)]())
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield _changed(node, tree, node, "value", not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        yield _changed(node, tree, node, "value", node.value + 1)
    elif isinstance(node, (ast.If, ast.IfExp, ast.While)):
        negated = ast.UnaryOp(ast.Not(), node.test)
        yield _changed(node.test, tree, node, "test", negated)
    for name in ("body", "orelse", "finalbody"):
        block = getattr(node, name, None)
        for i, child in enumerate(block if isinstance(block, list) else []):
            if (
                isinstance(child, ast.Expr)
                and isinstance(child.value, ast.Call)
                and not _logs(child)
            ):
                yield _changed(child, tree, block, i, ast.Pass())


def _changed(shown: ast.AST, tree: ast.AST, place: object, key: object, new: object) -> Mutant:
    before = ast.unparse(shown)
    listed = isinstance(place, list)
    old = place[key] if listed else getattr(place, key)
    put = place.__setitem__ if listed else lambda k, v: setattr(place, k, v)
    put(key, new)
    remains = shown is not old  # the displayed part still exists and is changed inside
    after = ast.unparse(shown if remains else ast.fix_missing_locations(new))
    text = ast.unparse(ast.fix_missing_locations(tree))
    put(key, old)
    return Mutant(shown.lineno, getattr(shown, "function", ""), before, after, text)
