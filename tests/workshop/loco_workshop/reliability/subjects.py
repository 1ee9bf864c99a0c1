# SPDX-License-Identifier: Apache-2.0
"""Subjects of `loco reliability`: what is measured, by which command, and what it should reach."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..fuzz.targets import TARGETS
from ..mutants.run import BY_HAND, PROTECTING
from ..stress.crash import COMMANDS
from ..tests import SUITES
from .figures import Figure


@dataclass(frozen=True)
class Subject:
    """Measurements of one kind, and the command that takes them.

    Attributes:
        command: Words after ``./loco`` of the command that measures all parts.
        required: Requirement for a part.
        parts: Names of the parts, all of which have to be measured; none for a subject whose
            newest `MOST` measurements count.
    """

    command: str
    required: str
    parts: tuple[str, ...]


MOST = 10
SUBJECTS = {
    "fuzz": Subject(
        "fuzz all --inputs 100000 --seed 7", "no finds", tuple(TARGETS)
    ),
    "mutants": Subject("mutants", "90 % are noticed", tuple(PROTECTING)),
    "mutants drawn": Subject("mutants --only gap/ --limit 200", "90 % are noticed", ("gap/",)),
    "mutants by hand": Subject("mutants --by-hand", "90 % are noticed", tuple(BY_HAND)),
    "chaos": Subject(
        "chaos", "safe within 20 ticks, bags recovered, nothing left",
        ("SIGSTOP", "SIGKILL", "rough", "faults"),
    ),
    "damage": Subject(
        "bench damage", "no chunk missed, no wrong data, no traceback",
        ("truncated", "byte changed"),
    ),
    **{
        name: Subject(line, "every end has the same bytes, nothing torn or left", tuple(COMMANDS))
        for name, line in (
            ("crash", "crash --kills 20 --disks 0"), ("full disks", "crash --kills 0 --disks 3"),
        )
    },
    "soak": Subject("soak", "nothing grows", ("hyq_trot_reflex",)),
    **{
        name: Subject(f"test {' '.join(words)}".strip(), required, (name,) if words else ())
        for name, (words, required) in SUITES.items()
    },
}  # fmt: skip


def complete(figures: Iterable[Figure]) -> list[Figure]:
    """Figures of all parts in the order of the subjects, empty ones for those not measured.

    Parts that no longer exist are left out.
    """
    found = {(each.subject, each.part): each for each in figures}
    rows = []
    for name, subject in SUBJECTS.items():
        measured = sorted((f for f in found.values() if f.subject == name), key=lambda f: f.date)
        parts = subject.parts or [each.part for each in measured[-MOST:]] or [name]
        rows += [found.get((name, part), Figure(name, part)) for part in parts]
    return rows


def missing(figures: Iterable[Figure]) -> list[str]:
    """Names of the subjects with a part that was not measured."""
    return list(dict.fromkeys(each.subject for each in complete(figures) if not each.date))
