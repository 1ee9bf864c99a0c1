# SPDX-License-Identifier: Apache-2.0
"""Closed loop of a joint robot: its sensors in, targets of its driven joints out.

Step two of two-steps learning: a gait found in open loop (step one) is taught
to a reservoir that feels the body, which then drives alone. Source: thesis
sections 3.5 and 7.2, here with passive knees and an IMU for the forces on the feet.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from loco_control.exceptions import ParameterError
from loco_control.params import parameter

from . import weights
from .joint_sensors import KINDS, passive_joints, sensor_kinds, sensor_vector
from .params import ACTIVATIONS, PHASES, PhasedParams
from .readout import Readout
from .reservoir import DelayLine, ElmLayer, GrfFilter
from .schedule import CLOSING, TRAIN, Schedule

__all__ = [
    "KINDS", "PHASES", "JointLearnerParams", "JointReflex",
    "passive_joints", "sensor_kinds", "sensor_vector",
]  # fmt: skip

INPUTS = {"all": KINDS, "joints": ("joint",), "imu": ("gyro", "tilt")}


@dataclass(frozen=True)
class JointLearnerParams(PhasedParams):
    """Shape, scaling and schedule of a joint reflex.

    Each sensor reads (value - centre) / scale, clipped to [-limit, limit]: fixed numbers
    per kind of sensor, so that nothing depends on what the robot felt first.
    With `weights` the readout is loaded and never changed.
    """

    enabled: bool = parameter(False, "false: the target drives for ever (open loop)")
    inputs: str = parameter("all", "which sensors are felt", choices=tuple(INPUTS))
    memory: int = parameter(50, "delay-line length M", "tick", 1, 1000)
    window: int = parameter(1, "moving average of the sensors", "tick", 1, 1000)
    neurons: int = parameter(200, "hidden neurons N", "-", 1, 5000)
    activation: str = parameter("tanh", "hidden activation", choices=ACTIVATIONS)
    regularisation: float = parameter(5.0, "alpha of RLS, P starts at I/alpha", "-", 1e-12, 1e6)
    gain: float = parameter(1.0, "factor on the hidden weights", "-", 0.0, 100.0)
    hidden_bias: float = parameter(1.0, "hidden bias is uniform in [-b, b]", "-", 0.0, 100.0)
    joint_centre: float = parameter(1.0, "passive joint angle that reads 0", "rad", -10.0, 10.0)
    joint_scale: float = parameter(0.3, "angle from the centre that reads 1", "rad", 1e-6, 1e3)
    gyro_scale: float = parameter(3.0, "turning rate that reads 1", "rad/s", 1e-6, 1e3)
    tilt_scale: float = parameter(0.3, "roll or pitch that reads 1", "rad", 1e-6, 1e3)
    limit: float = parameter(2.0, "scaled sensors are clipped to ± this", "-", 0.1, 100.0)
    stand: float = parameter(1.0, "phase: the readout rests, delay line fills", "s", 0.0, 1e5)
    train: float = parameter(20.0, "phase: target drives, readout learns", "s", 0.0, 1e5)
    closing: float = parameter(20.0, "phase: prediction drives, learning fades", "s", 0.0, 1e5)
    test: float = parameter(30.0, "phase: prediction drives, readout frozen", "s", 0.0, 1e5)
    closing_block: int = parameter(10, "learning fades by this many ticks", "tick", 1, 10000)
    weights: str = parameter("", "file with trained weights; empty: learn them", "path")

    def centre_and_scale(self, kind: str) -> tuple[float, float]:
        """What a sensor of a kind reads as 0, and how far from there it reads 1."""
        return {
            "joint": (self.joint_centre, self.joint_scale),
            "gyro": (0.0, self.gyro_scale),
            "tilt": (0.0, self.tilt_scale),
        }[kind]


class JointReflex:
    """Delay line over the sensors, fixed hidden layer, readout of positions and velocities.

    Phases and learning follow `Schedule`: the target drives in stand and train, the
    readout in closing and test. Switched off, it hands the target through.

    Args:
        params: Shape, scaling and schedule.
        sensors: Kind of each sensor, as `sensor_kinds` says, (k,).
        outputs: Driven joints, m.
        dt: Control period [s].
        seed: Seed of the hidden weights.

    Raises:
        ParameterError: The robot has none of the sensors that `params.inputs` asks for.
    """

    KIND = "joint_weights"  # of file in `archive.FORMATS`
    PARAMS = JointLearnerParams
    SHAPING = ("inputs", "memory", "window", "neurons", "activation",
               "joint_centre", "joint_scale", "gyro_scale", "tilt_scale", "limit")  # fmt: skip
    TRAINED = ("hidden", "readout")

    def __init__(
        self,
        params: JointLearnerParams,
        sensors: Sequence[str],
        outputs: int,
        dt: float,
        seed: int = 0,
    ):
        self.params, self.sensors, self.outputs = params, tuple(sensors), outputs
        self.dt, self.seed = dt, seed
        self.schedule = Schedule(params, dt)
        if not params.enabled:
            return
        self._chosen, self._centre, self._factor = scaling(params, self.sensors)
        size = len(self._chosen) + 1  # and a constant
        rng = np.random.default_rng([seed, zlib.crc32(b"reflex")])
        width = 0.5 * params.gain * sqrt(12.0 / (size * params.memory))  # unit variance or so
        self.average = GrfFilter(params.window, 0.0, size)
        self.delay_line = DelayLine(params.memory, size)
        self.hidden = ElmLayer(
            size * params.memory, params.neurons, width, params.hidden_bias, params.activation, rng
        )
        self.readout = Readout(params.neurons, 2 * outputs, params.regularisation)
        self._sample = np.ones(size)  # the last element is the constant
        self._load()

    def reset(self) -> None:
        """Forget the past; trained weights too, unless they came from a file."""
        if self.params.enabled:
            self.average.reset()
            self.delay_line.reset()
            self.readout.reset()
            self._load()

    def _load(self) -> None:
        self.refresh()
        if self.params.weights:
            weights.restore_weights(self, self.params.weights)

    def refresh(self) -> None:
        """Recompute what is derived from the weights, after they were replaced."""
        flat = self.readout.weights.ravel() if self.params.enabled else np.zeros(1)
        self.norm = sqrt(flat.dot(flat))  # Frobenius norm of the readout [-]

    def step(
        self,
        tick: int,
        t: float,
        sensors: np.ndarray,
        target_q: np.ndarray,
        target_dq: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int, float]:
        """Answer one tick.

        Args:
            tick: Control periods since reset.
            t: Simulated time [s]; only the tick counts.
            sensors: What the robot feels, as `sensor_vector` gives it, (k,).
            target_q: Positions that the gait generator wants [rad], (m,).
            target_dq: Velocities that it wants [rad/s], (m,).

        Returns:
            Positions (m,) and velocities (m,) to follow, the predicted positions (m,), the
            phase as an index in `PHASES`, and the rms of prediction minus target [rad].
            Switched off: the target, zeros, the phase "train" (the target drives) and 0.
        """
        if not self.params.enabled:
            return target_q, target_dq, np.zeros(self.outputs), TRAIN, 0.0
        phase = self.schedule.phase_of(tick)
        value = self._predict(sensors, target_q, target_dq, self.schedule.learns(tick, phase))
        m = self.outputs
        q, dq = value[:m], value[m:]
        error = float(np.sqrt(np.mean((q - target_q) ** 2)))
        if phase >= CLOSING:
            return q, dq, q.copy(), phase, error
        return target_q, target_dq, q, phase, error

    def _predict(
        self, sensors: np.ndarray, q: np.ndarray, dq: np.ndarray, learning: bool
    ) -> np.ndarray:
        """Positions, then velocities, (2m,); after the update if there is one (eq. 3.17)."""
        scaled(sensors, self._chosen, self._centre, self._factor, self.params.limit, self._sample)
        line = self.delay_line.step(self.average.step(self._sample))
        u = self.hidden.step(line.reshape(-1))
        if not learning:
            return self.readout.predict(u)
        value = self.readout.learn(u, np.concatenate((q, dq)))
        self.refresh()
        return value

    def phase_at(self, t: float) -> int:
        """Index in `PHASES` at simulated time t [s]; test goes on after its end."""
        return self.schedule.phase_at(t) if self.params.enabled else TRAIN

    def parts(self) -> dict[str, Any]:
        """Parts with a `state()` to save, by name; none if switched off."""
        if not self.params.enabled:
            return {}
        names = ("hidden", "readout", "average", "delay_line")
        return {name: getattr(self, name) for name in names}

    def about(self) -> dict[str, Any]:
        """What a weight file says beside the parameters."""
        shape = {"sensors": list(self.sensors), "outputs": self.outputs}
        return {**shape, "dt": self.dt, "seed": self.seed}

    @classmethod
    def remade(cls, params: JointLearnerParams, about: dict[str, Any]) -> JointReflex:
        """Untrained network like the one that wrote `about`."""
        return cls(params, about["sensors"], about["outputs"], about["dt"], about["seed"])

    def save(self, path: str | Path) -> None:
        """Write weights, configuration, seed and running state to one ``.npz`` file."""
        weights.save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> JointReflex:
        """Network as it was saved; it goes on exactly where the saved one stopped.

        Raises:
            MissingFileError: There is no such file.
            ParameterError: The file is not one of ours, or of another version.
        """
        return weights.load(cls, path)


def scaling(
    params: JointLearnerParams, sensors: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the sensors that are felt, their centres, and one over their scales, each (s,)."""
    chosen = [i for i, kind in enumerate(sensors) if kind in INPUTS[params.inputs]]
    if not chosen:
        raise ParameterError(
            f"learner.inputs is {params.inputs!r}, but of the sensors of this robot "
            f"({', '.join(sensors) or 'none'}) none is of that kind"
        )
    centre, scale = np.array([params.centre_and_scale(sensors[i]) for i in chosen]).T
    return np.array(chosen), centre, 1.0 / scale


@njit(cache=True)
def scaled(values, chosen, centre, factor, limit, sample):
    """Write the chosen values, centred, scaled and clipped, to the first of `sample`."""
    for i, j in enumerate(chosen):
        sample[i] = min(max((values[j] - centre[i]) * factor[i], -limit), limit)
