# SPDX-License-Identifier: Apache-2.0
"""An option that is given twice is there twice, or refused; nothing is lost without a word."""

import argparse

import pytest

from loco_bringup import settings
from loco_bringup.cli.table import COMMANDS, Parser, parse, parser
from loco_bringup.gap import terminal
from loco_bringup.gap.run import Job
from loco_control.exceptions import ParameterError

NAMES = [name for name, command in COMMANDS.items() if command.options]


def options_of(name):
    """Options of a command that take values."""
    return [a for a in parser(name)._actions if a.option_strings and a.nargs != 0]


def texts(action, count=2):
    """Values that an option takes."""
    if action.choices:
        return [str(list(action.choices)[i % len(action.choices)]) for i in range(count)]
    return [f"{i + 1}" if action.type in (int, float) else f"x{i}" for i in range(count)]


def filled(name, but):
    """Words for the arguments and options that a command must have, without one of them."""
    words = []
    for action in parser(name)._actions:
        if action.required and action is not but and action.option_strings != but.option_strings:
            words += [*action.option_strings[:1], *texts(action, 1)]
    return words


@pytest.mark.parametrize("name", NAMES)
def test_every_option_of_every_command_grows_or_is_refused(name):
    """Written twice, with one value each; a third kind of answer would be a silent loss."""
    for action in options_of(name):
        option, (first, second) = action.option_strings[0], texts(action)
        line = [*name.split()[:1], *filled(name, action), option, first, option, second]
        line = name.split() + line[1:] if " --" not in name else line
        try:
            _, options = parse(line)
        except ParameterError as error:
            assert f"{option}" in str(error) and "given twice" in str(error), line
            continue
        values = getattr(options, action.dest)
        assert isinstance(values, list) and len(values) == 2, line


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("gap a --robot b --robot c", "argument --robot: given twice, 'b' and 'c'"),
        ("gap a --out b --output c", "--out.* given twice"),
        ("run hyq_short --seed 1 --seed 1", "--seed: given twice"),
        ("run hyq_short --layout rollout --layout composed", "--layout: given twice"),
    ],
)
def test_a_single_value_given_twice_is_refused(line, words):
    with pytest.raises(ParameterError, match=words):
        parse(line.split())


def test_lists_given_twice_are_there_twice():
    _, a = parse("gap x --robot y --effects A B --hold-out p --effects C --hold-out q".split())
    assert (a.effects, a.hold_out) == (["A", "B", "C"], ["p", "q"])
    _, again = parse("gap x --robot y --effects D".split())
    assert again.effects == ["D"]


def test_a_default_is_replaced_and_a_parser_remembers_no_line():
    one = Parser(prog="one")
    one.add_argument("--many", nargs="+", default=["d"])
    one.add_argument("--single", default="d")
    for _ in range(2):
        a = one.parse_args(["--many", "a", "--single", "b", "--many", "c"])
        assert a == argparse.Namespace(many=["a", "c"], single="b")
    assert one.parse_args([]) == argparse.Namespace(many=["d"], single="d")


@pytest.mark.parametrize(
    ("pairs", "seed", "words"),
    [
        (["a=1", "a=2"], None, "--set a is given twice, 1 and 2"),
        (["seed=4"], 3, "seed is given twice, 3 by an option of its own and 4 by --set"),
        (["sim.engine=mujoco"], None, "sim.engine is given twice"),
    ],
)
def test_a_key_given_twice_is_refused(pairs, seed, words):
    with pytest.raises(ParameterError, match=words):
        settings.overrides(pairs, seed, "pybullet")


def test_effects_by_an_option_and_by_set_are_refused():
    line = "gap a --robot b --effects coulomb_friction --set effects=[viscous_friction]"
    with pytest.raises(ParameterError, match="effects is given twice"):
        terminal.job_of(parse(line.split())[1])


def test_what_is_given_to_results_replaces_what_they_were_made_with(tmp_path):
    Job("servo_pendulum", ("a",), options={"effects": ["coulomb_friction"], "seed": 3}).save(tmp_path)
    job, _ = terminal.job_of(parse(["gap", str(tmp_path), "--add", "b", "--effects", "push"])[1])
    assert job.options == {"effects": ["push"], "seed": 3}
    job, _ = terminal.job_of(parse(["gap", str(tmp_path), "--add", "b", "--seed", "0"])[1])
    assert job.options == {"effects": ["coulomb_friction"], "seed": 0}
