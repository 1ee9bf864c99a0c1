# SPDX-License-Identifier: Apache-2.0
"""A trot without physics: states and targets with the rhythm of the real ones."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from loco_control.types import GaitTarget, RobotState
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout

DT = 0.004


def state_at(tick: int, force: float = 415.7) -> RobotState:
    """Diagonal pairs that carry the weight in turns, at 1.7 Hz from 0.1 s on."""
    t = tick * DT
    angle = 2.0 * np.pi * 1.7 * max(t - 0.1, 0.0)
    load = np.clip(0.5 + 2.0 * np.sin(angle + np.array([0.0, np.pi, np.pi, 0.0])), 0.0, 1.0)
    grf = np.zeros((4, 3))
    grf[:, 2] = force * load
    zero = np.zeros(12)
    orientation = np.array([0.0, 0.0, 0.0, 1.0])
    return RobotState(
        tick, t, zero, zero, zero, grf, orientation, np.zeros(3), np.zeros(3), load > 0.1
    )


def target_at(tick: int) -> GaitTarget:
    """Joint sines of the same rhythm with a second harmonic."""
    t = tick * DT
    angle = 2.0 * np.pi * 1.7 * max(t - 0.1, 0.0) + np.arange(12)
    q = 0.3 * np.sin(angle) + 0.1 * np.cos(2.0 * angle)
    dq = 2.0 * np.pi * 1.7 * (0.3 * np.cos(angle) - 0.2 * np.sin(2.0 * angle))
    feet = np.zeros((4, 3))
    phase = (1.7 * t + np.array([0.0, 0.5, 0.5, 0.0])) % 1.0
    return GaitTarget(tick, t, q, dq, feet, feet, phase, 0.25, 1.7, phase < 0.5)


@pytest.fixture
def drive():
    """Function that runs a network over ticks [start, stop) of the fake trot."""

    def run(network, start, stop, force=415.7):
        return [
            network.step(k, k * DT, state_at(k, force).grf[:, 2], target_at(k))
            for k in range(start, stop)
        ]

    return run


@pytest.fixture(scope="session")
def short_log():
    """Log of the experiment hyq_short; do not change it."""
    return rollout(load("hyq_short"))


@pytest.fixture(scope="module")
def cluster():
    """Address of a dask scheduler with 2 workers, and their processes, which may be killed."""
    path = os.pathsep.join(
        [str(Path(__file__).parent / "search"), os.environ.get("PYTHONPATH", "")]
    )
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}
    begin = "import sys; from dask.__main__ import main; sys.argv[0] = 'dask'; main()"
    options = {"env": environment, "stderr": subprocess.PIPE, "text": True}

    def dask(*arguments):
        return subprocess.Popen([sys.executable, "-c", begin, *arguments], **options)

    scheduler = dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    address = ""
    for line in scheduler.stderr:
        if "Scheduler at:" in line:
            address = line.split()[-1]
            break
    workers = [
        dask("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard") for _ in "ab"
    ]
    from distributed import Client  # slow, and few tests need it

    with Client(address) as client:
        client.wait_for_workers(len(workers), timeout=120)  # importing takes long beside a load
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.communicate()
