# SPDX-License-Identifier: Apache-2.0
"""Errors of loco: each is a `LocoError` and the built-in kind it stands for.

A command-line user sees the message alone, so a message names the value, the
limit and the legal choices. Values of others may be of any length: each is cut by `cut`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

MOST = 200  # characters of a value in a message
SHOWN = 60  # characters of a value that `shown` shows, if nothing else is asked for
_WHOLE = 2000  # characters of a message
_TAIL = 79  # characters of the end that stay of a cut value: the name of a file
# A text in quotes, and a word: an apostrophe within a word is none.
_VALUE = re.compile(
    r"(?<!\w)'(?:[^'\\]|\\.){%d,}?'(?!\w)|\"(?:[^\"\\]|\\.){%d,}?\"|\S{%d,}" % (MOST, MOST, MOST + 1)
)
_OPEN, _CLOSE = "[{", "]}"


def cut(text: str, most: int = MOST) -> str:
    """A text of at most so many characters, with a sign where its middle is missing."""
    tail = min(_TAIL, most // 2)
    return text if len(text) <= most else f"{text[: most - tail - 1]}…{text[-tail:]}"


def shown(value: Any, max_length: int = SHOWN) -> str:
    """A value as messages show it: its repr, cut after `max_length` characters."""
    if isinstance(value, (str, bytes)):
        value = value[: max_length + 1]  # the repr of a whole file takes long
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001, a number of 5,000 digits, and objects of others
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= max_length else f"{text[: max_length - 1]}…"


def short(message: str) -> str:
    """A message whose values have at most `MOST` characters each: words, quoted texts, lists."""
    if len(message) <= MOST:
        return message
    parts, depth, start = [], 0, 0
    for at, mark in enumerate(message[: 10**6]):
        if mark in _OPEN:
            if not depth:
                parts.append(message[start:at])
                start = at
            depth += 1
        elif mark in _CLOSE and depth:
            depth -= 1
            if not depth:
                parts.append(cut(message[start : at + 1]))
                start = at + 1
    parts.append(cut(message[start:]) if depth else message[start:])
    return cut(_VALUE.sub(lambda match: cut(match[0]), "".join(parts)), _WHOLE)


class LocoError(Exception):
    """Base of every error that a user's input can cause; its message is cut by `short`.

    Attributes:
        lines: Whether a message may have several lines; else those of a value become one.
    """

    lines = False

    def __init__(self, *arguments: object):
        super().__init__(*(self._short(a) if isinstance(a, str) else a for a in arguments))

    def _short(self, message: str) -> str:
        return short(message if self.lines else re.sub(r"\s*[\r\n]\s*", " ", message))


class ParameterError(LocoError, ValueError):
    """A parameter has the wrong type, is out of range or is not known."""


class NameUnknownError(LocoError, KeyError):
    """A name is not in its registry; the message lists the names that are."""

    def __init__(self, kind: str, name: str, names: Iterable[str]):
        names, given = sorted(names), shown(name, MOST)
        close = difflib.get_close_matches(given.strip("'"), names, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        super().__init__(f"no {kind} named {given}{hint}; available: {', '.join(names) or 'none'}")

    def __str__(self) -> str:  # KeyError would print the repr
        return str(self.args[0])

    def __reduce__(self) -> tuple:  # an error of a worker comes back with its message
        return _again, (type(self), self.args)


class MissingFileError(LocoError, FileNotFoundError):
    """A file or folder that the user named does not exist or cannot be read."""


class BagError(LocoError, ValueError):
    """A bag cannot be read, or does not hold what was asked of it."""


class MissingPackageError(LocoError, ImportError):
    """A Python package that a command needs is not installed."""


class GraphError(LocoError, RuntimeError):
    """The node graph did not start, lost a node or stopped ticking."""

    lines = True  # the last ones of a process that died


class DivergedError(LocoError, ArithmeticError):
    """The simulated state is no longer finite."""


def _again(kind: type[LocoError], arguments: tuple) -> LocoError:
    """An error of a kind with the arguments that it had."""
    error = kind.__new__(kind)
    error.args = arguments
    return error
