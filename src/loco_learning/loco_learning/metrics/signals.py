# SPDX-License-Identifier: Apache-2.0
"""Metrics of thesis section 3.6 as pure functions of arrays, one equation each.

Where the thesis or its code is wrong or incomplete, the docstring states the definition used
here. ``metrics.METRICS`` applies the functions to a log.
"""

from __future__ import annotations

import numpy as np

from loco_sim.robot.equipment import GRAVITY

from ..errors import mean_range, mse, nrmse


def excursion(x: np.ndarray) -> float:
    """Largest minus smallest value; of the trunk height it is the stability S, eq. (3.27).

    Lower is steadier. The thesis takes the centre of gravity of the trunk, without the weight of
    the legs (section 3.6.1); here it is the origin of the base, in the middle of the hips.
    """
    return float(np.ptp(x)) if len(x) else float("nan")


def mechanical_power(dq: np.ndarray, tau: np.ndarray) -> float:
    """Mean of the summed joint power [W]; negative work counts against, eq. (3.28).

    Departure: mean over time as in the author's code (the equation only sums), and
    the inner sum runs over joints (the equation says T_test).

    Args:
        dq: Joint velocity [rad/s], (T, J).
        tau: Joint torque [N·m], (T, J).
    """
    return float(np.mean(np.sum(dq * tau, axis=1)))


def positive_power(dq: np.ndarray, tau: np.ndarray) -> float:
    """As `mechanical_power`, but negative work counts as 0 [W]. Not from the thesis."""
    return float(np.mean(np.sum(np.maximum(dq * tau, 0.0), axis=1)))


def mean_speed(x: np.ndarray, dt: float) -> float:
    """Forward speed [m/s]: distance along x over time, eq. (3.30). x in [m], (T,)."""
    return float((x[-1] - x[0]) / ((len(x) - 1) * dt)) if len(x) > 1 else float("nan")


def cost_of_transport(power: float, speed: float, mass: float) -> float:
    """P / (m g |V|) [-], lower is better, eq. (3.31).

    Departure: the equation prints the inverse, V / (m P); figures and code use this one.
    """
    return power / (mass * GRAVITY * abs(speed)) if speed else float("inf")


def saturated_score(power: float, speed: float, mass: float, reference: float) -> float:
    """V / m tanh(P_ref / P) [m/(s·kg)], higher is better, eq. (3.32)."""
    return speed / mass * float(np.tanh(reference / power)) if power else speed / mass


def peak_force(grf: np.ndarray) -> float:
    """Largest normal force on any foot [N], eq. (3.33). grf: (T, 4, 3) in the world frame."""
    return float(np.max(np.abs(grf[..., 2])))


def mae(target: np.ndarray, actual: np.ndarray) -> float:
    """Mean absolute error over time and channels, eq. (3.35)."""
    return float(np.mean(np.abs(target - actual)))


def nrmse_global(target: np.ndarray, actual: np.ndarray) -> float:
    """NRMSE as in the author's code: over the range of all channels of both signals at once.

    With positions and velocities mixed, the velocities determine the range.
    """
    both = np.concatenate((target, actual))
    width = float(both.max() - both.min())
    return float(np.sqrt(mse(target, actual)) / width) if width > 0.0 else float("nan")


def accuracy(target: np.ndarray, actual: np.ndarray) -> float:
    """1 / NRMSE, eq. (3.37); infinite for equal signals."""
    error = nrmse(target, actual)
    return 1.0 / error if error else float("inf")


def smoothed_nrmse(
    target: np.ndarray, actual: np.ndarray, window: int, width: float | None = None
) -> np.ndarray:
    """NRMSE at each tick, averaged over the last `window` ticks (thesis section 8.3, fig. 8.3).

    Args:
        target: r, (T, J).
        actual: q, (T, J).
        window: Ticks of one gait period; the first `window` - 1 results use the available ticks.
        width: Mean range of the target; by default that of `target`.

    Returns:
        (T,).
    """
    width = mean_range(target) if width is None else width
    return moving_mean(np.sqrt(np.mean((target - actual) ** 2, axis=1)), window) / width


def moving_mean(x: np.ndarray, window: int) -> np.ndarray:
    """Mean of the last `window` samples along the first axis, fewer at the start."""
    total = np.cumsum(x, axis=0)
    total[window:] = total[window:] - total[:-window]
    count = np.minimum(np.arange(1, len(x) + 1), window)
    return total / count.reshape(-1, *[1] * (x.ndim - 1))


def fmse(target: np.ndarray, actual: np.ndarray) -> float:
    """Mean squared difference of the amplitude spectra, eqs. (3.38) and (3.39).

    Departure: magnitudes are compared, scaled by 2/T, so that a mere phase shift does not
    count, which is the purpose of the metric in the text.
    """
    scale = 2.0 / len(target)
    spectra = [scale * np.abs(np.fft.rfft(x, axis=0)) for x in (target, actual)]
    return float(np.mean(np.sum((spectra[0] - spectra[1]) ** 2, axis=1)))


