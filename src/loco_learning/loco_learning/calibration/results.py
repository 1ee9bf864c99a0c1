# SPDX-License-Identifier: Apache-2.0
"""``calibration.json``: the results of a calibration, for tables and figures."""

from __future__ import annotations

import json
import numbers
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from loco_control.checks import check_file, keys_of
from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_control.reading import read_json, shown

from .mawe import UNITS
from .objective import Evaluation
from .parameters import parameter_set
from .progress import Fit, fit_from_dict

FORMAT = 2
FILE = "calibration.json"


@dataclass(frozen=True)
class Comparison:
    """One recording compared with the default and the calibrated model.

    Attributes:
        name: Name of the recording.
        fitted: Whether the calibration used this recording.
        period: Length of a period [s].
        count: Periods of the robot that were averaged.
        before: Errors of the default model by name of the loss.
        after: Errors of the calibrated model.
        lag_before: Delay of the robot behind the default model [s].
        lag_after: Delay of the robot behind the calibrated model [s].
        fall_before: Reason why the default model fell; empty if it did not.
        fall_after: Reason why the calibrated model fell; empty if it did not.
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


def spectrum(curve: np.ndarray) -> np.ndarray:
    """Amplitudes of the harmonics of a periodic signal, as in eq. (5.2) for sensors.

    Args:
        curve: One period, (N, J).

    Returns:
        Amplitudes of the mean and of the harmonics 1, 2, … in the curve's unit, (N // 2 + 1, J).
    """
    count = len(curve)
    amplitude = 2.0 / count * np.abs(np.fft.rfft(curve, axis=0))
    amplitude[0] /= 2.0
    if count % 2 == 0:
        amplitude[-1] /= 2.0
    return amplitude


def comparison(name: str, fitted: bool, before: Evaluation, after: Evaluation) -> Comparison:
    """Put two evaluations of the same recording side by side."""
    curves = {}
    for key, errors in (("robot", before.robot), ("default", before.model),
                       ("calibrated", after.model)):  # fmt: skip
        curves[key], curves[f"{key}_spread"] = errors.mean, errors.spread
    return Comparison(
        name, fitted, before.robot.period, len(before.robot.periods), before.error, after.error,
        before.lag, after.lag, before.fall, after.fall, curves,
    )  # fmt: skip


@dataclass(frozen=True)
class Result:
    """The result of a calibration.

    Attributes:
        robot: Robot or model that was calibrated.
        surrogate: Whether the recordings are simulated instead of measured.
        options: Settings, plain.
        joints: Passive joints, columns of the curves.
        fits: Searches, one per seed.
        comparisons: Recordings, the fitted one first.
    """

    robot: str
    surrogate: bool
    options: dict[str, Any]
    joints: tuple[str, ...]
    fits: tuple[Fit, ...]
    comparisons: tuple[Comparison, ...]

    @property
    def best(self) -> Fit:
        """Search with the smallest error."""
        return min(self.fits, key=lambda fit: fit.error)

    @property
    def loss(self) -> str:
        """Name of the fitted loss."""
        return self.options["loss"]

    def save(self, folder: str | Path) -> Path:
        """Write ``calibration.json``, completely or not at all."""
        values = asdict(self) | {"fits": [fit.to_dict() for fit in self.fits]}
        for row in values["comparisons"]:
            row["curves"] = {k: np.round(v, 5).tolist() for k, v in row["curves"].items()}
        return write_whole(Path(folder) / FILE, json.dumps({"format": FORMAT, **values}) + "\n")


class _Options(TypedDict):
    loss: str
    parameters: str


_CURVES = dict[str, list[list[numbers.Real]]]
_COMPARISONS = list[keys_of(Comparison, curves=_CURVES)]  # type: ignore[misc]
_FILE = keys_of(Result, options=_Options, comparisons=_COMPARISONS)


def load(folder: str | Path) -> Result:
    """Read a file of `Result.save`.

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The file is not a result of this version.
    """
    path = Path(folder)
    path = path / FILE if path.is_dir() else path
    values = read_json(path, "calibration result")
    if not isinstance(values, dict) or "format" not in values:
        raise ParameterError(f"{path} is not a calibration result of loco (it has no format)")
    version = values.pop("format")
    if version != FORMAT:
        raise ParameterError(
            f"{path} is a calibration result of format {shown(version)}; "
            f"this version reads {FORMAT}"
        )
    check_file(values, _FILE, path)
    if not values["fits"] or not values["comparisons"]:
        raise ParameterError(f"{path}: fits and comparisons must have one entry or more")
    try:
        return _from_dict(values)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ParameterError(f"{path} is not a whole calibration result ({error})") from None


def _from_dict(values: dict[str, Any]) -> Result:
    rows = []
    for row in values.pop("comparisons"):
        curves = {k: np.array(v) for k, v in row.pop("curves").items()}
        rows.append(Comparison(**row, curves=curves))
    fits: Sequence[Fit] = [fit_from_dict(fit) for fit in values.pop("fits")]
    joints = tuple(values.pop("joints"))
    return Result(**values, joints=joints, fits=tuple(fits), comparisons=tuple(rows))


THESIS_ERROR = (3.231, 0.483)  # Table 5.1, in the unit of the author's loss
_MILLI = {"m": ("mm", 1e3)}


def body_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Head and rows of Table 5.1: default, calibrated, spread over seeds, thesis."""
    parameters, best = parameter_set(result.options["parameters"]), result.best
    head = ["Parameter", "Unit", "Default", "Calibrated", "All seeds", "Thesis"]
    rows = []
    for p in parameters.parameters:
        unit, scale = _MILLI.get(p.unit, (p.unit, 1.0))
        seeds = [scale * fit.values[p.name] for fit in result.fits]
        thesis = "–" if p.thesis is None else f"{scale * p.thesis:.4g}"
        rows.append([
            f"{p.text}", unit, f"{scale * p.default:.4g}", f"{scale * best.values[p.name]:.4g}",
            f"{min(seeds):.3g} to {max(seeds):.3g}", thesis,
        ])  # fmt: skip
    fitted = result.comparisons[0]
    for name, unit in UNITS.items():
        mark = ", fitted" if name == result.loss else ""
        seeds = [fit.error for fit in result.fits] if mark else []
        printed = "{:.4g}, before {:.4g}".format(*THESIS_ERROR[::-1]) if name == "author" else "–"
        rows.append([
            f"windowed error ({name}{mark})", unit, f"{fitted.before[name]:.4g}",
            f"{fitted.after[name]:.4g}",
            f"{min(seeds):.3g} to {max(seeds):.3g}" if seeds else "–", printed,
        ])  # fmt: skip
    return head, rows


