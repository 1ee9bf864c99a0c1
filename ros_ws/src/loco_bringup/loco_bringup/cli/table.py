# SPDX-License-Identifier: Apache-2.0
"""Table of the commands and their lazy import.

A command consists of two functions, each written ``module:function``. Modules are named
relative to this package (`loco_bringup`) or, for developer commands, to ``tests/workshop`` of
a clone. The first function adds the options to a parser and imports nothing slow, so that help
and error messages appear quickly. The second takes the parsed options and returns the exit
code; its import loads everything that the command uses.
"""

from __future__ import annotations

import argparse
import importlib
import os
from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn

from loco_control.exceptions import MissingPackageError, NameUnknownError, ParameterError, cut
from loco_control.reading import shown

from . import clone

PACKAGE = __name__.partition(".")[0]


class Command(NamedTuple):
    """One command.

    Attributes:
        text: One line of help.
        options: Function that adds the options to a parser; empty for a command whose
            arguments are passed on as a list of texts.
        run: Function that takes the parsed options and returns the exit code.
    """

    text: str
    options: str
    run: str


ROS = ("rclpy", "builtin_interfaces", "rcl_interfaces", "ament_index_python")
# Packages that only some commands need, and the extra that installs them.
EXTRAS: dict[tuple[str, ...], str] = {
    ROS: "this command speaks ROS 2: `./loco` in a clone of the repository brings it. Without ROS "
    "there are gap, export-model, report, export, calibrate, optimise, reinforce, study, robot, "
    "list, schema and `run --layout rollout`",
    ("rerun",): "it comes with `./loco install view`",
    ("dynamixel_sdk",): "it comes with `./loco install dynamixel`",
    ("pytest", "rosbags", "mcap_ros2"): "it comes with `./loco install test`",
}
# Titles of the groups, in the order of the help, and the commands of each.
GROUPS: dict[str, dict[str, Command]] = {
    "Find out why a model and a robot differ": {
        "gap": Command(
            "find where a model and recordings differ, and name the cause",
            "cli.options.gap:search", "gap.terminal:show_gap",
        ),
        "gap --live": Command(
            "the same with two robots that run, over topics",
            "cli.options.gap:search", "live.gap_terminal:show_live",
        ),
        "gap check": Command(
            "say what recordings can tell before a search, in half a minute",
            "cli.options.gap:check", "gap.check:show_check",
        ),
        "gap mapping": Command(
            "draft a mapping: what the columns or topics of a recording probably are, and why",
            "cli.options.gap:draft", "gap.drafts.terminal:show_draft",
        ),
        "gap next": Command(
            "write the experiment that would tell the leading explanations apart",
            "cli.options.gap:next_experiment", "gap.terminal:show_next",
        ),
        "gap experiments": Command(
            "write experiments that excite a robot, within its limits",
            "cli.options.gap:experiments", "gap.terminal:show_library",
        ),
        "export-model": Command(
            "write a model for MuJoCo, URDF readers, Isaac Lab, PACE or ros2_control",
            "cli.options.gap:export_model", "export_model.terminal:show_export",
        ),
        "calibrate": Command(
            "fit a robot's body to a recorded bag (thesis chapter 5, resumable)",
            "cli.options.fit:calibrate", "calibrate.terminal:show_calibration",
        ),
        "calibrate --live": Command(
            "the same with a running model and a running robot",
            "cli.options.fit:calibrate", "live.terminal:show_live",
        ),
    },
    "Run robots": {
        "demo": Command(
            "run hyq_trot_reflex, replay its bag, write its report",
            "cli.options.run:demo", "cli.demo:run_demo",
        ),
        "run": Command(
            "run an experiment as a ROS 2 graph and record it",
            "cli.options.run:run", "cli.run:run",
        ),
        "run --layout rollout": Command(
            "the same objects without ROS, into the same bag",
            "cli.options.run:run", "cli.rollout:run",
        ),
        "robot": Command(
            "show the robots of loco and those in folders here",
            "cli.options.run:robot", "robot.terminal:show_robots",
        ),
        "robot new": Command(
            "write a first robot folder from any URDF, and say what is guessed",
            "cli.options.run:robot_new", "robot.terminal:show_new",
        ),
        "list": Command(
            "show experiments, robots, studies, effects, topics and bags",
            "cli.options.run:list_", "cli.listing:show",
        ),
        "schema": Command(
            "print the JSON Schema of a kind of YAML file, by which editors complete and check",
            "cli.options.run:schema", "cli.listing:show_schema",
        ),
        "top": Command(
            "show the running graph: rates, lateness, drops, CPU, phase",
            "cli.options.run:top", "doctor.top:show_top",
        ),
        "doctor": Command(
            "say why nothing moves (exit code 1: it has found a fault)",
            "cli.options.run:doctor", "doctor.terminal:show_doctor",
        ),
        "ros2": Command(
            "topic, node, param, service, action and run, as ros2 has them, without apt",
            "", "ros2.main:run",
        ),
        "hardware": Command(
            "ask the servos of a real robot, with the torque off (exit code 1: a fault)",
            "cli.options.run:hardware", "hardware.terminal:show_servos",
        ),
        "hardware simulate": Command(
            "serve simulated servos on a serial port, with effects and faults",
            "cli.options.run:hardware_simulate", "hardware.terminal:simulate",
        ),
        "estop": Command(
            "stop the robots that run: their joints are damped until a reset",
            "cli.options.run:estop", "cli.estop:show_estop",
        ),
    },
    "Record and read bags": {
        "record": Command(
            "record topics of any running graph to a bag",
            "cli.options.bags:record", "cli.logs:record",
        ),
        "replay": Command(
            "publish a bag's topics again, or test live controllers with it",
            "cli.options.bags:replay", "cli.logs:replay",
        ),
        "replay --verify": Command(
            "compare what live controllers answer with the bag, byte for byte",
            "cli.options.bags:replay", "record.verify_terminal:verify_bag",
        ),
        "info": Command(
            "show what a bag holds", "cli.options.bags:info", "cli.bags:info"
        ),
        "report": Command(
            "write one self-contained HTML page about a bag",
            "cli.options.bags:report", "report.terminal:show_report",
        ),
        "compare": Command(
            "write a page with two or more runs on the same axes, and what differs beyond noise",
            "cli.options.bags:compare", "report.compare:show_comparison",
        ),
        "view": Command(
            "show bags or a gap in Rerun: legs move, forces, curves; all but the first are ghosts",
            "cli.options.bags:view", "view.terminal:show_view",
        ),
        "view --layouts": Command(
            "write layouts for Foxglove and RViz",
            "cli.options.bags:view", "view.layouts_terminal:show_layouts",
        ),
        "recover": Command(
            "make a whole bag of a damaged or unfinished one",
            "cli.options.bags:recover", "cli.bags:recover",
        ),
        "export": Command(
            "write topics of a bag as CSV or NumPy files",
            "cli.options.bags:export", "cli.bags:export",
        ),
        "extract": Command(
            "copy some topics of a bag into a smaller bag",
            "cli.options.bags:extract", "cli.bags:extract",
        ),
    },
    "Learn from many runs": {
        "study": Command(
            "run a study: variants x grid x seeds, tables and maps (resumable)",
            "cli.options.fit:study", "study.terminal:show_study",
        ),
        "optimise": Command(
            "search a gait by CMA-ES over rollouts (resumable)",
            "cli.options.fit:optimise", "cli.optimise:run",
        ),
        "reinforce": Command(
            "improve the readout of a reflex by the policy gradient (resumable)",
            "cli.options.fit:reinforce", "reinforce.terminal:run",
        ),
        "reinforce ppo": Command(
            "the same readout by PPO of stable-baselines3",
            "cli.options.fit:reinforce_ppo", "reinforce.ppo:run",
        ),
        "reinforce contest": Command(
            "CMA-ES, two steps, three steps and PPO on equal simulated time (resumable)",
            "cli.options.fit:reinforce_contest", "reinforce.contest:run",
        ),
        "reproduce": Command(
            "run experiments of the thesis again, claim by claim (resumable)",
            "cli.options.fit:reproduce", "reproduce.terminal:run",
        ),
    },
    "Work on loco itself": {
        "install": Command(
            "install what only some commands need: view, rl, lerobot, dynamixel and more",
            "cli.options.workshop:install", "cli.install:install",
        ),
        "completion": Command(
            "print what makes a shell complete loco: eval \"$(loco completion bash)\" or zsh",
            "cli.options.workshop:completion", "cli.listing:show_completion",
        ),
        "test": Command(
            "run the tests (arguments go to pytest)", "", "loco_workshop.tests:run_tests"
        ),
        "bench": Command(
            "measure speed beside named baselines",
            "cli.options.workshop:bench", "loco_workshop.bench.bench:show_bench",
        ),
        "gap battery": Command(
            "many hidden effects: how often `loco gap` names the right one",
            "cli.options.gap:battery", "loco_workshop.battery.terminal:show_battery",
        ),
        "chaos": Command(
            "stop, kill and damage everything, and judge the robot (resumable)",
            "cli.options.workshop:chaos", "loco_workshop.stress.chaos_terminal:show_chaos",
        ),
        "crash": Command(
            "kill long commands and fill their disk, and see whether they come to the same end",
            "cli.options.workshop:crash", "loco_workshop.stress.crash_terminal:show_crash",
        ),
        "fuzz": Command(
            "damage input for the parsers of files, texts and messages (exit code 1: a find)",
            "cli.options.workshop:fuzz", "loco_workshop.fuzz.terminal:show_fuzz",
        ),
        "mutants": Command(
            "change the code that protects, and see whether tests notice (exit code 1: too few)",
            "cli.options.workshop:mutants", "loco_workshop.mutants.terminal:show_mutants",
        ),
        "soak": Command(
            "run a graph for long and see whether anything grows (exit code 1: it does)",
            "cli.options.workshop:soak", "loco_workshop.stress.soak_terminal:show_soak",
        ),
        "docs": Command(
            "print the generated tables of docs/ (topics, parameters)",
            "cli.options.workshop:docs", "loco_workshop.docs.reference:show_docs",
        ),
    },
}  # fmt: skip

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

    def __init__(self, **more: Any):
        super().__init__(**more)
        self.given: dict[str, Any] = {}
        for kind in (None, "store"):
            self.register("action", kind, Store)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parsed options and the remaining arguments; called by argparse."""
        self.given = {}
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Raise an exception for a wrong command line; called by argparse."""
        raise ParameterError(f"{cut(message, 400)}; see `{self.prog} --help`")


def load(target: str) -> Callable[..., Any]:
    """Import and return a function written as ``module:function``.

    Raises:
        MissingPackageError: A package of `EXTRAS` that the module needs is not installed.
        MissingFileError: The module is in ``tests/workshop``, and there is no clone.
    """
    module, _, function = target.partition(":")
    if module.startswith(f"{clone.WORKSHOP}."):
        clone.add_workshop()
    else:
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
    p = Parser(
        prog=f"loco {name.partition(' --')[0]}",
        allow_abbrev=False,
        description=command.text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    load(command.options)(p)
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
