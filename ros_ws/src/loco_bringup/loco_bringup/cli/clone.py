# SPDX-License-Identifier: Apache-2.0
"""Location of the repository clone, which the commands for developers of loco need.

Their code is in ``tests/workshop``, which is not part of the installed packages.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from loco_control.exceptions import MissingFileError

WORKSHOP = "loco_workshop"  # package in tests/workshop


def root() -> Path:
    """Top folder of the clone that contains this module, as source or in its environment.

    Raises:
        MissingFileError: This module is not inside a clone.
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
    """Whether this module is inside a clone."""
    try:
        return bool(root())
    except MissingFileError:
        return False


def add_workshop() -> None:
    """Make the package `WORKSHOP` importable in this process and its child processes.

    Raises:
        MissingFileError: There is no clone.
    """
    folder = str(root() / "tests" / "workshop")
    if folder not in sys.path:
        sys.path.append(folder)
    paths = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    if folder not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join([*paths, folder])
