# SPDX-License-Identifier: Apache-2.0
"""Hall sensors read what their table says, monotonically and within their resolution."""

import numpy as np
import pytest

from loco_control.exceptions import LocoError
from loco_sim.robot import hall, robot

TABLE = robot.ASSETS / "tigrillo" / "hall.csv"


@pytest.fixture(scope="module")
def sensors():
    return hall.read_table(TABLE)


def test_measured_points_are_met(sensors):
    front = sensors["lf_kfe_joint"]
    for degrees, counts in ((49, 1300), (60, 2205), (90, 2870), (120, 2940)):
        assert abs(front.counts(np.deg2rad(degrees)) - counts) <= 1


def test_counts_rise_with_the_angle(sensors):
    for sensor in sensors.values():
        counts = [sensor.counts(angle) for angle in np.deg2rad(np.arange(48.0, 125.0, 0.1))]
        assert np.all(np.diff(counts) >= 0)


def test_resolution_is_fine_near_the_magnet_and_coarse_far_from_it(sensors):
    """Thesis section 4.2: 0.01 degrees to 1 degree per count."""
    front = sensors["lf_kfe_joint"]
    near, far = (np.rad2deg(front.angle(c + 1) - front.angle(c)) for c in (1900, 2935))
    assert near < 0.02
    assert 0.5 < far < 2.0


def test_an_angle_survives_within_a_count(sensors):
    for sensor in sensors.values():
        for angle in np.deg2rad(np.linspace(55.0, 119.0, 30)):
            counts = sensor.counts(angle)
            step = sensor.angle(counts + 1) - sensor.angle(counts - 1)
            assert abs(sensor.angle(counts) - angle) <= step


def test_counts_stay_within_the_converter(sensors):
    sensor = sensors["rh_kfe_joint"]
    assert sensor.counts(-9.0) == 0
    assert sensor.counts(9.0) <= sensor.top
    assert sensor.counts(1.0, noise=1e6) == sensor.top


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("joint,angle,counts\n", "must start with the columns"),
        ("joint,angle_deg,counts\na,1\n", "row 2 is not"),
        ("joint,angle_deg,counts\na,1,x\n", "row 2 is not"),
        ("joint,angle_deg,counts\na,1,1\na,2,0\n", "a: a Hall table needs"),
        ("joint,angle_deg,counts\na,1,1\n", "a: a Hall table needs"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path, text, message):
    path = tmp_path / "hall.csv"
    path.write_text(text)
    with pytest.raises(LocoError, match=message):
        hall.read_table(path)


def test_a_table_for_other_joints_is_refused(sensors):
    with pytest.raises(LocoError, match="no joint of the robot"):
        hall.check_joints(TABLE, sensors, ("lf_kfe_joint",))
