# SPDX-License-Identifier: Apache-2.0
"""Parts of the reflex network before the readout: force filter, delay line, ELM layer.

Each part has `state()`, the arrays that change during a run, and is restored
by copying them back (`ReflexNetwork.save`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..params import ACTIVATIONS, PhasedParams


class DelayLine:
    """The last `length` samples, newest first, as one contiguous vector.

    The buffer is twice as long and each sample is written twice, `length`
    rows apart: a contiguous window then exists at every position without
    shifting data. Source: thesis section 7.2.2.
    """

    def __init__(self, length: int, size: int):
        self.length, self.size = length, size
        self.reset()

    def reset(self) -> None:
        """Fill with zeros."""
        self._buffer = np.zeros((2 * self.length, self.size))
        self._head = np.zeros(1, dtype=np.int64)

    def step(self, sample: np.ndarray) -> np.ndarray:
        """Push a sample (size,) and return a view of the line, (length, size)."""
        return push(self._buffer, self._head, sample)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        return {"buffer": self._buffer, "head": self._head}


class GrfFilter:
    """Moving average of a few signals, by default four vertical forces, then a dead zone.

    The average is over the available samples until the window is full.
    Source: thesis section 7.3.3, item 2 (15 samples and a threshold).
    """

    def __init__(self, window: int, threshold: float = 0.0, size: int = 4):
        self.window, self.threshold, self.size = window, threshold, size
        self.reset()

    def reset(self) -> None:
        """Discard all samples."""
        self._line = DelayLine(self.window, self.size)
        self._samples = np.zeros(1, dtype=np.int64)

    def step(self, grf: np.ndarray) -> np.ndarray:
        """Average of the samples (size,), forces in [N], over the window, shape (size,)."""
        line = self._line.step(grf)
        return average(line, self._samples, self.threshold)

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        return {"seen": self._samples, **self._line.state()}


class ElmLayer:
    """Fixed random layer, h = f(W_inᵀ v + b). Source: thesis section 7.2.2, fig. 7.2.

    Args:
        inputs: Length of v.
        width: Hidden weights are uniform in [-width, width].
        params: Length N of h, range of the biases, and activation.
        rng: Random generator of the weights.
    """

    def __init__(self, inputs: int, width: float, params: PhasedParams, rng: np.random.Generator):
        neurons, bias = params.neurons, params.hidden_bias
        self.weights = rng.uniform(-width, width, (inputs, neurons))  # (inputs, N)
        self.bias = rng.uniform(-bias, bias, neurons) if bias else np.zeros(neurons)
        self._activation = ACTIVATIONS.index(params.activation)
        self._hidden = np.zeros(neurons)

    def step(self, v: np.ndarray) -> np.ndarray:
        """Hidden activity for an input (inputs,), shape (N,); overwritten by the next call."""
        project(self.weights, v, self.bias, self._activation, self._hidden)
        return self._hidden

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save, with the weights, so that a file does not depend on the generator."""
        return {"weights": self.weights, "bias": self.bias}


@njit(cache=True)
def push(buffer, head, sample):
    """Write a sample to a delay line's buffer and return its window, newest first."""
    length = len(buffer) // 2
    first = (head[0] - 1) % length
    head[0] = first
    for i in range(len(sample)):
        buffer[first, i] = buffer[first + length, i] = sample[i]
    return buffer[first : first + length]


@njit(cache=True)
def average(line, samples, threshold):
    """Mean over the available rows, at most all of them; values below the threshold are zero."""
    samples[0] = min(samples[0] + 1, len(line))
    mean = np.zeros(line.shape[1])
    for row in line:
        mean += row
    mean /= samples[0]
    for i in range(len(mean)):
        if mean[i] < threshold and threshold > 0.0:
            mean[i] = 0.0
    return mean


@njit(cache=True)
def project(weights, v, bias, activation, hidden):
    """Write f(weightsᵀ v + bias) to `hidden`.

    The outer loop is over inputs and the inner one over neurons: the inner loop then
    vectorises without reordering a sum, and needs no BLAS thread.
    """
    inputs, neurons = weights.shape
    for j in range(neurons):
        hidden[j] = bias[j]
    for i in range(inputs):
        x = v[i]
        for j in range(neurons):
            hidden[j] += weights[i, j] * x
    for j in range(neurons):
        hidden[j] = np.tanh(hidden[j]) if activation == 0 else max(hidden[j], 0.0)
