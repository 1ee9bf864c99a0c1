# SPDX-License-Identifier: Apache-2.0
"""Simulation of a mass-spring-damper network, or of a population of networks in SIMD lanes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError

from . import integrator as kernel
from .layout import Blocks, Single
from .network import Network
from .params import MsdParams, NoiseParams
from .stability import check_step

GROUNDS = ("none", "stick", "author")


@dataclass(frozen=True, eq=False)
class Drive:
    """Actuation l = l_ref (1 + a sin(2 pi f t + phi)), eq. 4.7, with one value per link.

    For a population each array has an axis of networks in front.
    """

    amplitude: np.ndarray  # a [-], (links,) or (networks, links)
    phase: np.ndarray  # phi [rad], same shape
    frequency: np.ndarray | float = 1.0  # f [Hz], one number or (networks,)
    stiffness: np.ndarray | None = None  # k [N/m], same shape; None for the network's


class History(NamedTuple):
    """Recorded motion: t (T,) and (T, nodes, axes) arrays; of a population (networks, T, …)."""

    t: np.ndarray  # [s]
    position: np.ndarray  # [m]
    velocity: np.ndarray  # [m/s]
    acceleration: np.ndarray  # [m/s²]


class MsdSimulation:
    """Network, ground and actuation, integrated with fixed steps; motion is not recorded.

    Args:
        network: Nodes and links.
        params: Gravity, drag, ground, integrator and step; chain structure unused.
        drive: Actuation; None for a passive network. A drive of several networks is a population,
            and all arrays get an axis of networks in front.
        noise: Disturbances of the network.
        seed: Seed of the noise; for a population one per network, or the first of a series.
        threads: Number of threads that share a population.

    Raises:
        ParameterError: Shapes do not fit, a value is out of range, or the step is too large.
    """

    def __init__(
        self,
        network: Network,
        params: MsdParams | None = None,
        drive: Drive | None = None,
        noise: NoiseParams | None = None,
        seed: int | np.ndarray = 0,
        threads: int = 1,
    ):
        self.network, self.params, self.threads = network, params or MsdParams(), threads
        self.noise = noise or NoiseParams()
        zero = np.zeros(network.count)
        drive = drive or Drive(zero, zero, 0.0)
        shape = np.shape(drive.amplitude)
        self.size = shape[0] if len(shape) == 2 else None
        self._lead = () if self.size is None else (self.size,)
        self._layout = Single(network) if self.size is None else Blocks(network, self.size)
        self._checked = np.full(network.count, -1.0)
        self._make_constants()
        self.replace(drive, seed)

    def replace(self, drive: Drive, seed: int | np.ndarray = 0) -> None:
        """Replace the drive by one for the same number of networks, and reset.

        Raises:
            ParameterError: As the constructor.
        """
        self._read_drive(drive, seed)
        stiffest = self.stiffness.reshape(-1, self.network.count).max(axis=0)
        if np.any(stiffest > self._checked):
            check_step(self.network, self.params, np.maximum(stiffest, self._checked))
            self._checked = np.maximum(stiffest, self._checked)
        self.reset()

    def _read_drive(self, drive: Drive, seed: int | np.ndarray) -> None:
        links = (*self._lead, self.network.count)
        stiffness = self.network.stiffness if drive.stiffness is None else drive.stiffness
        self.amplitude = _reshape("amplitude", drive.amplitude, links)
        self.phase = _reshape("phase", drive.phase, links)
        self.frequency = _reshape("frequency", drive.frequency, self._lead)
        self.stiffness = _reshape("stiffness", stiffness, links)
        if (self.stiffness < 0.0).any():
            raise ParameterError(
                f"stiffness must be 0 or more N/m, got {float(self.stiffness.min()):g}"
            )
        if np.ndim(seed) == 0 and self._lead:
            seed = int(seed) + np.arange(self.size)
        self.seed = np.broadcast_to(np.asarray(seed, np.uint64), self._lead)

    def _make_constants(self) -> None:
        p, n, network = self.params, self.noise, self.network
        rate = n.impulse_rate if n.impulse_size > 0.0 else 0.0
        self._scales = np.array([p.step, p.gravity, p.drag, rate, n.impulse_size])
        self._choices = np.zeros(8, np.int64)
        self._choices[kernel.NODES] = network.nodes
        self._choices[kernel.THREE] = network.dimension == 3
        self._choices[kernel.ALONG] = p.damper == "along_link"
        self._choices[kernel.AUTHOR] = p.integrator == "author"
        self._choices[kernel.GROUND] = GROUNDS.index(p.ground)
        self._choices[kernel.NOISE_ON] = n.actuation > 0.0
        self._choices[kernel.JOLT_HOLD] = n.impulse_steps
        shape = np.stack([network.rest, network.damping, p.nonlinearity / network.rest**2])
        self._shape = self._layout.shape(shape)
        self._masses = self._layout.masses(network.masses)

    def reset(self) -> None:
        """Reset to the initial state at rest, with the same noise."""
        self.tick, self._is_outdated = 0, False
        network, lead = self.network, self._lead
        one = np.ones_like(self.phase)
        self._links = self._layout.links(
            np.stack(
                [
                    self.stiffness, self.amplitude * network.rest, self.phase,
                    np.sin(self.phase), np.cos(self.phase), one,
                ],
                axis=-2,
            )
        )  # fmt: skip
        omega = 2.0 * np.pi * self.frequency
        turn = omega * self.params.step
        noise = np.full(lead, self.noise.actuation)
        self._network = self._layout.numbers(
            np.stack([omega, noise, np.sin(turn), np.cos(turn)], axis=-1)
        )
        states = _streams(self.seed, network.count + 1)
        self._random_state = self._layout.links(states[..., None, :-1])
        self._jolts = self._layout.numbers(states[..., -1:])[..., 0, :] if lead else states[-1:]
        width = self._jolts.shape[-1]
        self._running = np.zeros((*self._jolts.shape[:-1], 2 * width), np.int64)
        self._push = np.zeros((*self._jolts.shape[:-1], network.dimension * width))
        zeros = np.zeros((*lead, *network.positions.shape))
        self.place(zeros + network.positions, zeros)

    def place(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Set positions [m] and velocities [m/s] of the nodes, each (nodes, axes)."""
        shape = (*self._lead, *self.network.positions.shape)
        parts = [
            self._layout.nodes_in(_reshape(name, values, shape))
            for name, values in (("position", position), ("velocity", velocity))
        ]
        derivatives = [np.zeros_like(parts[0])] * 4
        self._state = np.concatenate([*parts, *derivatives], axis=-2)
        if self.params.integrator == "author":
            return
        quiet = self._choices.copy()
        quiet[[kernel.NOISE_ON, kernel.PRESCRIBED]] = False  # noise begins with the first step
        for block in range(len(self._state)) if self._lead else [...]:
            kernel.settle(
                self._layout.tail, self._layout.head, self._shape, self._masses, self._scales,
                quiet, self._state[block], self._links[block], self._network[block],
                self._random_state[block],
            )  # fmt: skip

    def run(self, steps: int, every: int = 0) -> History | None:
        """Advance `steps` steps; record every `every`-th step, or nothing for 0.

        Raises:
            ParameterError: `steps` is not a multiple of `every`.
        """
        if every and steps % every:
            raise ParameterError(f"steps must be a multiple of every, got {steps} and {every}")
        frames = steps // every if every else 0
        rows = self._state.shape[-2] // 2  # rows of position, velocity and acceleration each
        states = np.zeros((*self._state.shape[:-2], frames * rows, self._state.shape[-1]))
        self._advance(steps, every, states)
        if not every:
            return None
        t = self.params.step * (self.tick - steps + every * np.arange(1, frames + 1))
        parts = states.reshape(*states.shape[:-2], frames, 3, rows // 3, states.shape[-1])
        out = self._layout.nodes_out(parts)  # (…, frames, 3, nodes, axes)
        return History(t, *(np.ascontiguousarray(out[..., k, :, :]) for k in range(3)))

    def step(self, factor: np.ndarray | None = None) -> None:
        """Advance one step; `factor` (links,) sets the driven length / rest length."""
        if factor is not None:
            rows = self._layout.links(np.asarray(factor, float)[..., None, :])
            first = kernel.FACTOR * rows.shape[-2]
            self._links[..., first : first + rows.shape[-2], :] = rows
            self._choices[kernel.PRESCRIBED] = True
        self._advance(1, 0, np.zeros((*self._state.shape[:-2], 0, self._state.shape[-1])))
        self._choices[kernel.PRESCRIBED] = False
        self._is_outdated = factor is not None

    def _advance(self, steps: int, every: int, samples: np.ndarray) -> None:
        if self._is_outdated and not self._choices[kernel.PRESCRIBED]:
            self._catch_up()
        rest = (
            self.tick, steps, every, self._layout.tail, self._layout.head, self._shape,
            self._masses, self._scales, self._choices, self._state, self._links, self._network,
            self._random_state, self._jolts, self._running, self._push, samples,
        )  # fmt: skip
        if not self._lead:
            kernel.advance(*rest)
        elif self.threads < 2:
            kernel.advance_blocks(0, len(self._state), *rest)
        else:
            bounds = np.linspace(0, len(self._state), self.threads + 1).astype(int)
            with ThreadPoolExecutor(self.threads) as pool:
                parts = zip(bounds[:-1], bounds[1:], strict=True)
                list(pool.map(lambda part: kernel.advance_blocks(*part, *rest), parts))
        self.tick += steps

    def _catch_up(self) -> None:
        """Recompute the sines of the drive at this tick, after steps with external `factor`."""
        t = self.tick * self.params.step
        for block in range(len(self._links)) if self._lead else [...]:
            kernel.exact_sines(t, self._links[block], self._network[block])

    def _part(self, number: int) -> np.ndarray:
        rows = self._state.shape[-2] // 6
        return self._layout.nodes_out(self._state[..., number * rows : (number + 1) * rows, :])

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.tick * self.params.step

    @property
    def position(self) -> np.ndarray:
        """Positions of the nodes [m], (nodes, axes), the last axis up."""
        return self._part(kernel.X)

    @property
    def velocity(self) -> np.ndarray:
        """Velocities of the nodes [m/s], (nodes, axes)."""
        return self._part(kernel.V)

    @property
    def acceleration(self) -> np.ndarray:
        """Accelerations of the nodes [m/s²], (nodes, axes)."""
        return self._part(kernel.A)

    def check_finite(self) -> None:
        """Raise when the state is no longer finite.

        Raises:
            DivergedError: The state has a value that is not finite.
        """
        if not np.all(np.isfinite(self.position)):
            raise DivergedError(f"the network diverged before {self.time:g} s")


def _reshape(name: str, values: np.ndarray | float, shape: tuple[int, ...]) -> np.ndarray:
    try:
        values = np.broadcast_to(np.asarray(values, float), shape)
    except ValueError as error:
        raise ParameterError(f"{name} must have shape {shape}, got {np.shape(values)}") from error
    if not np.all(np.isfinite(values)):
        raise ParameterError(f"{name} must be finite numbers")
    return values


def _streams(seed: np.ndarray, count: int) -> np.ndarray:
    """Initial states of `count` random streams of each seed, (…, count), never 0.

    Splitmix64 of Steele, Lea and Flood (2014).
    """
    with np.errstate(over="ignore"):
        key = _mix(np.asarray(seed, np.uint64) + np.uint64(0x9E3779B97F4A7C15))
        states = _mix(
            key[..., None]
            + np.arange(1, count + 1, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        )
    return np.where(states == 0, np.uint64(1), states)


def _mix(z: np.ndarray) -> np.ndarray:
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