def recording_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Head and rows: error of each recording before and after, lag, falls."""
    head = ["Recording", "Periods", "Loss", "Default", "Calibrated", "Ratio", "Robot lags by",
            "Default model", "Calibrated model"]  # fmt: skip
    rows = []
    for row in result.comparisons:
        kind = "fitted" if row.fitted else "not fitted"
        for name, unit in UNITS.items():
            rows.append([
                f"{row.name} ({kind})", f"{row.count} × {row.period:.2f}\xa0s", f"{name} [{unit}]",
                f"{row.before[name]:.4g}", f"{row.after[name]:.4g}", f"{row.ratio(name):.2f}",
                f"{1e3 * row.lag_after:.0f} ms", row.fall_before or "stands",
                row.fall_after or "stands",
            ])  # fmt: skip
    return head, rows


def seed_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Head and rows: one search per seed, then mean and standard deviation."""
    head = ["Seed", "Error", "Ratio", "Plateau at generation", "Generations", "Rollouts", "Ended"]
    rows = [
        [
            str(fit.seed), f"{fit.error:.4g}", f"{fit.ratio:.2f}", str(fit.plateau),
            str(len(fit.history)), str(fit.history[-1].evaluations), fit.ended,
        ]
        for fit in result.fits
    ]  # fmt: skip
    errors = np.array([fit.error for fit in result.fits])
    rows.append(["mean ± std", f"{errors.mean():.4g} ± {errors.std():.2g}", "", "", "", "", ""])
    return head, rows


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A table for a page in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
