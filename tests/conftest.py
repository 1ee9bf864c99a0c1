# SPDX-License-Identifier: Apache-2.0
"""Every test process has a ROS graph, a log folder and a single BLAS thread of its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from loco_bringup.testing import isolate

isolate()  # before anything reads the environment


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root folder of the repository."""
    return Path(__file__).resolve().parent.parent
