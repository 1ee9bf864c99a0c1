# SPDX-License-Identifier: Apache-2.0
"""Step two of a mass-spring-damper network: closed loop from its own accelerations.

The body is the reservoir: accelerations of all nodes are filtered, the last three samples are the
input of a linear readout that FORCE trains to output the lengths of the links, and a mixer closes
the loop. Source: thesis section 6.3, eq. (6.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from loco_control.params import Params, parameter
from loco_sim.msd.network import chain
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import Drive, MsdSimulation

from .. import errors
from ..reflex.readout import Readout
from .gait import Gait

REACH = (0.0, 2.0)  # range of a link's driven length over its rest length: 1 ± 1 as with tanh
LOST = 10.0  # readout above which it has diverged


@dataclass(frozen=True)
class LoopParams(Params):
    """Filter, buffer, learning and mixing. Defaults are those of the thesis."""

    train: float = parameter(12.0, "T_train, driven by the target alone", "s", low=0.0)
    closing: float = parameter(38.0, "T_closing, the readout's share grows to beta", "s", low=0.0)
    test: float = parameter(30.0, "T_test, driven by the readout alone", "s", low=0.0)
    beta: float = parameter(0.95, "share of the readout at the end of T_closing", low=0.0, high=1.0)
    regularisation: float = parameter(0.01, "alpha of FORCE", low=1e-12)
    cutoff: float = parameter(6.0, "cut-off frequency of the low-pass filter", "Hz", low=0.01)
    taps: int = parameter(120, "taps of the filter, a FIR by the window method", low=1, high=10000)
    threshold: float = parameter(
        0.0,
        "accelerations are clipped to this value; 0: no clipping. The thesis "
        "has this threshold without a value, the author's code does not use it",
        "m/s²",
        low=0.0,
    )
    buffer: str = parameter(
        "latest",
        "samples that the readout sees: latest (k, k-1, k-2), or author (k-1, k-2, k-2)",
        choices=("latest", "author"),
    )
    output: str = parameter(
        "linear", "output of the readout; eq. 6.5 is linear, the author's code uses tanh",
        choices=("linear", "tanh"),
    )  # fmt: skip
    window: int = parameter(
        0, "error is the smallest over this many steps around the target; author's code: 5", low=0
    )
    noise: float = parameter(0.0, "white noise on the readout's relative lengths", low=0.0)
    seed: int = parameter(0, "seed of the noise", low=0)


LOOPS = {
    "thesis": LoopParams(),
    "author_code": LoopParams(closing=28.0, cutoff=1.5, buffer="author", output="tanh", window=5),
}


class Sensor:
    """Filter and buffer: from accelerations (nodes, axes) to u_k of eq. (6.5)."""

    def __init__(self, channels: int, loop: LoopParams, dt: float):
        from scipy import signal  # imported here since it takes 0.8 s and few filters are made

        taps = signal.firwin(loop.taps, loop.cutoff, fs=1.0 / dt) if loop.taps > 1 else np.ones(1)
        self._taps, self._limit, self._latest = taps, loop.threshold, loop.buffer == "latest"
        self.channels = channels
        self._past = np.zeros((len(taps), channels))
        self._samples = np.zeros((4, channels))  # newest first
        self._tick = 0

    def step(self, acceleration: np.ndarray) -> np.ndarray:
        """Filtered samples of three ticks, (3 channels,), x of all nodes first."""
        raw = acceleration.T.reshape(-1)
        if self._limit > 0.0:
            raw = np.clip(raw, -self._limit, self._limit)
        self._samples[1:] = self._samples[:-1]
        fir_step(self._taps, self._past, self._tick, raw, self._samples[0])
        self._tick += 1
        rows = (0, 1, 2) if self._latest else (1, 2, 2)
        return self._samples[list(rows)].reshape(-1)


@njit(cache=True)
def fir_step(taps, past, tick, raw, out):
    """Store `raw` in the ring buffer `past` (taps, channels); write the filter output to `out`."""
    count = taps.size
    past[tick % count] = raw
    out[:] = 0.0
    for k in range(count):
        row, weight = (tick - k) % count, taps[k]
        for c in range(out.size):
            out[c] += weight * past[row, c]


class Controller:
    """Readout and mixer, which the learning node of the graph calls once per tick.

    Args:
        gait: The target, eq. (4.7).
        nodes: Number of nodes of the network.
        axes: 2 or 3.
        loop: Settings of the filter, the learning and the mixing.
        dt: Integration step [s].
    """

    def __init__(self, gait: Gait, nodes: int, axes: int, loop: LoopParams, dt: float):
        self.gait, self.loop, self.dt = gait, loop, dt
        self.links, self._axes = len(gait.amplitude), axes
        self.sensor = Sensor(nodes * axes, loop, dt)
        self._tanh = loop.output == "tanh"
        inputs = 3 * nodes * axes
        rng = np.random.default_rng(loop.seed)
        first = rng.uniform(0.0, 1.0, (inputs, self.links)) if self._tanh else None
        self.readout = Readout(inputs, self.links, loop.regularisation, first)
        self._rng = rng
        self.ticks = [round(t / dt) for t in (loop.train, loop.closing, loop.test)]
        self.tick = 0

    def target(self, tick: int) -> np.ndarray:
        """Ratio of driven to rest lengths in the open loop at a tick, (links,)."""
        angle = 2.0 * np.pi * self.gait.frequency * tick * self.dt + self.gait.phase
        return 1.0 + self.gait.amplitude * np.sin(angle)

    def share(self, tick: int) -> float:
        """Share of the readout in the drive of the links at a tick."""
        train, closing, _ = self.ticks
        if tick < train:
            return 0.0
        if tick < train + closing:
            return self.loop.beta * (tick - train) / closing
        return 1.0

    def phase(self, tick: int) -> int:
        """Index of the phase at a tick: 0 train, 1 closing, 2 test."""
        return int(tick >= self.ticks[0]) + int(tick >= self.ticks[0] + self.ticks[1])

    def compile(self) -> None:
        """Call every compiled kernel once, before the first tick, and reset the state."""
        u = self.sensor.step(np.zeros((self.sensor.channels // self._axes, self._axes)))
        self.readout.learn(u, self.readout.predict(u))
        self.sensor = Sensor(self.sensor.channels, self.loop, self.dt)
        self.readout.reset()

    def step(self, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Length factors for the next tick from the accelerations (nodes, axes) of this one.

        Returns:
            Drive of the links, output of the readout and target, (links,) each.
        """
        u = self.sensor.step(acceleration)
        following = self.tick + 1
        target = self.target(following)
        learning = self.tick < self.ticks[0] + self.ticks[1]
        prediction = self._learn(u, target) if learning else self._squash(self.readout.predict(u))
        if self.loop.noise > 0.0:
            prediction = prediction + self.loop.noise * self._rng.standard_normal(self.links)
        share = self.share(following)
        self.tick = following
        factor = (1.0 - share) * target + share * prediction
        return np.clip(np.nan_to_num(factor, nan=1.0), *REACH), prediction, target

    def _squash(self, y: np.ndarray) -> np.ndarray:
        return 1.0 + (np.tanh(y) if self._tanh else y)

    def _learn(self, u: np.ndarray, target: np.ndarray) -> np.ndarray:
        """One step of FORCE toward the target; returns the output of the readout as a factor."""
        before = self.readout.predict(u)
        prediction = self._squash(before)
        error = prediction - target
        for shift in range(-self.loop.window, self.loop.window):
            other = prediction - self.target(self.tick + 1 + shift)
            error = np.where(np.abs(other) < np.abs(error), other, error)
        after = self.readout.learn(u, before - error)
        return prediction if self._tanh else 1.0 + after


