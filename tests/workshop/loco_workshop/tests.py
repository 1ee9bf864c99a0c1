# SPDX-License-Identifier: Apache-2.0
"""`loco test`: the tests of the clone."""

from __future__ import annotations

import subprocess
import sys

from loco_bringup.cli.clone import root

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
    """
    command = [sys.executable, "-m", "pytest", *(arguments or ALL_TESTS)]
    return subprocess.run(command, cwd=root()).returncode
