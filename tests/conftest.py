# SPDX-License-Identifier: Apache-2.0
"""Every test process has a ROS graph, a log folder and a single BLAS thread of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from loco_bringup.testing import isolate

from . import quadrupeds

isolate()  # before anything reads the environment


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root folder of the repository."""
    return Path(__file__).resolve().parent.parent


@pytest.fixture
def quadruped(tmp_path):
    """Function that makes a folder of one of `quadrupeds.ROBOTS`, with more keys in robot.yaml."""
    return lambda name, **more: quadrupeds.write(tmp_path, name, **more)
