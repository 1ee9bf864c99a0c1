# SPDX-License-Identifier: Apache-2.0
"""Rates, integration step and output of coupled oscillators, one per driven joint.

The state of an oscillator has two numbers: radius and phase (`AMPLITUDE_PHASE`) or
x and y (`RIGHETTI`), both in units of its limit cycle, so that the cycle is the unit circle.
The equations are those of `oscillators`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

AMPLITUDE_PHASE, RIGHETTI = 0, 1
TURN = 2.0 * math.pi


@njit(cache=True)
def warp(phase, duty):
    """Angle on the cycle from a phase linear in time [rad]; whole turns map to themselves."""
    turns = math.floor(phase / TURN)
    part = phase - TURN * turns
    if part < TURN * duty:
        return TURN * turns + part / (2.0 * duty)
    return TURN * turns + (part + TURN * (1.0 - 2.0 * duty)) / (2.0 * (1.0 - duty))


@njit(cache=True)
def unwarp(angle, duty):
    """Phase linear in time from an angle on the cycle [rad]; the inverse of `warp`."""
    turns = math.floor(angle / TURN)
    part = angle - TURN * turns
    if part < math.pi:
        return TURN * turns + part * 2.0 * duty
    return TURN * turns + 2.0 * (1.0 - duty) * part - TURN * (1.0 - 2.0 * duty)


@njit(cache=True)
def rates(kind, state, duty, gain, lead, shape, out):
    """Time derivative of the state of all oscillators, written into `out`.

    Args:
        kind: `AMPLITUDE_PHASE` or `RIGHETTI`.
        state: Radius and phase [rad], or x and y, (m, 2).
        duty: Share of the period in which the output falls, (m,).
        gain: c_ij, strength of the coupling from j to i [1/s], (m, m).
        lead: psi_ij = off_j - off_i, desired phase lead of j over i [rad], (m, m).
        shape: frequency [Hz], convergence [1/s], sharpness [-], (3,).
        out: Result, overwritten, (m, 2).
    """
    count = state.shape[0]
    frequency, pull, sharp = shape[0], shape[1], shape[2]
    for i in range(count):
        if kind == AMPLITUDE_PHASE:
            radius, phase = state[i, 0], state[i, 1]
            coupling_sum = 0.0
            for j in range(count):
                coupling_sum += gain[i, j] * math.sin(state[j, 1] - phase - lead[i, j])
            out[i, 0] = pull * (1.0 - radius * radius) * radius
            out[i, 1] = TURN * frequency + coupling_sum
        else:
            x, y = state[i, 0], state[i, 1]
            falling = 0.5 * (1.0 + math.tanh(0.5 * sharp * y))
            share = falling * duty[i] + (1.0 - falling) * (1.0 - duty[i])
            rate = math.pi * frequency / share
            energy = pull * (1.0 - x * x - y * y)
            out[i, 0] = energy * x - rate * y
            out[i, 1] = energy * y + rate * x
            for j in range(count):
                if gain[i, j] != 0.0:
                    even = unwarp(math.atan2(state[j, 1], state[j, 0]), duty[j]) - lead[i, j]
                    angle = warp(even, duty[i])
                    out[i, 0] += gain[i, j] * (math.cos(angle) - x)
                    out[i, 1] += gain[i, j] * (math.sin(angle) - y)


@njit(cache=True)
def advance(kind, state, duty, gain, lead, shape, dt, substeps):
    """Advance the oscillators by `dt` [s] in `substeps` Runge-Kutta steps, in place."""
    h = dt / substeps
    k1, k2 = np.empty_like(state), np.empty_like(state)
    k3, k4 = np.empty_like(state), np.empty_like(state)
    for _ in range(substeps):
        rates(kind, state, duty, gain, lead, shape, k1)
        rates(kind, state + 0.5 * h * k1, duty, gain, lead, shape, k2)
        rates(kind, state + 0.5 * h * k2, duty, gain, lead, shape, k3)
        rates(kind, state + h * k3, duty, gain, lead, shape, k4)
        state += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@njit(cache=True)
def output(kind, state, duty, gain, lead, shape):
    """Output of the oscillators in units of the amplitude, and its time derivative, (m,) each."""
    speed = np.empty_like(state)
    rates(kind, state, duty, gain, lead, shape, speed)
    x, dx = state[:, 0].copy(), speed[:, 0].copy()
    if kind == AMPLITUDE_PHASE:
        for i in range(state.shape[0]):
            angle = warp(state[i, 1], duty[i])
            share = duty[i] if math.sin(angle) > 0.0 else 1.0 - duty[i]
            x[i] = state[i, 0] * math.cos(angle)
            dx[i] = speed[i, 0] * math.cos(angle)
            dx[i] -= state[i, 0] * math.sin(angle) * speed[i, 1] / (2.0 * share)
    return x, dx
