# SPDX-License-Identifier: Apache-2.0
"""Settings of a calibration from the command line."""

from __future__ import annotations

import argparse

from loco_control.params import from_dict
from loco_learning.calibration.params import CalibrationParams


def options(a: argparse.Namespace) -> CalibrationParams:
    """Settings from the parsed command line.

    Raises:
        LocoError: A value is out of range, or a name is unknown.
    """
    changes = {"parameters": a.parameters, "loss": a.loss, "seed": a.seed}
    if a.generations is not None:
        changes["generations"] = a.generations
    return from_dict(CalibrationParams, changes, "calibrate")