@dataclass(frozen=True, eq=False)
class LoopLog:
    """Log of a run in three phases, at every n-th tick."""

    t: np.ndarray  # [s], (T,)
    distance: np.ndarray  # path of the centre of mass along x [m], (T,)
    said: np.ndarray  # output of the readout, as factors of the rest lengths, (T, links)
    target: np.ndarray  # (T, links)
    sensed: np.ndarray  # u_k without earlier samples, (T, channels)
    starts: tuple[float, float, float]  # start of closing, start of test, end [s]
    diverged: bool


def run_loop(params: MsdParams, gait: Gait, loop: LoopParams, every: int = 4) -> LoopLog:
    """Train, close and test a chain of `params`; the log has each `every`-th tick."""
    network = chain(params)
    zero = np.zeros(network.count)  # all lengths are given by the controller
    simulation = MsdSimulation(network, params, Drive(zero, zero, 0.0, gait.stiffness))
    controller = Controller(gait, network.nodes, network.dimension, loop, params.step)
    ticks = sum(controller.ticks)
    rows = ticks // every
    channels = network.nodes * network.dimension
    t, distance = np.zeros(rows), np.zeros(rows)
    predictions, target = np.zeros((rows, network.count)), np.zeros((rows, network.count))
    sensed = np.zeros((rows, channels))
    diverged = False
    for k in range(ticks):
        factor, y, r = controller.step(simulation.acceleration)
        diverged = diverged or not np.all(np.abs(y) < LOST)
        simulation.step(factor)
        if (k + 1) % every == 0:
            row = (k + 1) // every - 1
            t[row], predictions[row], target[row] = simulation.time, y, r
            distance[row] = network.centre_of_mass(simulation.position)[0]
            sensed[row] = controller.sensor._samples[0]
    starts = np.cumsum(controller.ticks) * params.step
    return LoopLog(
        t, distance - network.centre_of_mass(network.positions)[0], predictions, target, sensed,
        tuple(float(s) for s in starts), diverged,
    )  # fmt: skip


def nrmse(log: LoopLog, start: float = 0.0, end: float = np.inf) -> float:
    """Root mean square error of all links over their mean range, between two times [s].

    A link that is hardly driven has a range near zero, so ranges are averaged first, as for the
    joints of a robot (`errors.nrmse`).
    """
    rows = (log.t > start) & (log.t <= end)
    return errors.nrmse(log.target[rows], log.said[rows])
