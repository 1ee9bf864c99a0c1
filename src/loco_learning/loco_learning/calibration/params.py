# SPDX-License-Identifier: Apache-2.0
"""Settings of a calibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from loco_control.params import Params, parameter, to_dict

from .mawe import LOSSES, WINDOW
from .parameters import SETS

LIMITS = ("generations", "evaluations")  # may differ when a calibration is resumed


@dataclass(frozen=True)
class CalibrationParams(Params):
    """Parameters to fit, the loss, and the length of the search."""

    parameters: str = parameter("seven", "set of parameters", choices=tuple(SETS))
    loss: str = parameter("thesis", "variant of the windowed error", choices=tuple(LOSSES))
    window: float = parameter(WINDOW, "largest shift of robot against model", "s", 0.0, 10.0)
    skip: float = parameter(10.0, "start of a recording that is not used", "s", 0.0, 1e4)
    settle: float = parameter(1.0, "most periods simulated before the comparison", "-", 0.0, 1e6)
    periods: int = parameter(1, "periods of the model, 0: as many as the robot", "-", 0, 1000)
    population: int = parameter(10, "models per generation", "-", 2, 1000)
    generations: int = parameter(80, "most generations", "-", 1, 100_000)
    evaluations: int = parameter(0, "most rollouts, 0: no limit", "-", 0, 10_000_000)
    sigma: float = parameter(0.2, "first step size, as a share of the bounds", "-", 1e-6, 10.0)
    patience: int = parameter(40, "generations without gain before a new start", "-", 1, 10_000)
    gain: float = parameter(0.005, "what counts as gain, share of the error", "-", 0.0, 1.0)
    seed: int = parameter(0, "of the search and of the sensor noise", "-", 0, 2**31 - 1)

    def deciding(self) -> dict[str, Any]:
        """Plain values of the settings that must not differ when a calibration is resumed."""
        return {key: value for key, value in to_dict(self).items() if key not in LIMITS}