def mawe(target: np.ndarray, actual: np.ndarray, shift: int) -> float:
    """Smallest mean absolute error over common shifts of -shift … shift ticks, eq. (3.40).

    Departure: one shift for all channels over the whole interval, not one per tick.
    """
    n = len(target)
    shift = min(shift, n - 1)
    return min(
        mae(target[max(0, -k) : n - max(0, k)], actual[max(0, k) : n - max(0, -k)])
        for k in range(-shift, shift + 1)
    )


def stride_frequency(x: np.ndarray, dt: float, low: float = 0.3, high: float = 5.0) -> float:
    """Frequency of the largest spectral peak between `low` and `high` [Hz], over all channels.

    Blackman-Harris window and a parabola through the logarithms around the peak, as
    in the author's code; the band excludes drift and the half-stride rhythm of the trunk.

    Args:
        x: Signal with one period per stride, (T, J).
        dt: Sample time [s].
        low: Lower end of the band [Hz].
        high: Upper end of the band [Hz].
    """
    n = len(x)
    if n * dt < 2.0 / low / 3.0:
        return float("nan")
    k = 2.0 * np.pi * np.arange(n) / n
    window = 0.35875 - 0.48829 * np.cos(k) + 0.14128 * np.cos(2 * k) - 0.01168 * np.cos(3 * k)
    spectrum = np.abs(np.fft.rfft((x - x.mean(axis=0)) * window[:, None], axis=0)).sum(axis=1)
    frequency = np.fft.rfftfreq(n, dt)
    band = np.flatnonzero((frequency >= low) & (frequency <= high))
    band = band[(band > 0) & (band < len(spectrum) - 1)]
    peak = band[np.argmax(spectrum[band])]
    if spectrum[peak] <= 0.0:
        return float("nan")
    a, b, c = np.log(spectrum[peak - 1 : peak + 2] + 1e-300)
    curve = a - 2.0 * b + c
    return float((peak + (0.5 * (a - c) / curve if curve else 0.0)) / (n * dt))


def phase_lag(target: np.ndarray, actual: np.ndarray, angle: np.ndarray, window: int) -> np.ndarray:
    """Delay of the actual rhythm behind the target's [strides], unwrapped, (T,).

    Not from the thesis. Each channel is multiplied by exp(-2 pi i angle) and averaged over `window`
    ticks, which gives its first harmonic as a slowly rotating complex number; the lag is the angle
    between target and actual, over all channels together.

    Args:
        target: r, (T, J).
        actual: q, (T, J).
        angle: Stride phase of the target [strides], (T,).
        window: Ticks of one or a few gait periods.
    """
    turn = np.exp(-2j * np.pi * angle)[:, None]
    r, q = (moving_mean((x - x.mean(axis=0)) * turn, window) for x in (target, actual))
    across = np.sum(r * np.conj(q), axis=1)
    return np.unwrap(np.angle(across)) / (2.0 * np.pi)


def stride_amplitude(x: np.ndarray, window: int) -> np.ndarray:
    """Mean over channels of the range in the last `window` ticks, (T,); NaN before."""
    out = np.full(len(x), np.nan)
    if len(x) >= window:
        view = np.lib.stride_tricks.sliding_window_view(x, window, axis=0)
        out[window - 1 :] = np.mean(view.max(axis=-1) - view.min(axis=-1), axis=1)
    return out


def snr(x: np.ndarray) -> float:
    """|mean| / standard deviation, mean over channels, as in the author's code."""
    deviation = np.std(x, axis=0)
    return float(np.mean(np.abs(np.mean(x, axis=0)) / np.where(deviation > 0.0, deviation, np.nan)))


def limit_cycle(target: np.ndarray, actual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Target and actual in the two principal components of the target [-], each (T, 2).

    Each channel is first measured in standard deviations of the target. With positions
    and velocities together, (T, 16), the two components are in quadrature and the gait
    is a closed loop. Signs are fixed: the largest weight of each component is positive.
    Source: thesis section 3.6.3.3, fig. 8.4.
    """
    mean, deviation = target.mean(axis=0), np.std(target, axis=0)
    deviation = np.where(deviation > 0.0, deviation, 1.0)
    target, actual = (target - mean) / deviation, (actual - mean) / deviation
    _, _, axes = np.linalg.svd(target, full_matrices=False)
    axes = axes[:2] * np.sign(axes[np.arange(2), np.abs(axes[:2]).argmax(axis=1)])[:, None]
    return target @ axes.T, actual @ axes.T


def roll_pitch_yaw(quaternion: np.ndarray) -> np.ndarray:
    """Fixed-axis angles [rad], (T, 3), of quaternions x y z w, (T, 4); yaw unwrapped."""
    x, y, z, w = quaternion.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    return np.stack([roll, pitch, yaw], axis=1)
