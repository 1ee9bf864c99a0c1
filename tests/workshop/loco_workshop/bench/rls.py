# SPDX-License-Identifier: Apache-2.0
"""Speed of one FORCE step compared with textbook NumPy, BLAS and the memory bandwidth."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.linalg.blas import dsymv, dsyr

from loco_learning.reflex.readout import Readout
from loco_learning.reflex.scaling import OUTPUTS


@dataclass(frozen=True)
class BenchRow:
    """Time of one FORCE step (eqs. 3.14 to 3.17, 16 outputs) at one size, best of several [µs]."""

    neurons: int
    ours: float
    numpy: float
    blas: float
    limit: float  # read and write half of P and all of W once

    @property
    def ratio(self) -> float:
        """Time of loco's step over the memory limit [-]."""
        return self.ours / self.limit


def bench_rls(sizes: Iterable[int] = (80, 200, 500, 1000), repeats: int = 30) -> list[BenchRow]:
    """Measure all variants alternately at each size, so that other load affects all of them.

    Args:
        sizes: Numbers of neurons.
        repeats: Repetitions; the fastest of each variant counts.
    """
    return [_row(n, repeats) for n in sizes]


def _row(n: int, repeats: int) -> BenchRow:
    rng = np.random.default_rng(0)
    u, target = rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, OUTPUTS)
    variants = {
        "ours": _ours(n, u, target),
        "numpy": _numpy(n, u, target),
        "blas": _blas(n, u, target),
        "limit": _limit(n, u, target),
    }
    calls = max(3, round(2e6 / (n * n)))
    best = dict.fromkeys(variants, np.inf)
    for _ in range(repeats):
        for name, variant in variants.items():
            best[name] = min(best[name], _time(variant, calls))
    return BenchRow(n, **{name: 1e6 * value for name, value in best.items()})


def _time(way: Callable[[], object], calls: int) -> float:
    way()  # the first call compiles, the others warm the cache
    start = time.perf_counter()
    for _ in range(calls):
        way()
    return (time.perf_counter() - start) / calls


def _ours(n: int, u: np.ndarray, target: np.ndarray) -> Callable[[], object]:
    readout = Readout(n, OUTPUTS)
    return lambda: readout.learn(u, target)


def _numpy(n: int, u: np.ndarray, target: np.ndarray) -> Callable[[], object]:
    p, w = np.eye(n) / 1e-3, np.zeros((n, OUTPUTS))
    return lambda: textbook_step(p, w, u, target)


def textbook_step(p: np.ndarray, w: np.ndarray, u: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Eqs. (3.14) to (3.17) as written, with P (n, n) and W (n, outputs) changed in place."""
    error = w.T @ u - target
    p -= np.outer(p @ u, u @ p) / (1.0 + u @ p @ u)
    w -= np.outer(p @ u, error)
    return w.T @ u


def _blas(n: int, u: np.ndarray, target: np.ndarray) -> Callable[[], object]:
    p = np.asfortranarray(np.eye(n) / 1e-3)
    w = np.zeros((n, OUTPUTS))

    def step() -> np.ndarray:
        gain = dsymv(1.0, p, u, lower=0)
        s = 1.0 + u @ gain
        dsyr(-1.0 / s, gain, lower=0, a=p, overwrite_a=1)
        error = u @ w - target
        np.subtract(w, np.outer(gain / s, error), out=w)
        return u @ w

    return step


def _limit(n: int, u: np.ndarray, target: np.ndarray) -> Callable[[], object]:
    p, w, output = np.eye(n), np.zeros((n, OUTPUTS)), np.empty(OUTPUTS)
    return lambda: touch(p, w, u, target, u, u, output)


@njit(cache=True)
def touch(p, w, u, target, pending, gain, output):
    """Read and write half of p and all of w, with the arguments of `readout.rls_step`."""
    for i in range(p.shape[0]):
        for j in range(i + 1):
            p[i, j] *= 1.0000001
        for j in range(w.shape[1]):
            w[i, j] *= 1.0000001
