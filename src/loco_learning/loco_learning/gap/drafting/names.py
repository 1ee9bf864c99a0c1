# SPDX-License-Identifier: Apache-2.0
"""Roles and joints of columns, from the names of all columns of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from . import words


def guesses(spelled: Mapping[str, str], joints: Sequence[str]) -> dict[str, words.Guess]:
    """Guess for each name, also by the other names.

    Args:
        spelled: Names, each with the text to read (`words.spelled_out`).
        joints: Joint names of the robot; empty if the robot is not known.
    """
    guesses = {name: words.guess(text, joints) for name, text in spelled.items()}
    commands = {words.stem(spelled[name]): guess.role for name, guess in guesses.items()
                if guess.role.startswith("command_")}  # fmt: skip
    read = {guess.joint for guess in guesses.values() if guess.role == "q"} - {""}
    guesses |= {name: words.measured(name, guess, commands[words.stem(name)])
                for name, guess in guesses.items() if not guess.role and is_measured(name)
                and guess.joint not in read and words.stem(name) in commands}  # fmt: skip
    read = {guess.joint for guess in guesses.values() if guess.role == "q"}
    guesses |= {name: words.position(name, guess.joint) for name, guess in guesses.items()
                if not guess.role and guess.joint not in read
                and words.is_joint_name(name, guess.joint)}  # fmt: skip
    return guesses | _in_order(guesses, joints) | _rates(guesses, spelled)


def _rates(
    guesses: Mapping[str, words.Guess], spelled: Mapping[str, str]
) -> dict[str, words.Guess]:
    """Guesses for goals that say no quantity, of joints of which only velocities were measured."""
    rates = {words.subject(spelled[name]): guess for name, guess in guesses.items()
             if guess.role == "dq"}  # fmt: skip
    of_angles = {
        words.subject(spelled[name]) for name, guess in guesses.items() if guess.role == "q"
    }
    return {
        name: replace(guess, role="command_velocity", unit=rates[subject].unit,
                      why=f"{guess.why} beside a velocity")
        for name, guess in guesses.items()
        if guess.role == "command_position" and not words.says_quantity(spelled[name])
        and (subject := words.subject(spelled[name])) in rates.keys() - of_angles
    }  # fmt: skip


def _in_order(guesses: Mapping[str, words.Guess], joints: Sequence[str]) -> dict[str, words.Guess]:
    """Guesses for names of which none names a joint: their subjects in the order of the joints.

    An example is a table with cart_pos and pole_angle of a robot with the joints rail and hinge.
    Empty unless there are as many subjects as joints, each with a position.
    """
    telling = {name: guess for name, guess in guesses.items() if guess.role}
    if any(guess.joint or any(map(str.isdigit, words.split_name(name)))
           for name, guess in telling.items()):  # fmt: skip
        return {}
    subjects = list(dict.fromkeys(words.subject(name) for name in telling))
    positions = {words.subject(name) for name, guess in telling.items() if guess.role == "q"}
    if len(joints) < 2 or len(subjects) != len(joints) or positions != set(subjects):
        return {}
    names = dict(zip(subjects, joints, strict=True))
    return {
        name: replace(guess, joint=names[words.subject(name)],
                      why=f"{guess.why}, by the order of the joints: in this order?")
        for name, guess in telling.items()
    }  # fmt: skip


def by_number(
    guesses: Mapping[str, words.Guess],
    spelled: Mapping[str, str],
    labels_of: Mapping[str, Sequence[str]],
    joints: Sequence[str],
) -> dict[str, str]:
    """Joint of each name that has the number of one, by name.

    Args:
        guesses: Guess for each name.
        spelled: Names, each with the text to read.
        labels_of: Values of columns of texts.
        joints: Joint names of the robot; empty if the robot is not known.
    """
    numbers = words.numbers(spelled.values(), joints)
    labels = {i: values[0] for name, values in labels_of.items()
              if len(values) == 1 and (i := words.number_of_name(name)) is not None}  # fmt: skip
    counted = [(guess.role, numbers[spelled[name]]) for name, guess in guesses.items()
               if guess.role and numbers[spelled[name]] is not None]  # fmt: skip
    angles = [i for role, i in counted if role == "q"] or [i for _, i in counted]
    of_number = labels or words.numbered(angles, joints)
    groups: dict[tuple[str, ...], list[str]] = {}  # names that differ in their number alone
    for name, text in spelled.items():
        template = tuple(w for w in words.split_name(text) if not w.isdigit())
        groups.setdefault(template, []).append(name)
    result = dict.fromkeys(spelled, "")
    for names in groups.values():  # counted from 0 beside joints that are named from 1
        indices = {numbers[spelled[name]] for name in names} - {None}
        joint_of = words.numbered(indices, joints) if indices - of_number.keys() else of_number
        joint_of = of_number if labels else joint_of
        result |= {name: joint_of.get(numbers[spelled[name]], "") for name in names}
    return result


def is_measured(name: str) -> bool:
    """True if the name of a column says that it is measured."""
    return not words.MEASURED.isdisjoint(words.split_name(name))
