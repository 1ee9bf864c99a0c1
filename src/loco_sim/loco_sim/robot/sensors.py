# SPDX-License-Identifier: Apache-2.0
"""Sensors of a robot from ``robot.yaml``: resolution, noise and rate of readings.

Without a `sensors` section measurements are exact. With one, velocities are differences of
position readings, as computed on the robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import floor
from pathlib import Path

import numpy as np

from loco_control.params import Params, parameter
from loco_control.types import RobotState

from .hall import HallSensor, check_joints, read_table


@dataclass(frozen=True)
class HallParams(Params):
    """Hall sensors at the joints listed in a table."""

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
    exact: bool = parameter(
        False, "no rounding and no noise, whatever the sensors are: what a model expects to read"
    )

    def hall_sensors(self, folder: Path, joints: tuple[str, ...]) -> dict[str, HallSensor]:
        """Hall sensors by joint, read from the table.

        Raises:
            MissingFileError: There is no such table.
            ParameterError: The table is invalid, or has a joint that the robot lacks.
        """
        if not self.hall.table:
            return {}
        path = folder / self.hall.table
        sensors = read_table(path, self.hall.bits)
        check_joints(path, sensors, joints)
        return sensors


class Sensors:
    """Simulation of a robot's sensors, deterministic for a seed.

    Attributes:
        adc: Last counts of each Hall sensor, in the order of the joints.
    """

    def __init__(
        self, params: SensorParams, hall: dict[str, HallSensor], joints: tuple[str, ...], dt: float
    ):
        """Prepare the sensors, which need `reset` before the first reading.

        Args:
            params: Parameters of the sensors.
            hall: Hall sensors by joint.
            joints: The robot's joints.
            dt: Control period [s].
        """
        self._params, self._hall = params, [(i, hall[j]) for i, j in enumerate(joints) if j in hall]
        step = params.encoder.resolution
        with_encoder = [j not in hall and step > 0.0 for j in joints]
        self._encoder, self._step = np.flatnonzero(with_encoder).tolist(), step
        self._every = max(1, round(1.0 / (params.rate * dt))) if params.rate > 0.0 else 1
        self._period = self._every * dt

    def reset(self, seed: int) -> None:
        """Restart the noise; the next reading is the first."""
        self._rng = np.random.default_rng([seed, 0, *b"sensors"])
        self._last: RobotState | None = None
        self.adc = [0] * len(self._hall)

    def measure(self, truth: RobotState) -> RobotState:
        """State with sensor readings in place of true values."""
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
        noise = self._rng.standard_normal(6 + len(self._hall))
        q = np.array(self._positions(truth.q.tolist(), noise[6:].tolist()))
        imu = self._params.imu
        if self._params.exact:
            noise[:] = 0.0
        self._last = RobotState(
            tick=truth.tick,
            t=truth.t,
            q=q,
            dq=np.zeros(len(q)) if last is None else (q - last.q) / self._period,
            tau=truth.tau,
            grf=truth.grf,
            orientation=truth.orientation,
            angular_velocity=truth.angular_velocity + imu.gyro_noise * noise[:3],
            linear_acceleration=truth.linear_acceleration + imu.acceleration_noise * noise[3:6],
            contact=truth.contact,
        )
        return self._last

    def _positions(self, q: list[float], noise: list[float]) -> list[float]:
        """Measured joint positions from the true positions `q` [rad or m], (n,)."""
        if self._params.exact:
            for i, sensor in self._hall:
                q[i] = sensor.reached(q[i])
            return q
        step, deviation = self._step, self._params.hall.noise
        for i in self._encoder:
            q[i] = step * floor(q[i] / step + 0.5)
        for k, (i, sensor) in enumerate(self._hall):
            counts = self.adc[k] = sensor.counts(q[i], deviation * noise[k])
            q[i] = sensor.angle(counts)
        return q
