# SPDX-License-Identifier: Apache-2.0
"""``calibration.json``: everything that a calibration found, for tables, figures and people."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, ParameterError

from .objective import Evaluation
from .progress import Fit, fit_from_dict

FORMAT = 1
FILE = "calibration.json"


@dataclass(frozen=True)
class Comparison:
    """One recording beside the default and the calibrated model.

    Attributes:
        name: Of the recording.
        fitted: The calibration saw this recording.
        period: Length of a period [s].
        count: Periods of the robot that were averaged.
        before: Errors of the default model by name of the loss.
        after: Errors of the calibrated model.
        lag_before: How far the robot is behind the default model [s].
        lag_after: How far it is behind the calibrated model [s].
        fall_before: Why the default model fell, empty when it did not.
        fall_after: Why the calibrated model fell.
        curves: ``robot``, ``default``, ``calibrated``: average period, (N, J) [rad], and the
            same names with ``_spread``: standard deviation between periods.
    """

    name: str
    fitted: bool
    period: float
    count: int
    before: dict[str, float]
    after: dict[str, float]
    lag_before: float
    lag_after: float
    fall_before: str
    fall_after: str
    curves: dict[str, np.ndarray]

    def ratio(self, loss: str) -> float:
        """Error before over error after."""
        return self.before[loss] / self.after[loss] if self.after[loss] > 0.0 else float("inf")


def comparison(name: str, fitted: bool, before: Evaluation, after: Evaluation) -> Comparison:
    """Put two evaluations of the same recording side by side."""
    curves = {}
    for key, found in (("robot", before.robot), ("default", before.model),
                       ("calibrated", after.model)):  # fmt: skip
        curves[key], curves[f"{key}_spread"] = found.mean, found.spread
    return Comparison(
        name, fitted, before.robot.period, len(before.robot.periods), before.error, after.error,
        before.lag, after.lag, before.fall, after.fall, curves,
    )  # fmt: skip


@dataclass(frozen=True)
class Result:
    """What a calibration found.

    Attributes:
        robot: Robot or model that was calibrated.
        surrogate: The recordings come from a simulated stand-in, not from a machine.
        options: Settings, plain.
        joints: Passive joints, columns of the curves.
        fits: One search per seed.
        comparisons: Recordings, the fitted one first.
        seconds: Wall time of all.
        workers: Processes that evaluated.
    """

    robot: str
    surrogate: bool
    options: dict[str, Any]
    joints: tuple[str, ...]
    fits: tuple[Fit, ...]
    comparisons: tuple[Comparison, ...]
    seconds: float
    workers: int

    @property
    def best(self) -> Fit:
        """Search with the smallest error."""
        return min(self.fits, key=lambda fit: fit.error)

    @property
    def loss(self) -> str:
        """Name of the loss that was fitted."""
        return self.options["loss"]

    def save(self, folder: str | Path) -> Path:
        """Write ``calibration.json``, whole or not at all."""
        values = asdict(self) | {"fits": [fit.to_dict() for fit in self.fits]}
        for row in values["comparisons"]:
            row["curves"] = {k: np.round(v, 5).tolist() for k, v in row["curves"].items()}
        path = Path(folder) / FILE
        part = path.with_name(f"{FILE}.{os.getpid()}.part")
        part.write_text(json.dumps({"format": FORMAT, **values}) + "\n", encoding="utf-8")
        part.replace(path)
        return path


def load(folder: str | Path) -> Result:
    """Read what `Result.save` wrote.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is not a result of this version.
    """
    path = Path(folder)
    path = path / FILE if path.is_dir() else path
    if not path.is_file():
        raise MissingFileError(f"there is no calibration result at {path}")
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        found = values.pop("format")
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise ParameterError(f"{path} is not a calibration result of loco ({error})") from None
    if found != FORMAT:
        raise ParameterError(
            f"{path} is a calibration result of format {found}; this version reads {FORMAT}"
        )
    try:
        return _from_dict(values)
    except (KeyError, TypeError, ValueError) as error:
        raise ParameterError(f"{path} is not a whole calibration result ({error})") from None


def _from_dict(values: dict[str, Any]) -> Result:
    rows = []
    for row in values.pop("comparisons"):
        curves = {k: np.array(v) for k, v in row.pop("curves").items()}
        rows.append(Comparison(**row, curves=curves))
    fits: Sequence[Fit] = [fit_from_dict(fit) for fit in values.pop("fits")]
    joints = tuple(values.pop("joints"))
    return Result(**values, joints=joints, fits=tuple(fits), comparisons=tuple(rows))
