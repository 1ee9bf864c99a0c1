# SPDX-License-Identifier: Apache-2.0
"""`loco bench msd`: mass-spring networks compared with NumPy, the author's code, the CPU limit."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError
from loco_sim.msd.integrator import outer
from loco_sim.msd.lanes import WIDTH, fma, get, inverse_length, put
from loco_sim.msd.network import Network, chain
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import Drive, MsdSimulation

from ..textbook import TextbookSimulation

AUTHOR = 73.7e-6  # [s] per step of 20 nodes and 54 springs, author's code, one core of 2026
AGREE = 1e-9  # [m]
SIZES = (5, 10, 20, 50, 100, 200)
POPULATIONS = (1, 8, 100, 1000)

# Operations of `integrator` in two dimensions with dampers along the links; each addition,
# product or fused pair counts as one. `inverse_length` is timed separately.
PER_LINK = 30  # differences 4, square and closing speed 4, drive 6, force 10, sums 6
PER_NODE = 2 * 11 + 2  # each axis: 5 drift, 2 ground, 1 drag, 3 kick; and the height


def bench_msd(
    sizes: tuple[int, ...] = SIZES,
    populations: tuple[int, ...] = POPULATIONS,
    threads: tuple[int, ...] = (1, 2),
    seconds: float = 0.08,
) -> list[dict[str, Any]]:
    """Time per step of a single network and of each network in a population, best of several.

    Columns: time per step of one network [ns]; million steps per second; speed-up over textbook
    NumPy on this machine, and over the published time of the author's simulator; ratio to the time
    of the bare arithmetic on the same number of threads.

    Args:
        sizes: Numbers of nodes.
        populations: Numbers of networks simulated together; 1 for a single one.
        threads: Numbers of threads for populations of more than one block.
        seconds: Duration of a measurement [s].

    Raises:
        DivergedError: A trajectory differs from the textbook's by more than 1e-9 m.
    """
    return [row for nodes in sizes for row in _rows(nodes, populations, threads, seconds)]


def _rows(nodes: int, populations: tuple[int, ...], threads: tuple[int, ...], seconds: float):
    params = MsdParams(nodes=nodes)
    network = chain(params)
    drive = _drive(network, None)
    difference = largest_difference(network, params, drive)
    if not difference <= AGREE:
        raise DivergedError(f"{nodes} nodes: {difference:.2g} m from the textbook's trajectory")
    simulations: dict[tuple[int, int], MsdSimulation] = {}
    for size in populations:
        for count in threads if size > 8 else threads[:1]:
            d = _drive(network, size if size > 1 else None)
            simulations[size, count] = MsdSimulation(network, params, d, threads=count)
    textbook = TextbookSimulation(network, params, drive)
    calls: dict[Any, Callable[[int], Any]] = {"textbook": textbook.run}
    calls.update({key: simulation.run for key, simulation in simulations.items()})
    best = _best(calls, seconds)
    best.update({key: best[key] / key[0] for key in simulations})
    limit = seconds_per_step(network.nodes, network.count)
    for size, count in simulations:
        took = best[size, count]
        yield {
            "nodes": nodes,
            "links": network.count,
            "nets": size,
            "threads": count,
            "ns": f"{1e9 * took:.0f}",
            "M/s": 1e-6 / took,
            "x textbook": f"{best['textbook'] / took:.0f}",
            "x author": f"{AUTHOR / took:.0f}" if nodes == 20 else "",
            "x limit": took * count / limit,
            "apart [m]": f"{difference:.0e}",
        }


def largest_difference(network: Network, params: MsdParams, drive: Drive) -> float:
    """Largest difference of loco's and the textbook's trajectory over 2 s on the ground [m]."""
    compiled, textbook = (
        kind(network, params, drive=drive) for kind in (MsdSimulation, TextbookSimulation)
    )
    largest = 0.0
    for _ in range(8):
        compiled.run(50)
        textbook.run(50)
        largest = max(largest, float(np.abs(compiled.position - textbook.position).max()))
    return largest


def _drive(network: Network, size: int | None) -> Drive:
    rng = np.random.default_rng(0)
    shape = (network.count,) if size is None else (size, network.count)
    return Drive(rng.uniform(0.0, 0.2, shape), rng.uniform(0.0, 2.0 * np.pi, shape), 1.0)


def _best(calls: dict[Any, Callable[[int], Any]], seconds: float, turns: int = 6) -> dict:
    """Smallest time per step of each function [s], measured alternately.

    One thread is timed by its CPU clock, to reduce the influence of other processes; two threads
    by wall time.
    """
    clocks = {
        key: time.perf_counter if key != "textbook" and key[1] > 1 else time.thread_time
        for key in calls
    }
    steps = {}
    for key, call in calls.items():
        call(20)  # loads the compiled kernels
        began = time.perf_counter()
        call(20)
        steps[key] = max(20, round(20 * seconds / (time.perf_counter() - began)))
    best = dict.fromkeys(calls, np.inf)
    for _ in range(turns):
        for key, call in calls.items():
            began = clocks[key]()
            call(steps[key])
            best[key] = min(best[key], (clocks[key]() - began) / steps[key])
    return best


@outer
def _products(turns, values):
    """Eight independent chains of fused multiply-adds, 8 per iteration."""
    a, b, c, d = get(values, 0), get(values, 1), get(values, 2), get(values, 3)
    e, f, g, h = get(values, 4), get(values, 5), get(values, 6), get(values, 7)
    by, plus = get(values, 8), get(values, 9)
    for _ in range(turns):
        a, b, c, d = fma(a, by, plus), fma(b, by, plus), fma(c, by, plus), fma(d, by, plus)
        e, f, g, h = fma(e, by, plus), fma(f, by, plus), fma(g, by, plus), fma(h, by, plus)
    put(values, 0, a + b + c + d + e + f + g + h)


@outer
def _roots(turns, values):
    """Eight independent chains of inverse lengths, 8 per iteration."""
    a, b, c, d = get(values, 0), get(values, 1), get(values, 2), get(values, 3)
    e, f, g, h = get(values, 4), get(values, 5), get(values, 6), get(values, 7)
    for _ in range(turns):
        a, b, c, d = inverse_length(a), inverse_length(b), inverse_length(c), inverse_length(d)
        e, f, g, h = inverse_length(e), inverse_length(f), inverse_length(g), inverse_length(h)
    put(values, 0, a + b + c + d + e + f + g + h)


@cache
def operation_times() -> tuple[float, float]:
    """Time per fused multiply-add and per inverse length, for one number in full lanes [s]."""
    values = np.full((10, WIDTH), 0.5)
    best = [np.inf, np.inf]
    for _ in range(12):
        for k, kernel in enumerate((_products, _roots)):
            kernel(1, values)
            values[:] = 0.5
            began = time.thread_time()
            kernel(40_000, values)
            took = time.thread_time() - began
            best[k] = min(best[k], took / (40_000 * 8 * WIDTH))
    return best[0], best[1]


def seconds_per_step(nodes: int, links: int) -> float:
    """Lower bound of the time of a step of one network [s]: its arithmetic on full SIMD lanes.

    A real step also has loads, stores and latencies.
    """
    product, root = operation_times()
    return (links * PER_LINK + nodes * PER_NODE) * product + links * root
