# SPDX-License-Identifier: Apache-2.0
"""Measures of chapter 8: trials with a clock (PSE) and without (RSE)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..study.case import CaseResult
from .evidence import Evidence
from .registry import Numbers, measure


def _trials(evidence: Evidence, name: str = "chapter8") -> tuple[list[CaseResult], ...]:
    """Trials of the two variants of a study, the one with the clock first."""
    study, cases = evidence.study(name)
    return tuple([c for c in cases if c.variant == variant] for variant in study.variants)


def _all(cases: list[CaseResult], key: str, what: Callable = np.median) -> float:
    return float(what([case.verdict[key] for case in cases]))


@measure
def clock_keeps_the_gait(evidence: Evidence) -> Numbers:
    """Share of PSE trials that survive."""
    pse, _ = _trials(evidence)
    return {"survived": _all(pse, "survived", np.mean), "trials": float(len(pse))}


@measure
def no_clock_fails(evidence: Evidence) -> Numbers:
    """Share of RSE trials that fail by any criterion, and of those that fall."""
    _, rse = _trials(evidence)
    fall_share = float(np.mean([bool(case.verdict["fall"]) for case in rse]))
    return {"failed": 1.0 - _all(rse, "survived", np.mean), "fell": fall_share}


@measure
def error_overshoots(evidence: Evidence) -> Numbers:
    """Largest smoothed NRMSE, and the share of RSE trials that fail before the delay starts."""
    pse, rse = _trials(evidence)

    def early(case: CaseResult) -> bool:
        start = case.experiment["effects"][0]["start"]
        before = case.curves["error_t"] < start
        closing = case.experiment["learner"]["stand"] + case.experiment["learner"]["train"]
        driven = before & (case.curves["error_t"] > closing)
        return bool(np.max(case.curves["error"][driven], initial=0.0) > 0.3)

    share = float(np.mean([early(case) for case in rse]))
    return {"pse_nrmse": _all(pse, "nrmse", np.max), "rse_nrmse": _all(rse, "nrmse"),
            "rse_early": share}  # fmt: skip


@measure
def amplitude_decays(evidence: Evidence) -> Numbers:
    """Smallest stride amplitude over the target's, over all trials."""
    pse, rse = _trials(evidence)
    return {"rse_amplitude": _all(rse, "amplitude", np.min),
            "pse_amplitude": _all(pse, "amplitude", np.min)}  # fmt: skip


@measure
def phase_drifts(evidence: Evidence) -> Numbers:
    """Slip of both variants [strides], and the frequency of RSE over the target's."""
    pse, rse = _trials(evidence)
    ratio = _all(rse, "frequency") / _all(rse, "target_frequency")
    return {"pse_slip": _all(pse, "slip", np.max), "rse_slip": _all(rse, "slip"),
            "rse_frequency": ratio}  # fmt: skip


@measure
def clock_ablation(evidence: Evidence) -> Numbers:
    """Slip and error with and without the clock, on ideal ground and without a delay."""
    clock, none = _trials(evidence, "clock")
    return {
        "clock_slip": _all(clock, "slip", np.max), "no_clock_slip": _all(none, "slip"),
        "clock_nrmse": _all(clock, "nrmse", np.max), "no_clock_nrmse": _all(none, "nrmse"),
    }  # fmt: skip
