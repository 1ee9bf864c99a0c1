# SPDX-License-Identifier: Apache-2.0
"""Errors of loco: each is a `LocoError` and also the built-in exception that fits it.

A command-line user sees the message alone, so a message names the value, the
limit and the legal choices. Quoted input may have any length; `cut` shortens it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Any

MOST = 200  # longest value in a message [characters]
DEFAULT_LENGTH = 60  # default number of characters of a value in `shown`
_MAX_MESSAGE = 2000  # longest message [characters]
_TAIL = 79  # characters retained from the end of a cut value: the name of a file
# Quoted texts, and words; an apostrophe within a word does not begin a quotation.
_VALUE = re.compile(
    r"(?<!\w)'(?:[^'\\]|\\.){%d,}?'(?!\w)|\"(?:[^\"\\]|\\.){%d,}?\"|\S{%d,}" % (MOST, MOST, MOST + 1)
)
_OPEN, _CLOSE = "[{", "]}"


def cut(text: str, max_length: int = MOST) -> str:
    """A text of at most `max_length` characters, with a mark where its middle was removed."""
    tail = min(_TAIL, max_length // 2)
    return text if len(text) <= max_length else f"{text[: max_length - tail - 1]}…{text[-tail:]}"


def shown(value: Any, max_length: int = DEFAULT_LENGTH) -> str:
    """The repr of a value for a message, cut after `max_length` characters."""
    if isinstance(value, (str, bytes)):
        value = value[: max_length + 1]  # the repr of a large value takes long
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001, a number of 5,000 digits, and objects of others
        text = f"a {type(value).__name__} that cannot be printed"
    return text if len(text) <= max_length else f"{text[: max_length - 1]}…"


def short(message: str) -> str:
    """A message with each of its words, quoted texts and lists cut to `MOST` characters."""
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
    return cut(_VALUE.sub(lambda match: cut(match[0]), "".join(parts)), _MAX_MESSAGE)


class LocoError(Exception):
    """Base of every error that a user's input can cause; `short` limits its message.

    Attributes:
        lines: Whether a message may have several lines; else line breaks become spaces.
    """

    lines = False

    def __init__(self, *arguments: object):
        super().__init__(*(self._short(a) if isinstance(a, str) else a for a in arguments))

    def _short(self, message: str) -> str:
        return short(message if self.lines else re.sub(r"\s*[\r\n]\s*", " ", message))


class ParameterError(LocoError, ValueError):
    """A parameter has the wrong type, is out of range or is not known."""


class NameUnknownError(LocoError, KeyError):
    """A name is not in its registry; the message lists the known names."""

    def __init__(self, kind: str, name: str, names: Iterable[str]):
        names, quoted = sorted(names), shown(name, MOST)
        close = difflib.get_close_matches(quoted.strip("'"), names, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        super().__init__(f"no {kind} named {quoted}{hint}; available: {', '.join(names) or 'none'}")

    def __str__(self) -> str:  # KeyError would print the repr of the message
        return str(self.args[0])

    def __reduce__(self) -> tuple:  # the message survives pickling between worker processes
        return _restore, (type(self), self.args)


class MissingFileError(LocoError, FileNotFoundError):
    """A file or folder that the user named does not exist or cannot be read."""


class BagError(LocoError, ValueError):
    """A bag cannot be read, or lacks the requested data."""


class MissingPackageError(LocoError, ImportError):
    """A Python package that a command needs is not installed."""


class GraphError(LocoError, RuntimeError):
    """The node graph did not start, lost a node or stopped ticking."""

    lines = True  # the message quotes the last lines of the log of a process that ended


class DivergedError(LocoError, ArithmeticError):
    """The simulated state is no longer finite."""


def _restore(kind: type[LocoError], arguments: tuple) -> LocoError:
    """The error of a pickled class and its arguments."""
    error = kind.__new__(kind)
    error.args = arguments
    return error
