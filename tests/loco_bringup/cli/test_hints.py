# SPDX-License-Identifier: Apache-2.0
"""Commands that programs print as a next step: each is one that there is, with its options."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import pytest

from loco_bringup.cli import install, main
from loco_bringup.cli.table import COMMANDS, parser, split
from loco_control.exceptions import MissingFileError

ROOT = Path(__file__).resolve().parents[3]
HINT = re.compile(r"(?:`|: +|  )(?:\./)?loco ([a-z][^`\n]*)")


def texts(path):
    """Texts of a program that are no docstrings; what is filled in later is X."""
    said, skipped = path.read_text(), set()
    for node in ast.walk(ast.parse(said if "loco " in said else "")):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            skipped.add(id(body[0].value))
        if isinstance(node, ast.JoinedStr):
            skipped |= set(map(id, node.values))
            yield "".join(v.value if isinstance(v, ast.Constant) else "X" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) not in skipped:
                yield node.value


FILES = [f for folder in ("src", "ros_ws/src") for f in sorted((ROOT / folder).rglob("*.py"))]
HINTS = sorted(
    {h.rstrip(".,;)") for f in FILES for text in texts(f) for h in HINT.findall(text)}
)  # fmt: skip


def test_hints_are_found_where_they_are():
    assert "install view" in HINTS and "gap next X" in HINTS and len(HINTS) > 50


@pytest.mark.parametrize("hint", HINTS)
def test_a_hint_is_a_command_with_options_that_there_are(hint):
    name, rest = split(shlex.split(hint))
    if COMMANDS[name].options:
        known = parser(name)._option_string_actions
        options = [word.partition("=")[0] for word in rest if word.startswith("--")]
        assert [option for option in options if option not in known] == []


@pytest.fixture
def no_clone(monkeypatch):
    def refuse():
        raise MissingFileError("no clone")

    monkeypatch.setattr(install.clone, "root", refuse)


@pytest.fixture
def called(monkeypatch):
    calls = []
    monkeypatch.setattr(install.subprocess, "call", lambda words: calls.append(words) or 0)
    return calls


def code(*words):
    with pytest.raises(SystemExit) as end:
        main.main(list(words))
    return end.value.code or 0


def test_a_clone_installs_by_its_script(called):
    assert code("install", "view", "rl") == 0
    assert called == [[ROOT / "loco", "install", "view", "rl"]]


def test_elsewhere_pip_installs_the_packages_of_an_extra(no_clone, called):
    assert code("install", "view", "lerobot") == 0
    ((_, dash, pip, word, *packages),) = called
    assert (dash, pip, word) == ("-m", "pip", "install")
    assert sorted(re.match(r"[\w-]+", p)[0] for p in packages) == ["pyarrow", "rerun-sdk"]


@pytest.mark.parametrize(
    ("extra", "words"), [("veiw", "no extra named 'veiw'"), ("view", "this environment has no pip")]
)
def test_what_cannot_be_installed_is_one_line(
    no_clone, called, monkeypatch, capsys, extra, words
):
    monkeypatch.setattr(install.importlib.util, "find_spec", lambda name: None)
    assert code("install", extra) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1 and called == []


def test_requirements_keep_the_other_conditions_of_a_line(monkeypatch):
    lines = ['a>=1; python_version < "3.12" and extra == "x"', 'b ; extra == "x"', "c"]
    monkeypatch.setattr(install.importlib.metadata, "requires", lambda name: lines)
    found = [line.strip() for line in install.requirements()["x"]]
    assert found == ['a>=1 ; python_version < "3.12"', "b"]


@pytest.mark.parametrize("here", [True, False])
def test_hints_name_the_script_only_where_there_is_one(monkeypatch, capsys, here):
    monkeypatch.setattr(main.clone, "is_one", lambda: here)
    with pytest.raises(SystemExit):
        main._fail("it comes with `./loco install view`", 2)
    assert ("./loco" in capsys.readouterr().err) is here
