# SPDX-License-Identifier: Apache-2.0
"""Led along its own motion a model needs the torque it was told; what it lacks is what is more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import led
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

DT, ROWS = 0.005, 1600
FRICTION = {"name": "coulomb_friction", "joint": "pivot", "torque": 0.03}
PENDULUM = Model("pendulum")


def swung(effects=(), overrides=None):
    """A pendulum under a torque that was thrown together, as it would be measured."""
    torque = gaussian_filter1d(np.random.default_rng(3).normal(size=ROWS), 30.0)
    torque *= 0.12 / torque.std()
    t = DT * np.arange(ROWS)
    start = {"q": np.zeros((ROWS, 1))}
    told = Record("swung", t, {"torque": torque[:, None]}, ("pivot",), start, ("pivot",))
    (said,) = Forward(Model("pendulum", overrides or {}), [told])(effects, step=0.25)
    return replace(told, signals={"q": said[:, :1]})


def rms(forward, *args):
    (said,), (measured,) = forward(*args), forward.measured
    return float(np.sqrt(np.nanmean((said - measured) ** 2)))


def test_a_model_that_lacks_nothing_needs_the_torque_it_was_told():
    forward = led.Led(PENDULUM, [swung()])
    assert [str(c) for c in forward.channels] == ["tau pivot"]
    assert rms(forward) < 0.02 * np.nanstd(forward.measured[0])


def test_friction_shows_as_the_torque_that_it_takes():
    forward = led.Led(PENDULUM, [swung([FRICTION])])
    assert rms(forward) == pytest.approx(0.03, rel=0.2)  # it brakes all the time
    # Where the pendulum turns round it is held, by any torque up to that: a part stays open.
    assert rms(forward, [FRICTION]) < 0.25 * rms(forward)


def test_gain_and_bias_of_a_torque_drive_count_as_in_a_simulation():
    values = {"drives.pivot.gain": 0.8, "drives.pivot.bias": 0.02}
    forward = led.Led(PENDULUM, [swung(overrides=values)])
    assert rms(forward, (), values) < 0.1 * rms(forward)


def test_a_robot_is_led_only_where_a_run_of_its_model_is_lost():
    assert led.forward(PENDULUM, [swung()]).how == Forward.how
    strong = Model("pendulum", {"drives.pivot.gain": 10.0})  # it goes over the top
    assert led.forward(strong, [swung()]).how == led.Led.how


def test_a_torque_that_follows_from_the_velocity_is_judged_in_pieces():
    strong = Model("pendulum", {"drives.pivot.gain": 10.0})
    record = swung()
    speed = np.gradient(record.signals["q"][:, 0], DT)[:, None]
    fed = replace(record, command={"torque": 0.3 * np.tanh(4.0 * speed)})
    assert led.fed_back(led.Led(strong, [fed])) > led.FED_BACK
    assert led.fed_back(led.Led(strong, [record])) < led.FED_BACK
    forward = led.forward(strong, [fed])
    assert forward.how == Forward.how
    assert forward.params.window in led.WINDOWS


def test_values_that_are_uncertain_are_refitted_without_a_simulation(monkeypatch):
    truth = {"bodies.rod.mass": 1.3}
    forward = led.Led(PENDULUM, [swung([FRICTION], truth)])
    plain = cases.prepare(forward, forward.records, [])
    assert plain.loose is None
    robot = replace(forward.given(), uncertain={"bodies.rod.mass": 0.2})
    monkeypatch.setattr(forward, "given", lambda: robot)
    case = cases.prepare(forward, forward.records, [])
    before = case.count
    case.whitened([FRICTION])
    assert case.count == before + 1
    (found,) = case.suited([FRICTION], {})[1].values()
    assert found == pytest.approx(1.3, rel=0.03)
    left = [np.sqrt(np.nanmean(np.square(c.whitened([FRICTION])[0]))) for c in (plain, case)]
    assert left[1] < 0.3 * left[0]


@pytest.mark.parametrize("effects", [[], [FRICTION]])
def test_a_link_that_is_refitted_to_next_to_nothing_is_led_all_the_same(effects):
    forward = led.Led(PENDULUM, [swung()])
    light = {"bodies.rod.mass": 1e-3, "bodies.rod.inertia": 1e-3}
    (said,) = forward(effects, light)
    known = np.isfinite(forward.measured[0])
    assert np.isfinite(said[known]).all()
    asked = [f"bodies.rod.{name}" for name in ("mass", "inertia")]
    whole = rms(forward, effects, dict.fromkeys(asked, 1.0))
    assert rms(forward, effects, light) > whole  # what the rod needed is missing
