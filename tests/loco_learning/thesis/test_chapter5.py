# SPDX-License-Identifier: Apache-2.0
"""What measures of chapter 5 say of calibrations whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.progress import Generation
from loco_learning.calibration.results import Comparison
from loco_learning.thesis.registry import MEASURES

from ..calibration.made import made_result
from .made import Given, Other, case


def searches(errors, before=4.0, reached=3, **values):
    """A result whose searches end in these errors, at one generation, with these values."""
    result = made_result()
    values = parameter_set("seven").default | values

    def history(error):
        best = [before if i < reached else error for i in range(1, 8)]
        return [Generation(i, 10 * i, b, b, 0.1, values) for i, b in enumerate(best, 1)]

    fits = tuple(
        replace(result.fits[0], seed=i, values=values, error=e, before=before, history=history(e))
        for i, e in enumerate(errors)
    )
    return replace(result, fits=fits)


def recording(name, lag_after=0.1, fall_before="", before=6.0, after=2.0, **curves):
    """A recording beside two models."""
    return Comparison(
        name, True, 2.0, 9, {"thesis": before}, {"thesis": after}, 0.1, lag_after, fall_before,
        "", curves,
    )  # fmt: skip


def test_a_search_converges_where_its_error_stops_falling():
    found = MEASURES["calibration_converges"](Other(searches([0.4, 0.6], reached=5)))
    assert found["plateau_generation"].tolist() == [5.0, 5.0]
    assert found["final_over_initial"] == pytest.approx([0.1, 0.15])
    assert found["distance_from_median"] == pytest.approx([0.025, 0.025])


def test_the_ratio_is_that_of_each_search():
    found = MEASURES["calibration_ratio"](Other(searches([2.0, 0.5])))
    assert found["ratio"].tolist() == [2.0, 8.0]


def test_the_body_is_told_beside_its_default():
    default = parameter_set("seven").default
    found = MEASURES["calibrated_body"](
        Other(searches(
            [0.4], stiffness_front=100.0, stiffness_hind=250.0,
            depth_front=2.0 * default["depth_front"], depth_hind=0.5 * default["depth_hind"],
        ))
    )  # fmt: skip
    assert found == pytest.approx(
        {"hind_over_front": 2.5, "front_depth_ratio": 2.0, "hind_depth_ratio": 0.5}
    )


def test_a_slip_is_seen_at_the_lag_that_the_error_found():
    """A bump that comes 0.1 s late is the robot's; one at another place is not."""
    t = np.arange(200) / 100.0  # one period of 2 s
    sine = np.sin(np.pi * t)

    def bump(at):
        return (sine[:, None] * 0.1 + np.exp(-(((t - at) / 0.05) ** 2))[:, None]).repeat(4, 1)

    result = recording(
        "sine", robot=np.roll(bump(1.0), 10, axis=0), default=bump(1.5), calibrated=bump(1.0)
    )
    found = MEASURES["slip_is_seen"](Other(replace(made_result(), comparisons=(result,))))
    assert found["calibrated"] == pytest.approx(1.0) and found["default"] < 0.5
    assert found["searches"] == len(made_result().fits)


def test_a_bound_that_transfers_is_as_steep_as_the_robot():
    ramp = np.linspace(0.0, 1.0, 11)[:, None]
    result = recording(
        "surrogate_bound", robot=ramp, default=3.0 * ramp, calibrated=1.5 * ramp,
        default_spread=np.full((11, 1), 0.2), calibrated_spread=np.full((11, 1), 0.1),
    )  # fmt: skip
    rows = (recording("sine"), result)
    found = MEASURES["bound_transfers"](Other(replace(made_result(), comparisons=rows)))
    assert found == pytest.approx(
        {"ratio": 3.0, "spread_ratio": 0.5, "calibrated_slope": 1.5, "default_slope": 3.0}
    )


@pytest.mark.parametrize(("fall", "falls"), [("", 0.0), ("roll 1 rad is beyond 0.8 rad", 1.0)])
def test_a_walk_tells_its_lag_and_whether_the_default_falls(fall, falls):
    rows = (recording("surrogate_walk", lag_after=0.03, fall_before=fall),)
    found = MEASURES["walk_transfers"](Other(replace(made_result(), comparisons=rows)))
    assert found == pytest.approx({"ratio": 3.0, "lag_ms": 30.0, "default_falls": falls})


def test_each_run_of_two_gaits_counts():
    runs = (("bound", 3.0, ""), ("bound", 2.0, ""), ("walk", 1.0, "pitch"))
    cases = [
        case(variant, verdict={"fall": fall}, **{"open loop": {"distance": distance}})
        for variant, distance, fall in runs
    ]
    found = MEASURES["gaits_travel"](Given(gaits=cases))
    assert {name: values.tolist() for name, values in found.items()} == {
        "bound_distance": [3.0, 2.0], "bound_fell": [0.0, 0.0], "walk_distance": [1.0],
        "walk_fell": [1.0],
    }  # fmt: skip


def test_falls_that_coincide_are_told_for_each_actuation():
    fell = {"robot": [0, 1, 1, 0], "calibrated": [0, 1, 0, 0], "default": [1, 1, 0, 0]}
    cases = [
        case(variant, verdict={"fall": "x" if f else ""}) for variant, row in fell.items()
        for f in row
    ]  # fmt: skip
    found = MEASURES["falls_coincide"](Given(amplitudes=cases))
    assert found["agree"].tolist() == [1.0, 1.0, 0.0, 1.0]
    assert found["default_agrees"].tolist() == [0.0, 1.0, 0.0, 1.0]
    assert found["robot_falls"].tolist() == fell["robot"]
