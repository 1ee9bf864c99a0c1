# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 8: trials with a clock (PSE) and without (RSE)."""

from __future__ import annotations

import numpy as np

from ..study.case import CaseResult
from .evidence import Evidence
from .registry import Numbers, measure


def _trials(evidence: Evidence, name: str = "chapter8") -> tuple[list[CaseResult], ...]:
    """Trials of the two variants of a study, the one with the clock first."""
    study, cases = evidence.study(name)
    return tuple([c for c in cases if c.variant == variant] for variant in study.variants)


def _each(cases: list[CaseResult], key: str) -> np.ndarray:
    return np.array([float(case.verdict[key]) for case in cases])


@measure
def clock_keeps_the_gait(evidence: Evidence) -> Numbers:
    """Whether each PSE trial survives, 0 or 1."""
    pse, _ = _trials(evidence)
    return {"survived": _each(pse, "survived")}


@measure
def no_clock_fails(evidence: Evidence) -> Numbers:
    """Whether each RSE trial fails by any criterion, and whether it falls, 0 or 1."""
    _, rse = _trials(evidence)
    falls = np.array([float(bool(case.verdict["fall"])) for case in rse])
    return {"failed": 1.0 - _each(rse, "survived"), "fell": falls}


@measure
def error_overshoots(evidence: Evidence) -> Numbers:
    """Largest smoothed NRMSE, and whether each RSE trial fails before the delay starts, 0 or 1."""
    pse, rse = _trials(evidence)

    def is_early(case: CaseResult) -> bool:
        start = case.experiment["effects"][0]["start"]
        before = case.curves["error_t"] < start
        closing = case.experiment["learner"]["stand"] + case.experiment["learner"]["train"]
        driven = before & (case.curves["error_t"] > closing)
        return bool(np.max(case.curves["error"][driven], initial=0.0) > 0.3)

    return {"pse_nrmse": _each(pse, "nrmse"), "rse_nrmse": _each(rse, "nrmse"),
            "rse_early": np.array([float(is_early(case)) for case in rse])}  # fmt: skip


@measure
def amplitude_decays(evidence: Evidence) -> Numbers:
    """Stride amplitude over the target's at the end of each trial."""
    pse, rse = _trials(evidence)
    return {"rse_amplitude": _each(rse, "amplitude"), "pse_amplitude": _each(pse, "amplitude")}


@measure
def phase_drifts(evidence: Evidence) -> Numbers:
    """Slip of both variants [strides], and the frequency of RSE over the target's."""
    pse, rse = _trials(evidence)
    ratio = _each(rse, "frequency") / _each(rse, "target_frequency")
    return {"pse_slip": _each(pse, "slip"), "rse_slip": _each(rse, "slip"), "rse_frequency": ratio}


@measure
def clock_ablation(evidence: Evidence) -> Numbers:
    """Slip and error with and without the clock, on ideal ground and without a delay."""
    clock, none = _trials(evidence, "clock")
    return {
        "clock_slip": _each(clock, "slip"), "no_clock_slip": _each(none, "slip"),
        "clock_nrmse": _each(clock, "nrmse"), "no_clock_nrmse": _each(none, "nrmse"),
    }  # fmt: skip
