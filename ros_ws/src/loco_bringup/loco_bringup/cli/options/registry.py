# SPDX-License-Identifier: Apache-2.0
"""Registry of the commands: the modules beside this one fill it, one per group of the help."""

from __future__ import annotations

from argparse import SUPPRESS, ArgumentParser, ArgumentTypeError
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

FILES = (".html", ".yaml", ".yml", ".json", ".csv", ".mcap")  # endings of no folder that is meant

Options = Callable[[ArgumentParser], None]


class Command(NamedTuple):
    """One command.

    Attributes:
        text: One line of help.
        options: Function that adds the options to a parser, and whose docstring goes on with what
            the help says below `text`; None for a command whose arguments
            are passed on as a list of texts.
        run: Function that takes the parsed options and returns the exit code, as
            ``module:function``; see `cli.table.load`.
    """

    text: str
    options: Options | None
    run: str


# Titles of the groups, in the order of the help, and the commands of each.
GROUPS: dict[str, dict[str, Command]] = {
    "Find out why a model and a robot differ": {},
    "Run robots": {},
    "Record and read bags": {},
    "Learn from many runs": {},
    "Work on loco itself": {},
}


def group(title: str) -> Callable[[str, str, str], Callable[[Options | None], Options | None]]:
    """Decorator for the functions that add options, which registers commands of one group.

    Its arguments are the name of the command, its function and its line of help. Of several
    decorators of one function the lowest is the first in the help.
    """

    def command(name: str, run: str, text: str) -> Callable[[Options | None], Options | None]:
        def register(options: Options | None) -> Options | None:
            GROUPS[title][name] = Command(text, options, run)
            return options

        return register

    return command


def option(p: ArgumentParser, flag: str, value: Any, text: str, metavar: str | None = None) -> None:
    """Add an option.

    Args:
        p: Parser of the command.
        flag: Name, such as ``--seed``.
        value: Default, of the type of the option; the type, if the default is None; False for an
            option without a value; `list` for one that may be repeated, `tuple` for one with
            one or more values.
        text: Line of help.
        metavar: Name of the value in the help.
    """
    if value is False:
        p.add_argument(flag, action="store_true", help=text)
    elif value is list:
        p.add_argument(flag, action="append", default=[], metavar=metavar, help=text)
    elif value is tuple:
        p.add_argument(flag, nargs="+", default=[], metavar=metavar, help=text)
    elif isinstance(value, type):
        p.add_argument(flag, type=value, metavar=metavar, help=text)
    else:
        kind = Path if isinstance(value, Path) else type(value)
        p.add_argument(flag, type=kind, default=value, metavar=metavar, help=text)


def add_out(
    p: ArgumentParser, text: str, file: bool = False, default: Path | None = None
) -> None:
    """Add the option ``--out``, by one rule for all commands, and its older name ``--output``.

    It names a folder. Of a command that writes a single file it may name the file, too; see
    `outcome.file_at`.

    Args:
        p: Parser of the command.
        text: Line of help: what is written, and the default.
        file: Whether the command writes a single file.
        default: Value without the option.
    """
    kind, metavar = (Path, "PATH") if file else (folder, "DIR")
    p.add_argument("--out", type=kind, default=default, metavar=metavar, help=text)
    p.add_argument("--output", dest="out", type=kind, default=default, help=SUPPRESS)


def folder(text: str) -> Path:
    """Path of a folder from the command line; raises `ArgumentTypeError` if it is a file's."""
    path = Path(text)
    if path.is_file() or (path.suffix in FILES and not path.is_dir()):
        raise ArgumentTypeError(f"a folder is written, and {text!r} is the name of a file")
    return path
