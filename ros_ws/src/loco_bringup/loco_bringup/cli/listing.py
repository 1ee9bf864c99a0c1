# SPDX-License-Identifier: Apache-2.0
"""`loco list` and `loco schema`: names that commands accept, and schemas of the YAML files."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_control.files import write_whole
from loco_control.ros.messages.joint_topics import TABLES
from loco_learning.runs import experiment
from loco_learning.study import study
from loco_sim import effects

from ..bag.reader import Bag
from ..robot.terminal import robot_table
from ..schemas import SCHEMAS, schema
from ..terminal import console, table
from .table import COMMANDS, parser


def show(a: argparse.Namespace) -> int:
    """`loco list`: print all lists, one of them, or what has a name.

    Raises:
        NameUnknownError: There is no such list, and nothing of this name in any.
    """
    lists = {name: _LISTS[name]() for name in ([a.what] if a.what in _LISTS else _LISTS)}
    unfiltered = a.what in (None, *_LISTS)
    tables = [(title, columns, rows if unfiltered else [r for r in rows if r[0] == a.what])
              for title, columns, rows in lists.values()]  # fmt: skip
    if a.what in effects.EFFECTS:
        tables.append(_parameters(a.what))
    tables = [entry for entry in tables if unfiltered or entry[2]]
    for title, columns, rows in tables:
        console.print(table(title, columns, rows))
    if not tables:
        raise NameUnknownError("list, or entry of a list,", a.what, _LISTS)
    return 0


def _parameters(effect: str) -> tuple[str, tuple, list]:
    fields = dataclasses.fields(effects.EFFECTS[effect])
    rows = [(f.name, f"{f.metadata['doc']} [{f.metadata['unit']}]") for f in fields]
    return "Parameters", ("name", "meaning"), rows


def _experiments() -> tuple[str, tuple, list]:
    rows = []
    for name in experiment.names():
        e = experiment.load(name)
        rows.append((name, f"{e.ticks / e.control_rate:.0f} s", e.description))
    return "Experiments (loco run NAME)", ("name", "length", "what it shows"), rows


def _studies() -> tuple[str, tuple, list]:
    rows = [(name, study.load(name).description) for name in study.names()]
    return "Studies (loco study NAME)", ("name", "what it shows"), rows


def _effects() -> tuple[str, tuple, list]:
    rows = [(name, effects.EFFECTS[name].__doc__.splitlines()[0]) for name in effects.names()]
    return "Effects (effects: [{name: ...}] in an experiment)", ("name", "what it does"), rows


def _topics() -> tuple[str, tuple, list]:
    rows = [
        (t.name, graph, t.message, f"{t.rate:g} Hz" if t.rate else "event", t.writer, t.doc)
        for graph, table in TABLES.items()
        for t in table.values()
    ]
    return "Topics", ("name", "graph", "type", "rate", "writer", "what it says"), rows


def _bags() -> tuple[str, tuple, list]:
    rows = []
    for folder in sorted({p.parent for p in Path("bags").glob("*/*.mcap")}):
        try:
            bag = Bag(folder)
            length = f"{bag.end - bag.start:.1f} s"
            rows.append((str(folder), length, bag.metadata.get("experiment", "")))
        except LocoError as error:
            rows.append((str(folder), "?", str(error)))
    return "Bags (loco info BAG)", ("folder", "length", "experiment"), rows


_LISTS: dict[str, Callable[[], tuple[str, tuple, list]]] = {
    "experiments": _experiments,
    "robots": robot_table,
    "studies": _studies,
    "effects": _effects,
    "topics": _topics,
    "bags": _bags,
}


def show_schema(a: argparse.Namespace) -> int:
    """`loco schema`: print one JSON Schema, or write files.

    Raises:
        NameUnknownError: There is no such kind of file.
        ParameterError: Neither a kind nor a folder is given.
    """
    if a.kind is None and a.out is None:
        raise ParameterError(f"name a kind of file ({', '.join(SCHEMAS)}), or a folder with --out")
    for kind in [a.kind] if a.kind else SCHEMAS:
        text = json.dumps(schema(kind), indent=2, ensure_ascii=False) + "\n"
        if a.out is None:
            sys.stdout.write(text)
        else:
            console.print(str(write_whole(a.out / f"{kind}.json", text)))
    return 0


def show_completion(a: argparse.Namespace) -> int:
    """`loco completion`: print a shell function that completes commands and options.

    Other arguments are completed with file names, and with the names that the commands accept.
    """
    names = {"run": [*experiment.names()], "study": [*study.names()], "list": [*_LISTS]}
    names["help"] = sorted({name.partition(" ")[0] for name in COMMANDS})
    for name, command in COMMANDS.items():
        first, _, second = name.partition(" ")
        completions = names.setdefault(first, [])
        if second and not second.startswith("-"):
            completions.append(second)
        elif command.options:
            for action in parser(name)._actions:
                completions += [o for o in action.option_strings if o.startswith("--")]
                completions += action.choices or ()
    cases = "\n".join(f"    {n}) words='{' '.join(dict.fromkeys(w))}' ;;" for n, w in names.items())
    sys.stdout.write(_SCRIPT.format(first=" ".join(names), cases=cases, zsh=_ZSH[a.shell]))
    return 0


_ZSH = {"bash": "", "zsh": "autoload -U +X bashcompinit && bashcompinit\n"}
_SCRIPT = """\
{zsh}_loco_complete() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} words
  if [ "$COMP_CWORD" -eq 1 ]; then words='{first}'; else case ${{COMP_WORDS[1]}} in
{cases}
  esac; fi
  COMPREPLY=($(compgen -W "$words" -- "$word") $(compgen -f -- "$word"))
}}
complete -o filenames -F _loco_complete loco ./loco
"""
