# SPDX-License-Identifier: Apache-2.0
"""Robots of one shape and other sizes move alike; HyQ's own numbers come out exactly."""

import dataclasses

import numpy as np
import pytest

from loco_control.gait.generator import GaitParams
from loco_control.gait.similarity import (
    MASS,
    POWERS,
    Size,
    control_defaults,
    factor,
    foot_origin,
    scaled,
    size_of,
)
from loco_control.legs.geometry import HYQ, LegGeometry
from loco_control.stance.controller import StanceParams
from loco_control.stance.mpc import MpcParams
from loco_control.stance.trunk import TrunkParams


def times(by):
    """HyQ with all lengths multiplied."""
    hyq, names = LegGeometry(), ("hip_x", "hip_y", "hip_length", "thigh_length", "shank_length")
    return LegGeometry(**{name: by * getattr(hyq, name) for name in names}).rows()


def test_the_reference_comes_out_as_it_went_in():
    own = control_defaults(HYQ, size_of(HYQ, MASS))
    assert own == {"gait": GaitParams(), "trunk": TrunkParams(), "stance": StanceParams()}


@pytest.mark.parametrize("by", [0.4, 1.7])
def test_the_froude_number_and_the_steps_per_leg_length_stay(by):
    size = size_of(times(by), 20.0)
    gait, own = control_defaults(times(by), size)["gait"], GaitParams()
    assert gait.speed**2 / by == pytest.approx(own.speed**2, rel=1e-3)
    assert gait.frequency**2 * by == pytest.approx(own.frequency**2, rel=1e-3)
    assert gait.step_height / by == pytest.approx(own.step_height, rel=1e-3)
    stride = gait.speed / gait.frequency
    assert stride / by == pytest.approx(own.speed / own.frequency, rel=1e-3)
    np.testing.assert_allclose(gait.origin, by * np.array(own.origin), atol=1e-4)
    assert gait.start_time == own.start_time  # what an experiment says is not scaled


def test_the_trunk_sags_and_swings_alike():
    size = Size(0.5, 0.1)
    own, small = TrunkParams(), scaled(TrunkParams(), size)
    sag = [p.mass * p.gravity / p.height_kp for p in (own, small)]
    assert sag[1] / sag[0] == pytest.approx(size.length, rel=1e-3)
    rate = [np.sqrt(p.height_kp / p.mass) for p in (own, small)]
    assert rate[1] / rate[0] == pytest.approx(size.length**-0.5, rel=1e-3)
    damping = [p.height_kd / np.sqrt(p.height_kp * p.mass) for p in (own, small)]
    assert damping[1] == pytest.approx(damping[0], rel=1e-3)
    assert small.mpc.gyration == pytest.approx(size.length * np.array(own.mpc.gyration), rel=1e-3)
    assert small.mpc.step == pytest.approx(size.length**0.5 * own.mpc.step, rel=1e-3)
    tilt = [p.roll_kd**2 / (p.roll_kp * p.mass) for p in (own, small)]  # m L² is the inertia
    assert tilt[1] / tilt[0] == pytest.approx(size.length**2, rel=2e-3)


def test_every_unit_of_the_scaled_sections_is_known_or_has_no_size():
    units = {
        f.metadata["unit"]
        for cls in (GaitParams, TrunkParams, MpcParams)
        for f in dataclasses.fields(cls)
    }
    assert units - set(POWERS) == {"-", "m/s²", "rad"}
    assert factor("m/s²", Size(0.3, 0.2)) == 1.0
    assert factor("N·m/rad", Size(0.3, 0.2)) == pytest.approx(0.3 * factor("N", Size(0.3, 0.2)))


def test_values_stay_in_their_range_and_feet_stay_under_the_hips():
    tiny = control_defaults(times(0.04), Size(0.04, 1e-4))
    assert tiny["gait"].frequency == 4.0 and tiny["gait"].step_height == 0.005
    legs = times(0.5)
    legs[:, 0] -= 0.03  # hips behind the origin of the base
    assert foot_origin(legs, Size(0.5)) == foot_origin(times(0.5), Size(0.5))
