# SPDX-License-Identifier: Apache-2.0
"""Scaling of forces, hidden inputs and targets: two schemes with the same methods.

A scheme also defines the range of the random hidden weights and the initial readout, since
these depend on the scaling.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..params import LearnerParams

FEET = 4  # vertical forces; the constant is the fifth input, eq. (7.2)
OUTPUTS = 16  # eight positions and eight velocities, eq. (7.1)


class Unscaled:
    """Hidden inputs, targets and outputs in physical units."""

    def hidden(self, line: np.ndarray, learning: bool) -> np.ndarray:
        """Input of the hidden layer, (M inputs,), from the delay line, (M, inputs)."""
        return line.reshape(-1)

    def fit_target(self, target: np.ndarray) -> np.ndarray:
        """Target of the outputs, [rad] and [rad/s], in the units of the readout."""
        return target

    def output(self, value: np.ndarray) -> np.ndarray:
        """Readout in physical units, [rad] and [rad/s]."""
        return value


class PlateauScaling(Unscaled):
    """Forces in units of half the weight, clipped to [0, 1.5]; other values unscaled.

    The stance plateau of a trot is then about 1 and swing 0. Inputs must not be
    centred on zero: centred forces of a trot nearly change sign every
    half stride, and an odd activation without bias could not produce the even
    harmonics of the joint trajectories from them.
    """

    def __init__(self, params: LearnerParams):
        self.inputs = FEET + params.bias_input
        # Unit variance before the activation for inputs of order 1.
        self.weight_width = 0.5 * params.gain * np.sqrt(12.0 / (self.inputs * params.memory))
        self._grf_scale = params.grf_scale
        self._sample = np.ones(self.inputs)  # the last element is the bias

    def first_weights(self, params: LearnerParams, rng: np.random.Generator) -> np.ndarray:
        """Readout before training, (neurons, 16): zero."""
        return np.zeros((params.neurons, OUTPUTS))

    def reset(self) -> None:
        """Do nothing: this scaling has no state."""

    def sample(self, grf: np.ndarray, learning: bool) -> np.ndarray:
        """Delay-line sample (inputs,) from averaged vertical forces (4,) [N]."""
        plateau(grf, self._grf_scale, self._sample)
        return self._sample

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        return {}


@njit(cache=True)
def plateau(grf, scale, sample):
    """Write forces in units of `scale`, clipped to [0, 1.5], to the first elements of `sample`."""
    for i in range(len(grf)):
        sample[i] = min(max(grf[i] / scale, 0.0), 1.5)


class AuthorScaling:
    """Running min-max scaling of inputs, hidden inputs and targets, as in the author's code.

    Forces and bias are scaled to [-0.5, 1.5], each element of the delay line to
    [-1.5, 1.5] and the targets to [-0.5, 1.5]; all ranges grow during learning
    and are constant otherwise. Hidden weights are uniform in [-0.5, 0.5] times `gain`,
    without regard to the fan-in, and the initial readout is uniform in [0, 1].

    A constant has no range, so it is scaled to -0.5 and then -1.5: with M taps that is a
    hidden bias of -1.5 times the sum of M random weights, on which the result depends. Without
    the constant (`bias_input` false) nothing breaks the symmetry of tanh about 0.
    Source: the thesis author's published code; not described in the thesis.
    """

    CONSTANT = 0.5

    def __init__(self, params: LearnerParams):
        self.inputs = FEET + params.bias_input
        self.weight_width = 0.5 * params.gain
        self._scalers = {
            "input": RunningScaler(self.inputs, -0.5, 1.5),
            "hidden": RunningScaler(self.inputs * params.memory, -1.5, 1.5),
            "target": RunningScaler(OUTPUTS, -0.5, 1.5),
        }
        self._fitted = np.zeros(1, dtype=bool)

    def first_weights(self, params: LearnerParams, rng: np.random.Generator) -> np.ndarray:
        """Readout before training, (neurons, 16): uniform in [0, 1]."""
        return rng.uniform(0.0, 1.0, (params.neurons, OUTPUTS))

    def reset(self) -> None:
        """Discard all ranges."""
        self._fitted[:] = False
        for scaler in self._scalers.values():
            scaler.reset()

    def sample(self, grf: np.ndarray, learning: bool) -> np.ndarray:
        """Delay-line sample (inputs,) from vertical forces (4,) [N]; 0 before training."""
        sample = np.append(grf, self.CONSTANT)[: self.inputs]
        if learning:
            self._fitted[:] = True
            self._scalers["input"].fit(sample)
        return self._scalers["input"].scale(sample) if self._fitted[0] else np.zeros(self.inputs)

    def hidden(self, line: np.ndarray, learning: bool) -> np.ndarray:
        """Input of the hidden layer (M inputs,) from the delay line (M, inputs)."""
        history = line.reshape(-1)
        if learning:
            self._scalers["hidden"].fit(history)
        return self._scalers["hidden"].scale(history)

    def fit_target(self, target: np.ndarray) -> np.ndarray:
        """Target (16,) in the units of the readout; its range is extended to include it."""
        self._scalers["target"].fit(target)
        return self._scalers["target"].scale(target)

    def output(self, value: np.ndarray) -> np.ndarray:
        """Readout (16,) in physical units, [rad] and [rad/s]."""
        return self._scalers["target"].unscale(value)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        arrays = {"fitted": self._fitted}
        for name, scaler in self._scalers.items():
            arrays.update({f"{name}_{key}": value for key, value in scaler.state().items()})
        return arrays


class RunningScaler:
    """Min-max scaling to [low, high] by the extremes of the fitted samples.

    Elements without a range, such as a constant bias, are scaled to `low`.
    Source: the thesis author's use of scikit-learn's MinMaxScaler, fitted online.
    """

    def __init__(self, size: int, low: float, high: float):
        self.low, self.high = low, high
        self._min, self._max = np.empty(size), np.empty(size)
        self.reset()

    def reset(self) -> None:
        """Discard the extremes."""
        self._min[:] = np.inf
        self._max[:] = -np.inf

    def fit(self, sample: np.ndarray) -> None:
        """Extend the extremes to include a sample (size,)."""
        np.minimum(self._min, sample, out=self._min)
        np.maximum(self._max, sample, out=self._max)

    def scale(self, sample: np.ndarray) -> np.ndarray:
        """Physical value scaled to [low, high], shape (size,)."""
        offset, width = self._range()
        return self.low + (self.high - self.low) * (sample - offset) / width

    def unscale(self, value: np.ndarray) -> np.ndarray:
        """Inverse of `scale`, shape (size,)."""
        offset, width = self._range()
        return offset + width * (value - self.low) / (self.high - self.low)

    def _range(self) -> tuple[np.ndarray, np.ndarray]:
        width = self._max - self._min
        offset = np.where(np.isfinite(self._min), self._min, 0.0)
        return offset, np.where(np.isfinite(width) & (width > 0.0), width, 1.0)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        return {"min": self._min, "max": self._max}


Scaling = PlateauScaling | AuthorScaling
SCALING: dict[str, type[Scaling]] = {"plateau": PlateauScaling, "author": AuthorScaling}
