# SPDX-License-Identifier: Apache-2.0
"""Every test process has a ROS graph, a log folder and a single BLAS thread of its own."""

from __future__ import annotations

import importlib
import signal
from pathlib import Path

import coverage
import pytest

from loco_bringup.cli.clone import add_workshop
from loco_bringup.testing import isolate
from loco_control.exceptions import MissingPackageError, ParameterError
from loco_sim.engines import installed
from loco_sim.world.world import MODULES

from . import quadrupeds

UNTRACED = Path(__file__).with_name("untraced.txt")
WHOLLY = pytest.StashKey[bool]()  # without coverage, with its fixtures

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


@pytest.fixture(scope="session", autouse=True)
def _engines(request):
    """Under coverage engines are loaded here: their first test may be one without it."""
    for name in installed() if request.config.pluginmanager.hasplugin("_cov") else ():
        importlib.import_module(MODULES[name], "loco_sim.world")


@pytest.fixture(autouse=True)
def untraced(request, monkeypatch):
    """The processes of a test without coverage are not traced either."""
    if request.node.get_closest_marker("no_cover"):
        monkeypatch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)


def pytest_collection_modifyitems(items):
    """Trace nothing of `UNTRACED`; skip tests that compare with PyBullet where there is none."""
    without = {UNTRACED.parent / line for line in UNTRACED.read_text().splitlines()}
    for item in items:
        item.stash[WHOLLY] = not without.isdisjoint((item.path, *item.path.parents))
        if Path(f"{item.path}::{getattr(item, 'originalname', '')}") in without:
            item.add_marker(pytest.mark.no_cover)
        if "pybullet" not in installed() and item.get_closest_marker("pybullet"):
            item.add_marker(pytest.mark.skip(reason="compares with PyBullet"))


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session):
    """End what a worker of pytest-xdist began with, as it would go on in each pause of coverage.

    The environment starts a first coverage, the options of pytest a second one, and pytest-cov now
    that of the tests; the latest is paused, and the one before it is resumed.
    """
    while hasattr(session.config, "workerinput") and (started := coverage.Coverage.current()):
        started.stop()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item):
    """Fixtures of a file without coverage are not traced either."""
    controller = getattr(item.config.pluginmanager.getplugin("_cov"), "cov_controller", None)
    if not (controller and item.stash[WHOLLY]):
        return (yield)
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)
        controller.pause()
        try:
            return (yield)
        finally:
            controller.resume()


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
