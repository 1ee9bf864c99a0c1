# SPDX-License-Identifier: Apache-2.0
"""Tables of a calibration as rows of text: Table 5.1, the recordings, the seeds."""

from __future__ import annotations

import numpy as np

from .mawe import UNITS
from .parameters import parameter_set
from .results import Result

THESIS_ERROR = (3.231, 0.483)  # Table 5.1, in the unit of the author's loss
_MILLI = {"m": ("mm", 1e3)}


def body_table(result: Result) -> tuple[list[str], list[list[str]]]:
    """Head and rows of Table 5.1: default, calibrated, spread over seeds, thesis."""
    chosen, best = parameter_set(result.options["parameters"]), result.best
    head = ["Parameter", "Unit", "Default", "Calibrated", "All seeds", "Thesis"]
    rows = []
    for p in chosen.parameters:
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
                f"{row.name} ({kind})", f"{row.count} of {row.period:.2f} s", f"{name} [{unit}]",
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
