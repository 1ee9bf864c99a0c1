# SPDX-License-Identifier: Apache-2.0
"""`loco test`: run the tests of the clone, and keep figures of some selections of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from datetime import UTC, datetime
from pathlib import Path

from loco_bringup.cli.clone import root

from .reliability.figures import keep

# `loco test` without arguments: all tests, three workers, as those of the graph wait most of the
# time; and `loco test --cov`: with coverage, including node processes, which takes half as long
# again. The slowest tests are listed in each run.
ALL_TESTS = ["-q", "-n", "3", "--dist", "loadgroup", "--durations=40", "--durations-min=3"]
COVERED = ["--cov", "--cov-report=term:skip-covered", "--cov-fail-under=90"]

# Groups and files with few tests that take 15 s and more. They start first, and the others in the
# order of their number of tests, so that no worker has a long one when the others have ended.
LONG = ("graph", "tutorials", "colcon", "tests/workshop/test_wheel.py",
        "tests/loco_learning/gap/setup/test_drawn.py", "tests/workshop/stress/test_crash.py",
        "tests/loco_learning/gap/setup/test_torques.py", "tests/test_without_ros.py",
        "tests/loco_learning/gap/fleet/test_fleet.py", "tests/loco_bringup/hardware/test_page.py",
        "tests/workshop/docs/test_site.py", "tests/workshop/test_bodies.py")  # fmt: skip

# Tests in which numba compiles most kernels. They run before, on two workers and without coverage,
# under which its compiler takes three times as long; whatever process comes later finds them, where
# three workers would else compile each of them at once.
KERNELS = ["-q", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder",
           "tests/loco_sim/new_robot/test_make.py::test_an_arm_of_others_needs_no_engine_to_do_what_it_does_with_it",
           "tests/loco_control/stance/test_controller.py", "tests/loco_sim/msd/test_simulation.py",
           "tests/loco_sim/plant/test_compiled.py",
           "tests/workshop/battery/drawn/test_fleet.py::test_a_number_is_one_robot",
           "tests/loco_learning/runs/test_rollout.py::test_reset_of_the_loop_is_a_new_loop",
           "tests/loco_learning/runs/test_rollout.py::test_a_robot_with_legs_follows_oscillators_too",
           "tests/loco_sim/multibody/test_dynamics.py::test_torques_of_a_motion_are_those_of_its_rows",
           "tests/loco_sim/drives/test_damping.py::test_drives_keep_to_their_limits"]  # fmt: skip

# Selections of tests whose figures are kept: arguments, and what is required.
SUITES: dict[str, tuple[list[str], str]] = {
    "network": (
        ["tests/ros/test_network.py", "tests/ros/test_discovery.py"], "all pass, none is skipped",
    ),
    "whole suite": ([], "all pass"),
    "coverage": (["--cov"], "all pass, and cover 90 % of lines and branches"),
}  # fmt: skip
WHOLE = {"whole suite": ALL_TESTS, "coverage": [*ALL_TESTS, *COVERED]}

# Options of pytest that change what is told of the tests, neither which are run nor how; and those
# of them whose value is a word of its own where no "=" follows.
TELLING = ("--junit", "--durations", "--tb", "--color", "--verbosity", "-v", "-q", "-r", "-o", "-p")
VALUED = ("--junitxml", "--junit-xml", "--junit-prefix", "--durations", "--durations-min", "--tb",
          "--color", "--verbosity", "-r", "-o", "-p")  # fmt: skip


def run_tests(arguments: list[str]) -> int:
    """Run pytest in the root folder of the clone.

    Args:
        arguments: Arguments of pytest; empty for all tests, ``--cov`` alone for their coverage,
            options of `TELLING` for all tests, of which something else is told.

    Returns:
        The exit code of pytest.
    """
    name = next((name for name, (words, _) in SUITES.items() if words == arguments), "")
    with tempfile.TemporaryDirectory() as folder:
        results, coverage = Path(folder, "tests.xml"), Path(folder, "coverage.json")
        whole = name in WHOLE or only_tells(arguments)
        runs = [KERNELS, WHOLE.get(name, [*ALL_TESTS, *arguments])] if whole else [arguments]
        for chosen in runs:
            kept = [f"--junitxml={results}"] if name else []
            kept += [f"--cov-report=json:{coverage}"] if "--cov" in chosen else []
            words = [sys.executable, "-m", "pytest", *kept, *chosen]
            code = subprocess.run(words, cwd=root()).returncode
        if name and code in (0, 1) and results.exists():  # not interrupted
            _keep(name, results, coverage)
    return code


def only_tells(arguments: list[str]) -> bool:
    """Whether arguments of pytest leave all tests to be run, as `TELLING` says."""
    value = False  # the word belongs to the option before
    for word in arguments:
        if "xdist" in word or not (value or word.startswith(TELLING)):
            return False
        value = not value and word in VALUED
    return True


def _keep(name: str, results: Path, coverage: Path) -> None:
    """Keep counts, coverage and load of a selection of tests."""
    suite = ET.parse(results).getroot().find("testsuite")
    count = {key: int(suite.get(key)) for key in ("tests", "failures", "errors", "skipped")}
    failed = count["failures"] + count["errors"]
    passed = count["tests"] - failed - count["skipped"]
    holds = passed > 0 and not failed and not (name == "network" and count["skipped"])
    figures = {"passed": passed, "failed": failed, "skipped": count["skipped"]}
    figures |= {"minutes": round(float(suite.get("time")) / 60.0, 1)}
    figures |= {"load": round(os.getloadavg()[2], 1)}
    if coverage.exists():
        share = json.loads(coverage.read_text())["totals"]["percent_covered"]
        figures["covered %"] = round(share, 1)
        holds = holds and share >= 90.0
    part = name if name == "network" else f"{datetime.now(UTC):%Y-%m-%d %H:%M}"
    keep(root() / "results" / name.replace(" ", "_"), name, {part: (holds, figures)})
