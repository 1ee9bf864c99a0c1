# SPDX-License-Identifier: Apache-2.0
"""Notes on changes to a robot, each with the names of the changed links or joints."""

from __future__ import annotations

MAX_NAMES = 4  # largest number of names in one sentence


class Notes:
    """Collection of sentences; equal ones for several names are combined.

    Attributes:
        names: Names by sentence, in order of insertion.
    """

    def __init__(self) -> None:
        self.names: dict[str, list[str]] = {}

    def add(self, text: str, name: str = "") -> None:
        """Add a sentence, or a name to an existing one.

        Args:
            text: The sentence, without names.
            name: Link or joint concerned; "" for the whole robot.
        """
        names = self.names.setdefault(text, [])
        if name and name not in names:
            names.append(name)

    def sentences(self) -> list[str]:
        """The sentences with their names."""
        return [f"{text}: {listed(names)}" if names else text for text, names in self.names.items()]


def listed(names: list[str]) -> str:
    """The first names of a list, and the number of the remaining ones."""
    listing = ", ".join(names[:MAX_NAMES])
    return listing if len(names) <= MAX_NAMES else f"{listing} and {len(names) - MAX_NAMES} more"
