# SPDX-License-Identifier: Apache-2.0
"""`loco docs --site`: static web site with the pages of ``docs/`` and the code reference."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from loco_control.exceptions import LocoError, MissingPackageError


def build(root: Path, out: Path) -> None:
    """Build the site of a clone; a broken link is an error.

    Args:
        root: Top folder of the clone, with its ``mkdocs.yml``.
        out: Folder of the site; its content is replaced.

    Raises:
        MissingPackageError: mkdocs is not installed.
        LocoError: A page has an error, which the message describes.
    """
    if find_spec("mkdocs") is None:
        raise MissingPackageError("mkdocs is not installed; `./loco install docs` brings it")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "-d", str(out.resolve())]
    done = subprocess.run(command, cwd=root, check=False, capture_output=True, text=True)
    if done.returncode:
        warnings = [line for line in done.stderr.splitlines() if line.startswith(("WARN", "ERR"))]
        raise LocoError("\n".join(["the site was not built", *(warnings or [done.stderr])]))
