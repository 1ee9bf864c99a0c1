# SPDX-License-Identifier: Apache-2.0
"""`loco test`: run the tests of the clone."""

from __future__ import annotations

import subprocess
import sys

from loco_bringup.cli.clone import root

# `loco test` without arguments: all tests, two workers, with coverage including node processes.
# The slowest tests are listed in each run.
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
