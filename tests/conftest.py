# SPDX-License-Identifier: Apache-2.0
"""Every test process has a ROS graph, a log folder and a single BLAS thread of its own."""

from __future__ import annotations

import atexit
import fcntl
import os
import shutil
import tempfile
from pathlib import Path

import pytest

DOMAINS = range(1, 102)  # above 101 the ports of Fast DDS meet those of the system


def _claim_domain() -> int:
    """Take a ROS domain that no other test process uses, until this process ends.

    The claim is a lock on a file in the temporary folder: the system drops it
    however the process ends, and it is seen by xdist workers and other test runs.
    The file stays open on purpose; child processes do not inherit it.

    Raises:
        RuntimeError: All domains are taken.
    """
    for step in range(len(DOMAINS)):
        # Neighbours start at different places: a process that was killed may still be
        # leaving its domain.
        domain = DOMAINS[(os.getpid() + step) % len(DOMAINS)]
        path = Path(tempfile.gettempdir()) / f"loco_domain_{domain}.{os.getuid()}.lock"
        handle = os.open(path, os.O_CREAT | os.O_RDWR, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
        else:
            return domain
    raise RuntimeError(f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use by tests")


def _isolate() -> None:
    """Set what rclpy, NumPy and matplotlib read once, before they are imported."""
    logs = tempfile.mkdtemp(prefix="loco_test_logs_")
    atexit.register(shutil.rmtree, logs, ignore_errors=True)
    os.environ.update(
        ROS_DOMAIN_ID=str(_claim_domain()),
        ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
        ROS_LOG_DIR=logs,
        OMP_NUM_THREADS="1",
        OPENBLAS_NUM_THREADS="1",
        MPLBACKEND="Agg",
    )


_isolate()


@pytest.fixture(scope="session")
def repository() -> Path:
    """Root folder of the repository."""
    return Path(__file__).resolve().parent.parent
