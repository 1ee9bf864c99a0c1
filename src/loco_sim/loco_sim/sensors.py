# SPDX-License-Identifier: Apache-2.0
"""Sensors of a robot as ``robot.yaml`` lists them: resolution, noise and rate of readings.

Without a `sensors` section a plant measures the truth. With one, velocities are
differences of position readings, as the robot's computer would form them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from loco_control.params import Params, parameter
from loco_control.types import RobotState

from .hall import HallSensor, check_joints, read_table


@dataclass(frozen=True)
class HallParams(Params):
    """Hall sensors at the joints of a table."""

    table: str = parameter("", "CSV file beside robot.yaml with joint,angle_deg,counts")
    bits: int = parameter(12, "resolution of the converter", "bit", low=1, high=24)
    noise: float = parameter(0.0, "standard deviation of a reading", "counts", low=0.0, high=1e4)


@dataclass(frozen=True)
class EncoderParams(Params):
    """Encoders of all joints without a Hall sensor."""

    resolution: float = parameter(0.0, "step of a reading", "rad or m", low=0.0, high=1.0)


@dataclass(frozen=True)
class ImuParams(Params):
    """Inertial measurement unit in the base."""

    gyro_noise: float = parameter(0.0, "standard deviation of a rate", "rad/s", low=0.0, high=10.0)
    acceleration_noise: float = parameter(
        0.0, "standard deviation of an acceleration", "m/s²", low=0.0, high=100.0
    )


@dataclass(frozen=True)
class SensorParams(Params):
    """All sensors of a robot."""

    hall: HallParams = parameter(HallParams(), "Hall sensors")
    encoder: EncoderParams = parameter(EncoderParams(), "encoders")
    imu: ImuParams = parameter(ImuParams(), "inertial measurement unit")
    rate: float = parameter(
        0.0, "readings per second, held in between; 0 is the control rate", "Hz", low=0.0, high=1e5
    )

    def hall_sensors(self, folder: Path, joints: tuple[str, ...]) -> dict[str, HallSensor]:
        """Hall sensors by joint, read from the table.

        Raises:
            MissingFileError: There is no such table.
            ParameterError: The table is not one, or has a joint that the robot lacks.
        """
        if not self.hall.table:
            return {}
        path = folder / self.hall.table
        sensors = read_table(path, self.hall.bits)
        check_joints(path, sensors, joints)
        return sensors


class Sensors:
    """Readings of a robot's sensors, deterministic per seed."""

    def __init__(
        self, params: SensorParams, hall: dict[str, HallSensor], joints: tuple[str, ...], dt: float
    ):
        """Prepare; nothing is read before `reset`.

        Args:
            params: What the sensors are like.
            hall: Hall sensors by joint.
            joints: The robot's joints.
            dt: Control period [s].
        """
        self._params, self._hall = params, [(i, hall[j]) for i, j in enumerate(joints) if j in hall]
        step = params.encoder.resolution
        with_encoder = [j not in hall and step > 0.0 for j in joints]
        self._encoder, self._step = np.flatnonzero(with_encoder), step
        self._every = max(1, round(1.0 / (params.rate * dt))) if params.rate > 0.0 else 1
        self._period = self._every * dt

    def reset(self, seed: int) -> None:
        """Start the noise anew; the next reading is the first."""
        self._rng = np.random.default_rng([seed, 0, *b"sensors"])
        self._last: RobotState | None = None
        self.adc = np.zeros(len(self._hall), dtype=int)

    def measure(self, truth: RobotState) -> RobotState:
        """What the sensors say instead of the truth."""
        last = self._last
        if last is not None and truth.tick % self._every:
            return replace(
                last,
                tick=truth.tick,
                t=truth.t,
                tau=truth.tau,
                grf=truth.grf,
                contact=truth.contact,
            )
        q = self._positions(truth.q)
        imu, rng = self._params.imu, self._rng
        self._last = replace(
            truth,
            q=q,
            dq=np.zeros(len(q)) if last is None else (q - last.q) / self._period,
            angular_velocity=truth.angular_velocity + imu.gyro_noise * rng.standard_normal(3),
            linear_acceleration=truth.linear_acceleration
            + imu.acceleration_noise * rng.standard_normal(3),
        )
        return self._last

    def _positions(self, truth: np.ndarray) -> np.ndarray:
        q = truth.copy()
        step, there = self._step, self._encoder
        if len(there):
            q[there] = step * np.floor(q[there] / step + 0.5)
        noise = self._params.hall.noise * self._rng.standard_normal(len(self._hall))
        for k, (i, sensor) in enumerate(self._hall):
            self.adc[k] = sensor.counts(truth[i], noise[k])
            q[i] = sensor.angle(self.adc[k])
        return q
