# SPDX-License-Identifier: Apache-2.0
"""`loco test`: the tests of the clone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from loco_control.exceptions import MissingFileError

# `loco test` alone: everything, two at a time, with coverage of the nodes' processes too.
# The slowest are listed, so that what makes a run long is seen in each.
ALL_TESTS = ["-q", "-n", "2", "--dist", "loadgroup", "--durations=40", "--durations-min=3",
             "--cov", "--cov-report=term:skip-covered", "--cov-fail-under=90"]  # fmt: skip


def run_tests(arguments: list[str]) -> int:
    """Run pytest in the root folder of the clone.

    Args:
        arguments: Arguments of pytest; empty for all tests with coverage.

    Returns:
        The exit code of pytest.

    Raises:
        MissingFileError: This is an installed package, not a clone.
    """
    root = Path(__file__).resolve().parents[5]
    if not (root / "tests").is_dir():
        raise MissingFileError(
            f"no tests folder in {root}; run this from a clone of the repository"
        )
    command = [sys.executable, "-m", "pytest", *(arguments or ALL_TESTS)]
    return subprocess.run(command, cwd=root).returncode
