# SPDX-License-Identifier: Apache-2.0
"""Sentences about what was changed in a robot, each with the names that it holds for."""

from __future__ import annotations

SHOWN = 4  # names in one sentence


class Notes:
    """Collects sentences; one that holds for several names stands once.

    Attributes:
        names: Names of each sentence, in the order in which they came.
    """

    def __init__(self) -> None:
        self.names: dict[str, list[str]] = {}

    def add(self, text: str, name: str = "") -> None:
        """Add a sentence, or a name to one that is there.

        Args:
            text: The sentence, without names.
            name: Link or joint that it holds for; empty for the whole robot.
        """
        names = self.names.setdefault(text, [])
        if name and name not in names:
            names.append(name)

    def sentences(self) -> list[str]:
        """The sentences with their names."""
        return [f"{text}: {listed(names)}" if names else text for text, names in self.names.items()]


def listed(names: list[str]) -> str:
    """The first of some names, and how many there are more."""
    shown = ", ".join(names[:SHOWN])
    return shown if len(names) <= SHOWN else f"{shown} and {len(names) - SHOWN} more"
