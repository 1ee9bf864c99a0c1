# SPDX-License-Identifier: Apache-2.0
"""Settings of the search for a gap."""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.params import Params, parameter


@dataclass(frozen=True)
class GapParams(Params):
    """Settings of a search: its effort, and the conditions under which a gap is closed."""

    seed: int = parameter(0, "of the resampling", low=0)
    setup: bool = parameter(
        True, "judge units, signs and names of signals before anything physical is sought"
    )
    effects: tuple[str, ...] = parameter(
        ("*",), "names or patterns of the effects that may be named", any_length=True
    )
    free: tuple[str, ...] = parameter(
        ("",),
        "values of robot.yaml that are refitted with every candidate, by dotted name",
        any_length=True,
    )
    accuracy: float = parameter(
        0.0, "error over a signal's deviation up to which a model of real hardware counts as "
        "explaining it; 0 asks for the noise floor", "-", 0.0, 0.5
    )  # fmt: skip
    free_spread: float = parameter(
        0.3, "standard deviation of the logarithm of a free value", "-", 0.001, 3.0
    )
    window: float = parameter(
        0.0, "length of the pieces that each begin in the measured state, for motions that forget "
        "nothing, such as a swing-up; 0 runs whole records", "s", 0.0, 100.0
    )  # fmt: skip
    inverse_dynamics: bool = parameter(
        False, "compare torques along the measured motion; otherwise this is tried where no effect "
        "explains the motion of a robot whose joints are all commanded by torque"
    )  # fmt: skip
    screen_share: float = parameter(
        0.02, "of the residual's energy that a hypothesis must explain to be fitted", "-", 0.0, 1.0
    )
    keep: int = parameter(12, "effects that are fitted after screening", low=1, high=40)
    beam: int = parameter(2, "first effects to which a second one is sought", low=1, high=5)
    most_terms: int = parameter(
        3, "effects in one model, besides laws in several joints", low=1, high=6
    )
    rough: int = parameter(6, "simulations of a first, rough fit, and 2 per parameter", low=2)
    evaluations: int = parameter(18, "simulations of a fit, and 5 per further parameter", low=4)
    finalists: int = parameter(4, "effects that are fitted to the end", low=1, high=40)
    polished: int = parameter(2, "of these, fitted again with their own step error", low=0)
    beyond: int = parameter(100, "simulations that look past the minimum of a fit", low=0)
    closed: float = parameter(
        0.955, "share of the rms above noise from whose closing on no further effect is sought",
        "-", 0.2, 1.0,
    )  # fmt: skip
    residual: bool = parameter(
        False, "fit a learned correction, which explains nothing, to what has no name"
    )
    screen_seconds: float = parameter(
        4.0, "of the fit records that are simulated for screening", "s", 0.5, 1e6
    )
