# SPDX-License-Identifier: Apache-2.0
"""`loco install` outside a clone: install the packages of extras with pip.

In a clone the script `loco` installs them, at the versions of its lock file.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import re
import subprocess
import sys

from loco_control.exceptions import MissingFileError, MissingPackageError, NameUnknownError

from . import clone

DISTRIBUTION = "loco-gap"
EXTRA = re.compile(r"\s*(?:and)?\s*extra\s*==\s*['\"]([\w-]+)['\"]")


def requirements() -> dict[str, list[str]]:
    """Requirements of each extra, in pip's notation."""
    by_extra: dict[str, list[str]] = {}
    for line in importlib.metadata.requires(DISTRIBUTION) or ():
        for extra in EXTRA.findall(line):
            text, _, marker = EXTRA.sub("", line).partition(";")
            marker = marker.strip().removeprefix("(").removesuffix(")")
            by_extra.setdefault(extra, []).append(f"{text.strip()} ; {marker}" if marker else text)
    return by_extra


def install(a: argparse.Namespace) -> int:
    """Install the packages of an extra; returns the exit code.

    Raises:
        NameUnknownError: There is no such extra.
        MissingPackageError: The environment has no pip.
    """
    try:
        return subprocess.call([clone.root() / "loco", "install", *a.extra])
    except MissingFileError:
        available = requirements()
    for extra in a.extra:
        if extra not in available:
            raise NameUnknownError("extra", extra, available)
    needed = [line.strip() for extra in a.extra for line in available[extra]]
    if importlib.util.find_spec("pip") is None:
        raise MissingPackageError(
            "this environment has no pip: add them where it was made, such as `uvx --with` or "
            f"`pipx inject {DISTRIBUTION}`: {', '.join(needed)}"
        )
    return subprocess.call([sys.executable, "-m", "pip", "install", *needed])
