# SPDX-License-Identifier: Apache-2.0
"""Registry of the commands: the modules beside this one fill it, one per group of the help."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Callable
from typing import NamedTuple

Options = Callable[[ArgumentParser], None]


class Command(NamedTuple):
    """One command.

    Attributes:
        text: One line of help.
        options: Function that adds the options to a parser; None for a command whose arguments
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
