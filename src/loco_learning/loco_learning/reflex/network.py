# SPDX-License-Identifier: Apache-2.0
"""Reflex network: from the sensors of a body to references for its joints."""

from __future__ import annotations

import zlib
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from loco_control.types import GaitTarget, LearningState, MotionCommand

from ..params import PHASES, PhasedParams
from . import weights
from .readout import Readout
from .reservoir import DelayLine, ElmLayer
from .schedule import CLOSING, TRAIN, Schedule
from .senses import BodySensors, FootForces, Senses

__all__ = ["PHASES", "ReflexNetwork"]


class ReflexNetwork:
    """Delay line, fixed hidden layer and readout, trained while the robot walks.

    ==========  ===============  =====================================
    phase       drives the legs  readout
    ==========  ===============  =====================================
    stand       target           frozen, the delay line fills
    train       target           learns at each tick
    closing     prediction       learns at fewer and fewer ticks
    test        prediction       frozen
    ==========  ===============  =====================================

    `Schedule` describes how learning fades in closing, `senses` the sensors and their scaling.
    Source: thesis sections 3.5 and 7.2.3; for robots with passive knees, joints and an IMU
    replace the forces on the feet.

    Args:
        params: Shape, scaling and schedule.
        senses: Sensors of the network, and the k joints of the target that it moves.
        dt: Control period [s].
        seed: Seed of the hidden weights.
    """

    def __init__(self, params: PhasedParams, senses: Senses, dt: float, seed: int = 0):
        self.params, self.senses, self.dt, self.seed = params, senses, dt, seed
        self.outputs = senses.outputs
        self.schedule = Schedule(params, dt)
        self._untrained = np.zeros(2 * len(self.outputs))
        self._works = params.enabled or params.phases_when_off
        self.norm = 0.0  # Frobenius norm of the readout [-]
        if not self._works:
            return
        rng = np.random.default_rng([seed, zlib.crc32(b"reflex")])
        p, size = params, senses.size
        self.delay_line = DelayLine(p.memory, size)
        self.hidden = ElmLayer(size * p.memory, senses.width, p, rng)
        first = senses.first_weights(p, rng)
        self.readout = Readout(p.neurons, len(self._untrained), p.regularisation, first)
        self._load()

    def reset(self) -> None:
        """Reset the state; also trained weights, unless they are from a file."""
        if self._works:
            for part in (self.senses, self.delay_line, self.readout):
                part.reset()
            self._load()

    def _load(self) -> None:
        self.refresh()
        if self.params.weights:
            weights.restore_weights(self, self.params.weights)

    def refresh(self) -> None:
        """Recompute the norm after the weights were replaced."""
        weights = self.readout.weights.ravel()
        self.norm = sqrt(weights.dot(weights))

    def step(
        self, tick: int, t: float, felt: np.ndarray | None, target: GaitTarget | MotionCommand
    ) -> tuple[MotionCommand, LearningState]:
        """Compute the references of one tick.

        Args:
            tick: Control periods since reset.
            t: Simulated time [s], only copied to the result.
            felt: State for the sensors; unused if the network is disabled.
            target: Joint references of the target generator at the same tick.

        Returns:
            Joint references for the plant, and the state of the learning.
        """
        if not self._works:
            command = MotionCommand(tick, t, target.q, target.dq)
            return command, LearningState(tick, t, self._untrained, 0.0, 0.0, TRAIN, False, False)
        phase = self.schedule.phase_of(tick)
        learning = self.schedule.learns(tick, phase)
        driving = self.params.enabled and phase >= CLOSING
        prediction = self._predict(felt, target, learning)
        q, dq, error = references(target.q, target.dq, prediction, self.outputs, driving)
        command = MotionCommand(tick, t, q, dq)
        return command, LearningState(
            tick, t, prediction, error, self.norm, phase, driving, learning
        )

    def _predict(
        self, felt: np.ndarray | None, target: GaitTarget | MotionCommand, learning: bool
    ) -> np.ndarray:
        """Output (2k,) of this tick, after the update if the readout learns (eq. 3.17)."""
        if not self.params.enabled:
            return self._untrained
        line = self.delay_line.step(self.senses.sample(felt, learning))
        u = self.hidden.step(self.senses.hidden(line, learning))
        if not learning:
            return self.senses.output(self.readout.predict(u))
        target_output = chosen_of(target.q, target.dq, self.outputs)
        value = self.readout.learn(u, self.senses.fit_target(target_output))
        self.refresh()
        return self.senses.output(value)

    def phase_at(self, t: float) -> int:
        """Index in `PHASES` at simulated time t [s]; test continues after its end."""
        return self.schedule.phase_at(t) if self._works else TRAIN

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()` to save, by name; empty without a network."""
        if not self._works:
            return {}
        parts = {"hidden": self.hidden, "readout": self.readout, "delay_line": self.delay_line}
        return {**parts, **self.senses.parts()}

    def save(self, path: str | Path) -> None:
        """Write weights, configuration, seed and running state to one ``.npz`` file."""
        weights.save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> ReflexNetwork:
        """Network from a file, which continues exactly where the saved one stopped.

        Raises:
            MissingFileError: The file does not exist.
            ParameterError: The file is of another kind or version.
        """
        return weights.load(cls, (FootForces, BodySensors), path)


@njit(cache=True)
def chosen_of(q, dq, outputs):
    """Positions, then velocities, of the joints that the network moves, (2k,)."""
    return np.concatenate((q[outputs], dq[outputs]))


@njit(cache=True)
def references(target_q, target_dq, prediction, outputs, driving):
    """References for the plant, and the error of the prediction.

    Args:
        target_q: Joint positions of the target [rad], (m,).
        target_dq: Joint velocities of the target [rad/s], (m,).
        prediction: Output of the network, positions, then velocities, (2k,).
        outputs: Indices of the joints that the network moves, (k,).
        driving: Whether the prediction replaces the target in these joints.

    Returns:
        Joint positions and velocities for the plant, (m,) each, and the rms error over the
        predicted positions [rad].
    """
    q, dq, squares = target_q.copy(), target_dq.copy(), 0.0
    for i, joint in enumerate(outputs):
        squares += (prediction[i] - target_q[joint]) ** 2
        if driving:
            q[joint], dq[joint] = prediction[i], prediction[len(outputs) + i]
    return q, dq, sqrt(squares / len(outputs))
