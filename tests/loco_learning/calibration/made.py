# SPDX-License-Identifier: Apache-2.0
"""A result of a calibration that nobody had to search for."""

import numpy as np

from loco_control.params import to_dict
from loco_learning.calibration import results
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.progress import Fit, Generation

JOINTS = ("lf_kfe_joint", "rf_kfe_joint", "lh_kfe_joint", "rh_kfe_joint")


def made_fit(seed, name="seven"):
    values = parameter_set(name).default
    history = [Generation(i, 10 * i, 2.0 / i, 3.0, 0.3 / i, values) for i in range(1, 6 - seed % 2)]
    return Fit(seed, values, 0.4 + 0.01 * seed, 3.2, history, "plateau")


def made_comparison(name, fitted):
    wave = np.sin(np.linspace(0.0, 6.0, 50))[:, None] * np.arange(1, 5)
    curves = {}
    for k, key in enumerate(("robot", "default", "calibrated")):
        curves[key], curves[f"{key}_spread"] = np.round(wave + k, 5), np.full((50, 4), 0.1)
    before, after = {"thesis": 3.2, "author": 2.4}, {"thesis": 0.4, "author": 0.3}
    return results.Comparison(
        name, fitted, 1.0, 9, before, after, 0.1, 0.08, "roll 1 rad is beyond 0.8 rad", "", curves
    )


def made_result(name="seven"):
    options = to_dict(CalibrationParams(parameters=name))
    rows = tuple(made_comparison(n, n == "sine") for n in ("sine", "walk"))
    fits = tuple(made_fit(seed, name) for seed in range(3))
    return results.Result("tigrillo", True, options, JOINTS, fits, rows)
