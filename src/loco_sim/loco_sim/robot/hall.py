# SPDX-License-Identifier: Apache-2.0
"""Hall sensors at joints: counts of an analog-digital converter as a function of the angle.

The magnet's field falls with the cube of the distance, so the resolution is high near the
magnet (0.01 degrees per count on Tigrillo) and low far from it (1 degree). The sensor is modelled
by a table of angles and counts per joint, interpolated monotonically (PCHIP); the cubic of the
author's code overshoots beyond the last measured point.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.reading import parse_csv, read_text

GRID = 4001  # number of points at which the interpolation is tabulated
HEADER = ["joint", "angle_deg", "counts"]


class HallSensor:
    """Characteristic of one joint's Hall sensor, from angle to counts and back."""

    def __init__(self, angles: np.ndarray, counts: np.ndarray, bits: int = 12):
        """Interpolate a table.

        Args:
            angles: Joint positions [rad], (k,), increasing.
            counts: Counts of the converter at these positions, (k,), increasing.
            bits: Resolution of the converter.

        Raises:
            ParameterError: Fewer than two points, or values that do not increase.
        """
        rises = len(angles) > 1 and np.all(np.diff(angles) > 0.0) and np.all(np.diff(counts) > 0.0)
        if not rises:
            raise ParameterError("a Hall table needs two points or more, both columns rising")
        self.top = 2**bits - 1
        self._points = angles, counts
        self._first, self._last = float(angles[0]), float(angles[-1])
        self._per = (GRID - 1) / (self._last - self._first)

    # Lists, since looking up one number in an array takes several times as long. Made when a sensor
    # is read first: most processes only look at the robot, and SciPy takes 0.2 s to import.

    @cached_property
    def _counts(self) -> list[float]:
        """Exact counts at the angles of the grid."""
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(*self._points)(np.linspace(self._first, self._last, GRID)).tolist()

    @cached_property
    def _angle_of(self) -> list[float]:
        """Angle of each reading [rad]."""
        grid = np.linspace(self._first, self._last, GRID)
        return np.interp(np.arange(self.top + 1.0), self._counts, grid).tolist()

    def counts(self, angle: float, noise: float = 0.0) -> int:
        """Reading of the converter at an angle [rad], with additive noise [counts]."""
        at = min(max((angle - self._first) * self._per, 0.0), GRID - 1.0)
        i = min(int(at), GRID - 2)
        below = self._counts[i]
        exact = below + (at - i) * (self._counts[i + 1] - below)
        return min(max(round(exact + noise), 0), self.top)

    def reached(self, angle: float | np.ndarray) -> float | np.ndarray:
        """The angle clipped to the range of the table [rad]."""
        if isinstance(angle, float):  # many times faster than an array with one element
            return min(max(angle, self._first), self._last)
        return np.clip(angle, self._first, self._last)

    def angle(self, counts: int) -> float:
        """Angle computed from a reading [rad]."""
        return self._angle_of[counts]


def read_table(path: Path, bits: int = 12) -> dict[str, HallSensor]:
    """Sensors by joint from a CSV file with the columns joint, angle_deg, counts.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is not such a table.
    """
    try:
        return dict(_parsed(path, bits, path.stat().st_mtime_ns))
    except OSError:
        raise MissingFileError(f"there is no Hall table at {path}") from None


@lru_cache(maxsize=16)
def _parsed(path: Path, bits: int, written: int) -> dict[str, HallSensor]:
    """As `read_table`, cached by the modification time `written` [ns]."""
    text = read_text(path, "Hall table").splitlines()
    rows = parse_csv((line for line in text if not line.startswith("#")), path)
    if not rows or rows[0] != HEADER:
        raise ParameterError(f"{path} must start with the columns {','.join(HEADER)}")
    points: dict[str, list[tuple[float, float]]] = {}
    for number, row in enumerate(rows[1:], 2):
        try:
            joint, angle, counts = row
            points.setdefault(joint, []).append((float(angle), float(counts)))
        except ValueError:
            raise ParameterError(f"{path}: row {number} is not joint,angle,counts") from None
    sensors = {}
    for joint, table in points.items():
        angles, counts = np.array(table).T
        try:
            sensors[joint] = HallSensor(np.deg2rad(angles), counts, bits)
        except ParameterError as error:
            raise ParameterError(f"{path}: {joint}: {error}") from None
    return sensors


def check_joints(path: Path, sensors: dict[str, HallSensor], joints: tuple[str, ...]) -> None:
    """Refuse a table with a joint that the robot lacks.

    Raises:
        NameUnknownError: A sensor belongs to a joint that the robot lacks.
    """
    for joint in set(sensors) - set(joints):
        raise NameUnknownError(f"joint of the robot in {path}", joint, joints)
