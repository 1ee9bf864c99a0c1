# SPDX-License-Identifier: Apache-2.0
"""Problems that spawned processes can import; run as a script, one is minimised in a folder."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from loco_learning.search.population import PopulationParams, Score, minimise


class Valley:
    """Rosenbrock's valley with its minimum 0 at (1, 1, 1)."""

    names = ("a", "b", "c")
    low, high, start = (-2.0, -2.0, -2.0), (2.0, 2.0, 3.0), (-1.0, 1.0, 0.0)

    def __init__(self, wait=0.0, floor=0.0):
        self.wait, self.floor = wait, floor

    def __call__(self, x):
        time.sleep(self.wait)
        value = self.floor + np.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2)
        return Score(float(value), extra={"length": float(np.linalg.norm(x))})


class Noisy(Valley):
    """The valley with noise from the seed of the evaluation."""

    seeded = True

    def __call__(self, x, seed):
        noise = np.random.default_rng(seed).normal(0.0, 0.1)
        return Score(super().__call__(x).value + noise, extra={"seed": seed})


class Broken(Valley):
    """The valley where a > 0; elsewhere one of the ways to fail."""

    def __call__(self, x):
        if x[0] < -1.0:
            raise ZeroDivisionError("too far left")
        if x[0] < 0.0:
            return Score(float("nan"), reason="exploded" if x[1] > 0.0 else "")
        return super().__call__(x)


class Deadly(Valley):
    """Kills its process: always where a > 1, and once where 0 < a < 1."""

    def __init__(self, folder):
        super().__init__()
        self.folder = Path(folder)

    def __call__(self, x):
        once = self.folder / f"{x[0]!r}"
        if x[0] > 1.0 or (x[0] > 0.0 and not once.exists()):
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__call__(x)


if __name__ == "__main__":
    folder, workers, scheduler, wait, evaluations = sys.argv[1:]
    options = PopulationParams(
        workers=int(workers), scheduler=scheduler, evaluations=int(evaluations), seed=5
    )
    found = minimise(Valley(float(wait)), options, folder)
    sys.stdout.write(f"{found.x.tolist()}\n")
