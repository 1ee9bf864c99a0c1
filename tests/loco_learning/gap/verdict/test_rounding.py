# SPDX-License-Identifier: Apache-2.0
"""Laws of rounding that readings show: a note where it shows, and nobody's finding."""

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.importing import align
from loco_learning.gap.recordings.tracks import Track
from loco_learning.gap.verdict import rounding
from loco_sim.robot import robot

T = np.arange(800) / 100.0
MOTION = 0.4 * np.sin(2.0 * T) + 0.003 * np.sin(31.0 * T)


@pytest.fixture(scope="module")
def plant():
    return robot.load("servo_pendulum")  # its encoder has 4096 counts, its drive 0.00506 rad


def record(plant, step, noise=0.0, digits=12):
    """Readings of a sensor that rounds after its noise, as a file with some digits has them."""
    rough = MOTION + noise * np.random.default_rng(0).standard_normal(len(T))
    q = np.round(step * np.round(rough / step) if step else rough, digits)
    tracks = [Track("q", "pivot", T, q, "q"), Track("command_position", "pivot", T, MOTION, "c")]
    return align.record("r", tracks, plant)


@pytest.mark.parametrize("step", [0.02, 0.05])
def test_a_step_beyond_that_of_the_robot_is_a_note(plant, step):
    assert rounding.steps([record(plant, step)], plant) == {"pivot": pytest.approx(step, rel=1e-6)}
    (note,) = rounding.notes([record(plant, step)], plant)
    assert f"{step:.3g}" in note and "in no verdict" in note


@pytest.mark.parametrize("step", [0.0, 0.001, 0.00506])
def test_a_step_that_is_declared_or_not_there_is_none(plant, step):
    assert rounding.notes([record(plant, step)], plant) == []


@pytest.mark.parametrize("digits", [3, 4, 6, 12])
def test_a_step_far_below_the_noise_is_nobodys_finding_whatever_the_digits(plant, digits):
    assert rounding.notes([record(plant, 0.02, noise=0.06, digits=digits)], plant) == []
    assert rounding.notes([record(plant, 0.0, noise=0.06, digits=digits)], plant) == []


@pytest.mark.parametrize("digits", [4, 6, 12])
def test_a_step_that_shows_is_a_note_whatever_the_digits(plant, digits):
    found = rounding.steps([record(plant, 0.0213, digits=digits)], plant)
    assert found == {"pivot": pytest.approx(0.0213, rel=0.01)}


def test_one_record_with_finer_readings_tells_that_it_is_not_the_sensor(plant):
    assert rounding.notes([record(plant, 0.02), record(plant, 0.0)], plant) == []


def test_where_no_step_was_detected_there_is_none(plant):
    coarse = record(plant, 0.02)
    assert rounding.steps([], plant) == {}
    assert rounding.steps([coarse, replace(coarse, resolution={})], plant) == {}


def test_a_robot_without_sensors_declares_the_step_of_its_drive_alone(plant):
    bare = replace(plant, sensors=None)
    assert rounding.declared(bare, "pivot") == plant.drives["pivot"].resolution
    assert rounding.declared(replace(bare, drives={}), "pivot") == 0.0
    assert rounding.declared(plant, "pivot") >= rounding.declared(bare, "pivot")


def test_a_hall_sensor_has_its_own_curve_and_no_step(plant):
    coarse = [record(plant, 0.02)]
    assert rounding.steps(coarse, plant)
    assert rounding.steps(coarse, replace(plant, hall={"pivot": None})) == {}
