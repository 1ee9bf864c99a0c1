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

# Tests in which numba compiles most kernels. They run before, on two workers and without coverage,
# under which its compiler takes three times as long; whatever process comes later finds them.
KERNELS = ["-q", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder",
           "tests/loco_sim/new_robot/test_make.py::test_an_arm_of_others_needs_no_engine_to_do_what_it_does_with_it",
           "tests/loco_control/stance/test_controller.py", "tests/loco_sim/msd/test_simulation.py",
           "tests/loco_sim/plant/test_compiled.py"]  # fmt: skip


def run_tests(arguments: list[str]) -> int:
    """Run pytest in the root folder of the clone.

    Args:
        arguments: Arguments of pytest; empty for all tests with coverage.

    Returns:
        The exit code of pytest.
    """
    for chosen in [arguments] if arguments else [KERNELS, ALL_TESTS]:
        code = subprocess.run([sys.executable, "-m", "pytest", *chosen], cwd=root()).returncode
    return code
