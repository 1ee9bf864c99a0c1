# SPDX-License-Identifier: Apache-2.0
"""Coupled oscillators that drive joints directly: the pattern generator of Tigrillo.

Every driven joint i has one oscillator; its output is

    q_i = offset_i + s(t) (bias_i + amplitude_i x_i(t))

with s rising smoothly from 0 to 1 over `ramp` after `start_time`. x_i falls from +1 to
-1 during the share `duty_factor` d_i of the period and rises during the rest, in all kinds:

- ``amplitude_phase``: r' = a (1 - r²) r,  phi_i' = w + Σ_j c sin(phi_j - phi_i - psi_ij),
  x = r cos(phi^), phi^ = phi / 2d while phi < 2 pi d, else (phi + 2 pi (1 - 2d)) / 2 (1 - d).
  Used by the author's code. Departures: psi_ij = off_j - off_i for all pairs, where his code has
  off_j for the first leg and off_i - off_j for the others, an error by which his legs lock to
  phases other than the requested ones; all couplings are equal; r in units of the amplitude.
- ``righetti``: x' = a (1 - r²) x - w y + Σ_j c (x_ij - x),
  y' = a (1 - r²) y + w x + Σ_j c (y_ij - y),  w = pi f / [s(b y) d + s(-b y) (1 - d)],
  s the logistic function; (x_ij, y_ij) is the point of the cycle that the phase of oscillator j
  implies for i. Source: Righetti and Ijspeert, ICRA 2008, cited by thesis section 5.3.2.
  Departures: there only y is coupled, by ±y_j, which locks neither unequal duty factors nor
  leads other than half a turn; the coupling here vanishes on the locked cycle, so it changes
  neither shape nor period. There s blends the rates of the two halves, here their durations.
- ``sine``: x = sin(2 pi (f t + phase)); no duty factor. The excitation of a calibration.
- ``chirp``, ``triangle``, ``steps``: no duty factor either; see `excitation`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..exceptions import NameUnknownError, ParameterError
from ..params import Params, parameter
from . import excitation

OSCILLATORS = ("amplitude_phase", "righetti")
EQUATIONS = (*OSCILLATORS, "sine", *excitation.WAVEFORMS)
PATTERNS = {  # phase of lf rf lh rh [strides]
    "walk": (0.0, 0.5, 0.5, 0.0),  # diagonal legs together, as in thesis section 5.3.2.2
    "bound": (0.0, 0.0, 0.5, 0.5),  # the front pair, then the hind pair
}
LONGEST_STEP = 2e-3  # longest integration step [s]
PER_JOINT = ("amplitude", "offset", "duty_factor", "phase", "bias")


def _per_joint(
    default: float, doc: str, unit: str = "rad", low: float = -math.pi, high: float = math.pi
) -> Any:
    return parameter((default,), doc, unit, low, high, any_length=True)


@dataclass(frozen=True)
class CpgParams(Params):
    """Motion of the driven joints; lists have one value for all joints or one for each."""

    kind: str = parameter("amplitude_phase", "equations of the oscillators", choices=EQUATIONS)
    frequency: float = parameter(1.0, "strides per second", "Hz", low=0.02, high=10.0)
    amplitude: tuple[float, ...] = _per_joint(0.35, "half the swing of the joint")
    offset: tuple[float, ...] = _per_joint(0.0, "middle of the swing, held before the start")
    duty_factor: tuple[float, ...] = _per_joint(
        0.5, "share of the period in which the joint moves backwards", "-", 0.02, 0.98
    )
    phase: tuple[float, ...] = _per_joint(0.0, "phase lead of the joint", "stride", -1e3, 1e3)
    coupling: float = parameter(5.0, "c, coupling between joints", "1/s", 0.0, 50.0)
    convergence: float = parameter(50.0, "a, rate of convergence to the cycle", "1/s", 1.0, 200.0)
    sharpness: float = parameter(50.0, "b, steepness of the duty switch", "-", 1.0, 500.0)
    start_time: float = parameter(0.0, "time of the first movement", "s", low=0.0)
    ramp: float = parameter(1.0, "time in which the movement grows to its full size", "s", low=0.0)
    end_frequency: float = parameter(5.0, "chirp: final frequency", "Hz", low=0.02, high=100.0)
    sweep: float = parameter(8.0, "chirp: time from `frequency` to `end_frequency`", "s", 0.1, 1e4)
    levels: tuple[float, ...] = parameter(
        (1.0, -1.0), "steps: sequence of levels, as shares of the amplitude", "-", -1.0, 1.0,
        any_length=True,
    )  # fmt: skip
    bias: tuple[float, ...] = _per_joint(0.0, "constant part of the movement, ramped like the rest")
    rise: float = parameter(0.2, "steps: time to reach a level; 0 jumps", "s", 0.0, 100.0)


def pattern(name: str) -> tuple[float, float, float, float]:
    """Phase of lf rf lh rh in a pattern [strides].

    Raises:
        NameUnknownError: There is no such pattern.
    """
    if name not in PATTERNS:
        raise NameUnknownError("phase pattern", name, PATTERNS)
    return PATTERNS[name]


class Cpg:
    """Angles and speeds of the driven joints, one `step` per control period.

    Args:
        params: Parameters of the oscillators.
        count: Number of driven joints m.
        dt: Control period [s].

    Attributes:
        rest: Positions that the joints hold before the start [rad], (m,).

    Raises:
        ParameterError: A list has neither one value nor `count`.
    """

    def __init__(self, params: CpgParams, count: int, dt: float):
        self.params, self.dt = params, float(dt)
        values = {name: _by_joint(name, getattr(params, name), count) for name in PER_JOINT}
        self.rest, self._amplitude, self._offsets = (
            values["offset"], values["amplitude"], 2.0 * np.pi * values["phase"]
        )  # fmt: skip
        self._bias, self._biased = values["bias"], bool(values["bias"].any())
        self._exact = params.kind not in OSCILLATORS  # a function of time, nothing to integrate
        if not self._exact:
            # Kernels are imported here so that reading an experiment does not load numba.
            from . import oscillator_kernels as kernels

            self._kernels = kernels
            shape = np.array([params.frequency, params.convergence, params.sharpness])
            self._code = OSCILLATORS.index(params.kind)
            self._constants = (values["duty_factor"], *coupling(params, self._offsets), shape)
            self._substeps = max(1, math.ceil(self.dt / LONGEST_STEP))
        self.reset()
        if not self._exact:  # compile now, not in the first tick
            self._advance()
            self.reset()

    def reset(self, angle: np.ndarray | None = None, radius: np.ndarray | None = None) -> None:
        """Restart on the phase-locked cycle.

        Args:
            angle: Initial phases in place of the locked ones [rad], (m,); they lock within strides.
            radius: Initial radii instead of 1, in units of the cycle, (m,).
        """
        self._t = 0.0
        if self._exact:
            return
        angle = self._offsets if angle is None else np.asarray(angle, dtype=float)
        radius = np.ones_like(angle) if radius is None else np.asarray(radius, dtype=float)
        self._state = np.stack([radius, angle], axis=1)
        if self._code == self._kernels.RIGHETTI:
            duty = self._constants[0]
            on_cycle = np.array(
                [self._kernels.warp(a, d) for a, d in zip(angle, duty, strict=True)]
            )
            self._state = radius[:, None] * np.stack([np.cos(on_cycle), np.sin(on_cycle)], axis=1)

    def step(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles [rad] and speeds [rad/s] at time t [s], (m,) each; call it once per tick."""
        since = t - self.params.start_time
        if since < -0.5 * self.dt:
            return self.rest.copy(), np.zeros_like(self.rest)
        self._t = t
        size, growth = rise(max(since, 0.0), self.params.ramp)
        x, dx = self._at(t) if self._exact else self._advance()
        if not self._biased:
            q = self.rest + size * self._amplitude * x
            return q, self._amplitude * (growth * x + size * dx)
        swing = self._bias + self._amplitude * x
        return self.rest + size * swing, growth * swing + size * self._amplitude * dx

    @property
    def phase(self) -> np.ndarray:
        """Phase of each joint, linear in time, after the last `step` [strides], in [0, 1), (m,)."""
        if self._exact:
            return (self.params.frequency * self._t + self._offsets / (2.0 * np.pi)) % 1.0
        angle = self._state[:, 1]
        if self._code == self._kernels.RIGHETTI:
            on_cycle = np.arctan2(self._state[:, 1], self._state[:, 0])
            angle = np.array(
                [
                    self._kernels.unwarp(a, d)
                    for a, d in zip(on_cycle, self._constants[0], strict=True)
                ]
            )
        return (angle / (2.0 * np.pi)) % 1.0

    def _advance(self) -> tuple[np.ndarray, np.ndarray]:
        output = self._kernels.output(self._code, self._state, *self._constants)
        self._kernels.advance(self._code, self._state, *self._constants, self.dt, self._substeps)
        return output

    def _at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        p = self.params
        if p.kind == "sine":
            return self._sines(t)
        since, phase = max(t - p.start_time, 0.0), self._offsets / (2.0 * np.pi)
        if p.kind == "chirp":
            return excitation.chirp(since, phase, p.frequency, p.end_frequency, p.sweep)
        if p.kind == "triangle":
            return excitation.triangle(since, phase, p.frequency)
        return excitation.steps(since, phase, p.frequency, p.levels, p.rise)

    def _sines(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        rate = 2.0 * np.pi * self.params.frequency
        angle = rate * t + self._offsets
        return np.sin(angle), rate * np.cos(angle)


def coupling(params: CpgParams, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gains c_ij [1/s] and desired leads psi_ij = off_j - off_i [rad], (m, m) each."""
    count = len(offsets)
    gain = np.full((count, count), params.coupling)
    np.fill_diagonal(gain, 0.0)
    return gain, offsets[None, :] - offsets[:, None]


def rise(t: float, duration: float) -> tuple[float, float]:
    """Smooth step 3u² - 2u³ with u = t / duration, and its time derivative [1/s]."""
    if t >= duration:
        return 1.0, 0.0
    u = t / duration
    return u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u) / duration


def _by_joint(name: str, values: tuple[float, ...], count: int) -> np.ndarray:
    if len(values) not in (1, count):
        raise ParameterError(
            f"CpgParams.{name} must have 1 value or one for each of the {count} driven joints, "
            f"got {len(values)}"
        )
    return np.array(values if len(values) == count else values * count, dtype=float)
