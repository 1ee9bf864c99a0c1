# SPDX-License-Identifier: Apache-2.0
"""Run a notebook as Jupyter would, and store what its cells say.

PYTHONPATH=tests/workshop .venv/bin/python -m loco_workshop.docs.notebook docs/csv_to_gap.ipynb
"""

from __future__ import annotations

import ast
import contextlib
import io
import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any


def outputs(notebook: dict[str, Any]) -> list[list[dict[str, Any]]]:
    """Outputs of each code cell, run one after the other in the current folder.

    What a cell prints is one output, and the value of its last line another, with its text and, if
    it has one, its HTML; unless it is None, or the line ends with a semicolon.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    return [_run(_text(cell), number, names) for number, cell in enumerate(_code(notebook), 1)]


def store(path: str | Path) -> None:
    """Run a notebook in an empty folder and write the outputs into it."""
    path = Path(path).resolve()
    notebook, here = json.loads(path.read_text(encoding="utf-8")), Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        said = outputs(notebook)
        os.chdir(here)
    for number, (cell, found) in enumerate(zip(_code(notebook), said, strict=True), 1):
        cell |= {"execution_count": number, "outputs": found}
    text = json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8")


def _code(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def _text(cell: dict[str, Any]) -> str:
    return "".join(cell["source"])


def _run(source: str, number: int, names: dict[str, Any]) -> list[dict[str, Any]]:
    tree, printed, value = ast.parse(source), io.StringIO(), None
    shown = isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";")
    last = tree.body.pop() if shown else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"cell {number}", "exec"), names)
        if last:
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
    found: list[dict[str, Any]] = []
    if printed.getvalue():
        found.append(
            {"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())}
        )
    if value is not None:
        data = {"text/plain": _lines(repr(value))}
        if hasattr(value, "_repr_html_"):
            data["text/html"] = _lines(value._repr_html_())
        found.append({"output_type": "execute_result", "execution_count": number, "data": data,
                      "metadata": {}})  # fmt: skip
    return found


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


if __name__ == "__main__":
    store(sys.argv[1])
