# SPDX-License-Identifier: Apache-2.0
"""Every test process has a ROS graph, a log folder and a single BLAS thread of its own."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from xdist.scheduler import LoadGroupScheduling

from loco_bringup.cli.clone import add_workshop
from loco_bringup.testing import isolate
from loco_control.exceptions import MissingPackageError, ParameterError
from loco_sim.engines import installed

from . import quadrupeds

isolate()  # before anything reads the environment
add_workshop()  # its packages are imported by tests and by the processes that they start


@pytest.fixture(autouse=True)
def signals():
    """No test leaves a signal to another handler: Ctrl-C and SIGTERM end the tests at any time."""
    before = _handlers()
    yield
    after = _handlers()
    for number, (handler, _) in before.items():
        signal.signal(number, handler)
    assert after == before, "the test left SIGINT or SIGTERM to another handler"


def _handlers():
    """What Python does at each signal, and whether the process has a handler of any language."""
    caught = int(Path("/proc/self/status").read_text().partition("SigCgt:")[2].split()[0], 16)
    return {
        number: (signal.getsignal(number), bool(caught >> (number - 1) & 1))
        for number in (signal.SIGINT, signal.SIGTERM)
    }


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root folder of the repository."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture
def quadruped(tmp_path):
    """Function that makes a folder of one of `quadrupeds.ROBOTS`, with more keys in robot.yaml."""
    return lambda name, **more: quadrupeds.write(tmp_path, name, **more)


class FilesTogether(LoadGroupScheduling):
    """Tests of a group stay together, and those of a file that are in none: they share fixtures."""

    def _assign_work_unit(self, node):
        from loco_workshop.tests import LONG

        for scope in filter(self.workqueue.__contains__, reversed(LONG)):
            self.workqueue.move_to_end(scope, last=False)
        super()._assign_work_unit(node)

    def _split_scope(self, nodeid):
        scope = super()._split_scope(nodeid)
        return nodeid.partition("::")[0] if scope == nodeid else scope


@pytest.hookimpl(optionalhook=True)  # `-p no:xdist` has no workers
def pytest_xdist_make_scheduler(config, log):
    """Say which tests stay on one worker; None for what the option ``--dist`` says."""
    return FilesTogether(config, log) if config.getoption("dist") == "loadgroup" else None


def pytest_collection_modifyitems(items):
    """Skip tests that compare with PyBullet where there is none."""
    for item in items:
        if "pybullet" not in installed() and item.get_closest_marker("pybullet"):
            item.add_marker(pytest.mark.skip(reason="compares with PyBullet"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item):
    """Skip a test of an engine that is not installed."""
    return (yield from _of_installed_engines())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Skip a test of an engine that is not installed."""
    return (yield from _of_installed_engines())


def _of_installed_engines():
    try:
        return (yield)
    except (MissingPackageError, ParameterError) as error:
        if "pybullet" in installed() or "pybullet" not in str(error).lower():
            raise
        pytest.skip(str(error))
