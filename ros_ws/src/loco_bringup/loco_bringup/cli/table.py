# SPDX-License-Identifier: Apache-2.0
"""Table of the commands, generated from their options, and their lazy import.

A command consists of two functions. The first, in a module of ``cli/options``, adds the options
to a parser and imports nothing slow, so that help and error messages appear quickly. What its
docstring says below the first line is in the help. Its decorator names the second function as
``module:function``, relative to this package (`loco_bringup`). That function takes the parsed
options and returns the exit code; its import loads everything that the command uses. Both functions
of a command for developers are in ``tests/workshop`` of a clone.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
from collections.abc import Callable
from typing import Any, NoReturn

from loco_control.exceptions import MissingPackageError, NameUnknownError, ParameterError, cut
from loco_control.reading import shown

from . import clone
from .options import bags, gap, install, learn, run  # noqa: F401 (they register commands)
from .options.registry import GROUPS

PACKAGE = __name__.partition(".")[0]

ROS = ("rclpy", "builtin_interfaces", "rcl_interfaces", "ament_index_python")
# Packages that only some commands need, and the extra that installs them.
EXTRAS: dict[tuple[str, ...], str] = {
    ROS: "this command speaks ROS 2: `./loco` in a clone of the repository brings it. Without ROS "
    "there are gap, export-model, report, export, calibrate, optimise, reinforce, study, robot, "
    "list, schema and `run --layout rollout`",
    ("rerun",): "it comes with `./loco install view`",
    ("foxglove",): "it comes with `./loco install foxglove`",
    ("dynamixel_sdk",): "it comes with `./loco install dynamixel`",
    ("pytest", "rosbags", "mcap_ros2"): "it comes with `./loco install test`",
}
if clone.is_one():
    clone.add_workshop()
    importlib.import_module(f"{clone.WORKSHOP}.options")  # registers the commands for developers
COMMANDS = {name: command for group in GROUPS.values() for name, command in group.items()}


class Store(argparse._StoreAction):
    """Action of an option: a repeated list option is extended, a repeated value is refused."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Store a value of the command line; called by argparse."""
        if option_string:
            stored: dict[str, Any] = parser.given  # type: ignore[attr-defined]
            several = isinstance(values, list)
            if self.dest in stored and not several:
                raise argparse.ArgumentError(
                    self, f"given twice, {shown(str(stored[self.dest]))} and {shown(str(values))}"
                )
            values = [*stored.get(self.dest, ()), *values] if several else values
            stored[self.dest] = values
        super().__call__(parser, namespace, values, option_string)


class Parser(argparse.ArgumentParser):
    """Parser of one command, which raises an exception on wrong input.

    Attributes:
        given: Values of the options on the command line, by destination.
    """

    def __init__(self, **keywords: Any):
        super().__init__(**keywords)
        self.given: dict[str, Any] = {}
        for kind in (None, "store"):
            self.register("action", kind, Store)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parsed options and the remaining arguments; called by argparse."""
        self.given = {}
        return super().parse_known_args(args, namespace)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise an exception for a value that is no choice; called by argparse."""
        if action.choices is not None and value not in action.choices:
            what = "/".join(action.option_strings) or self.prog
            raise NameUnknownError(f"choice of {what}", str(value), action.choices)

    def error(self, message: str) -> NoReturn:
        """Raise an exception for a wrong command line; called by argparse."""
        raise ParameterError(f"{cut(message, 400)}; see `{self.prog} --help`")


def load(target: str) -> Callable[..., Any]:
    """Import and return a function written as ``module:function``.

    Raises:
        MissingPackageError: A package of `EXTRAS` that the module needs is not installed.
    """
    module, _, function = target.partition(":")
    if not module.startswith(f"{clone.WORKSHOP}."):
        module = f"{PACKAGE}.{module}"
    try:
        return getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        for names, text in EXTRAS.items():
            if missing in names or (names == ROS and missing.endswith(("_msgs", "_srvs"))):
                raise MissingPackageError(f"{missing} is not installed; {text}") from None
        raise


def split(arguments: list[str]) -> tuple[str, list[str]]:
    """Name of the command and the arguments after it.

    A name is a word (``gap``), a word and a sub-command (``gap next``), or a word and an option
    at any position (``gap --live``), which remains among the arguments.

    Raises:
        NameUnknownError: There is no such command.
    """
    first, rest = arguments[0], arguments[1:]
    if first not in COMMANDS:
        commands = {name.partition(" ")[0] for name in COMMANDS} | {"help"}
        raise NameUnknownError("command", first, commands)
    if rest and f"{first} {rest[0]}" in COMMANDS and not rest[0].startswith("-"):
        return f"{first} {rest[0]}", rest[1:]
    line = " ".join(["", *rest, ""]).replace("=", " ")
    options = (name for name in COMMANDS if name.startswith(f"{first} --"))
    return next((name for name in options if f"{name[len(first) :]} " in line), first), rest


def parser(name: str) -> Parser:
    """Parser of the options of a command."""
    command = COMMANDS[name]
    _, _, details = inspect.cleandoc(command.options.__doc__).partition("\n")
    p = Parser(
        prog=f"loco {name.partition(' --')[0]}",
        allow_abbrev=False,
        description=f"{command.text}\n{details}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.options(p)
    return p


def parse(arguments: list[str]) -> tuple[str, argparse.Namespace | list[str]]:
    """Name of a command and its parsed options, or its arguments if they are passed on.

    Args:
        arguments: The command line after ``loco``, at least one word.

    Raises:
        NameUnknownError: There is no such command.
        ParameterError: The command has no such option, or a value is missing or wrong.
    """
    name, rest = split(arguments)
    return name, parser(name).parse_args(rest) if COMMANDS[name].options else rest


def call(*arguments: Any) -> int:
    """Run a command line; returns the exit code.

    Args:
        arguments: Words after ``loco``; a command can run another one this way.
    """
    name, options = parse([str(argument) for argument in arguments])
    if getattr(options, "engine", None):
        os.environ["LOCO_ENGINE"] = options.engine  # default engine, also in worker processes
    return load(COMMANDS[name].run)(options)
