# SPDX-License-Identifier: Apache-2.0
"""The clone of the repository, from which the commands that work on loco itself run.

What they do is in ``tests/workshop``, which no package and no wheel holds.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from loco_control.exceptions import MissingFileError

WORKSHOP = "loco_workshop"  # package in tests/workshop


def root() -> Path:
    """Top folder of the clone that holds this module, installed in it or as source.

    Raises:
        MissingFileError: There is no clone around it.
    """
    module = Path(__file__).resolve()
    for folder in module.parents:
        if (folder / "tests" / "workshop" / WORKSHOP).is_dir():
            return folder
    raise MissingFileError(
        f"this command runs from a clone of the repository, and {module.parent} is in none; "
        "start it there as `./loco`"
    )


def is_one() -> bool:
    """Whether a clone holds this module."""
    try:
        return bool(root())
    except MissingFileError:
        return False


def add_workshop() -> None:
    """Let this process and those that it starts import the package `WORKSHOP`.

    Raises:
        MissingFileError: There is no clone.
    """
    folder = str(root() / "tests" / "workshop")
    if folder not in sys.path:
        sys.path.append(folder)
    paths = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    if folder not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join([*paths, folder])
