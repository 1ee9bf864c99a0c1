# SPDX-License-Identifier: Apache-2.0
"""Errors of loco: each is a `LocoError` and the built-in kind it stands for.

A command-line user sees the message alone, so a message names the value, the
limit and the legal choices.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class LocoError(Exception):
    """Base of every error that a user's input can cause."""


class ParameterError(LocoError, ValueError):
    """A parameter has the wrong type, is out of range or is not known."""


class NameUnknownError(LocoError, KeyError):
    """A name is not in its registry; the message lists the names that are."""

    def __init__(self, kind: str, name: str, known: Iterable[str]):
        known = sorted(known)
        close = difflib.get_close_matches(str(name), known, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        self.message = f"no {kind} named {name!r}{hint}; available: {', '.join(known) or 'none'}"
        super().__init__(self.message)

    def __str__(self) -> str:  # KeyError would print the repr
        return self.message


class MissingFileError(LocoError, FileNotFoundError):
    """A file or folder that the user named does not exist or cannot be read."""


class BagError(LocoError, ValueError):
    """A bag cannot be read, or does not hold what was asked of it."""


class MissingPackageError(LocoError, ImportError):
    """A Python package that a command needs is not installed."""


class GraphError(LocoError, RuntimeError):
    """The node graph did not start, lost a node or stopped ticking."""


class DivergedError(LocoError, ArithmeticError):
    """The simulated state is no longer finite."""
