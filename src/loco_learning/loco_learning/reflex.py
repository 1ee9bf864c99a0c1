# SPDX-License-Identifier: Apache-2.0
"""The reflex network: forces on the feet in, references for hips and knees out."""

from __future__ import annotations

import zlib
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from loco_control.types import GaitTarget, LearningState, MotionCommand, RobotState

from . import weights
from .params import OUTPUT_JOINTS, PHASES, REFERENCES, LearnerParams
from .readout import Readout
from .reservoir import DelayLine, ElmLayer, GrfFilter
from .scaling import OUTPUTS, SCALING
from .schedule import CLOSING, STAND, TEST, TRAIN, Schedule

__all__ = [
    "CLOSING", "OUTPUT_JOINTS", "PHASES", "REFERENCES", "STAND", "TEST", "TRAIN",
    "LearnerParams", "ReflexNetwork",
]  # fmt: skip


class ReflexNetwork:
    """Delay line, fixed hidden layer and readout, trained while the robot trots.

    ==========  ===============  =====================================
    phase       drives the legs  readout
    ==========  ===============  =====================================
    stand       target           rests, the delay line fills
    train       target           learns at each tick
    closing     prediction       learns ever more rarely
    test        prediction       rests
    ==========  ===============  =====================================

    How learning fades in closing is told in `Schedule`. Source: thesis section 7.2.3.

    Args:
        params: Shape, scaling and schedule.
        dt: Control period [s].
        seed: Seed of the hidden weights.
    """

    KIND = "weights"  # of file in `archive.FORMATS`
    PARAMS = LearnerParams
    # Must agree to reuse weights:
    SHAPING = ("memory", "neurons", "activation", "scaling", "window", "bias_input")
    TRAINED = ("hidden", "readout", "scaling")  # parts that training makes; the rest is state

    def __init__(self, params: LearnerParams, dt: float, seed: int = 0):
        self.params, self.dt, self.seed = params, dt, seed
        rng = np.random.default_rng([seed, zlib.crc32(b"reflex")])
        p = params
        self.scaling = SCALING[p.scaling](p)
        self.grf_filter = GrfFilter(p.window, p.grf_threshold)
        inputs, width = self.scaling.inputs, self.scaling.weight_width
        self.delay_line = DelayLine(p.memory, inputs)
        self.hidden = ElmLayer(
            inputs * p.memory, p.neurons, width, p.hidden_bias, p.activation, rng
        )
        first = self.scaling.first_weights(p, rng)
        self.readout = Readout(p.neurons, OUTPUTS, p.regularisation, first)
        self.schedule = Schedule(p, dt)
        self.refresh()
        if p.weights:
            weights.restore_weights(self, p.weights)

    def reset(self) -> None:
        """Forget the past; trained weights too, unless they came from a file."""
        self.grf_filter.reset()
        self.delay_line.reset()
        self.scaling.reset()
        self.readout.reset()
        self.refresh()
        if self.params.weights:
            weights.restore_weights(self, self.params.weights)

    def refresh(self) -> None:
        """Recompute what is derived from the weights, after they were replaced."""
        flat = self.readout.weights.ravel()
        self._norm = sqrt(flat.dot(flat))

    def step(self, state: RobotState, target: GaitTarget) -> tuple[MotionCommand, LearningState]:
        """Answer one tick.

        Args:
            state: What the robot measures.
            target: What the gait generator wants at the same tick.

        Returns:
            Joint references for the plant, and what the network did.
        """
        phase = self.schedule.phase_of(state.tick)
        learning = self.schedule.learns(state.tick, phase)
        driving = self.params.enabled and phase >= CLOSING
        prediction = self._predict(state, target, learning)
        q, dq, error = references(target.q, target.dq, prediction, driving)
        command = MotionCommand(state.tick, state.t, q, dq)
        return command, LearningState(
            state.tick, state.t, prediction, error, self._norm, phase, driving, learning
        )

    def _predict(self, state: RobotState, target: GaitTarget, learning: bool) -> np.ndarray:
        """Output (16,) for this tick, after the update if there is one (eq. 3.17)."""
        if not self.params.enabled:
            return np.zeros(OUTPUTS)
        grf = self.grf_filter.step(state.grf[:, 2])
        line = self.delay_line.step(self.scaling.sample(grf, learning))
        u = self.hidden.step(self.scaling.hidden(line, learning))
        if not learning:
            return self.scaling.output(self.readout.predict(u))
        value = self.readout.learn(u, self.scaling.fit_target(wanted(target.q, target.dq)))
        self.refresh()
        return self.scaling.output(value)

    def phase_at(self, t: float) -> int:
        """Index in `PHASES` at simulated time t [s]; test goes on after its end."""
        return self.schedule.phase_at(t)

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()` to save, by name."""
        return {
            "hidden": self.hidden,
            "readout": self.readout,
            "scaling": self.scaling,
            "grf_filter": self.grf_filter,
            "delay_line": self.delay_line,
        }

    def about(self) -> dict[str, Any]:
        """What a weight file says beside the parameters."""
        return {"dt": self.dt, "seed": self.seed}

    @classmethod
    def remade(cls, params: LearnerParams, about: dict[str, Any]) -> ReflexNetwork:
        """Untrained network like the one that wrote `about`."""
        return cls(params, about["dt"], about["seed"])

    def save(self, path: str | Path) -> None:
        """Write weights, configuration, seed and running state to one ``.npz`` file."""
        weights.save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> ReflexNetwork:
        """Network as it was saved; it goes on exactly where the saved one stopped.

        Raises:
            MissingFileError: There is no such file.
            ParameterError: The file is not one of ours, or of another version.
        """
        return weights.load(cls, path)


@njit(cache=True)
def wanted(q, dq):
    """What the readout should say: hip and knee of the target, each (12,), as (16,)."""
    return np.concatenate((q[OUTPUT_JOINTS], dq[OUTPUT_JOINTS]))


@njit(cache=True)
def references(target_q, target_dq, prediction, driving):
    """What the plant shall follow, and how far the prediction is off.

    Args:
        target_q: Joint positions of the target [rad], (12,).
        target_dq: Joint velocities of the target [rad/s], (12,).
        prediction: Output of the network, (16,).
        driving: The prediction replaces the target where it says something.

    Returns:
        Joint positions and velocities to follow, each (12,), and the rms error over the
        predicted positions [rad].
    """
    q, dq, squares = target_q.copy(), target_dq.copy(), 0.0
    for i, joint in enumerate(OUTPUT_JOINTS):
        squares += (prediction[i] - target_q[joint]) ** 2
        if driving:
            q[joint], dq[joint] = prediction[i], prediction[len(OUTPUT_JOINTS) + i]
    return q, dq, sqrt(squares / len(OUTPUT_JOINTS))
