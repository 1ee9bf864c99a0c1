# SPDX-License-Identifier: Apache-2.0
"""Predictions are read when the robot was, and moved to even times as its readings were."""

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.importing import align
from loco_learning.gap.prediction import running
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.recordings.clocks.params import TICKS
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.recordings.tracks import Track
from loco_sim.effects import from_list
from loco_sim.plant.model import Model

RATE, COUNT, REST = 50.0, 200, 16
FRICTION = {"name": "viscous_friction", "damping": 0.02}


def recorded(jitter, every=1, effects=(), lost=()):
    """A pendulum under torques in steps, read at uneven times without noise, as a record.

    Args:
        jitter: Largest distance of a reading from its even time, in periods.
        every: Commands per reading.
        effects: Effects on the pendulum.
        lost: Indices of readings that are left out.
    """
    t, rng = np.arange(COUNT) / RATE, np.random.default_rng(4)
    torque = np.repeat(rng.uniform(-1.0, 1.0, COUNT // 8), 8)[:, None]
    torque[:REST] = 0.0
    silent = Record("r", t, {"torque": torque}, ("pivot",), {"q": 0.0 * torque}, ("pivot",))
    forward = Forward(Model("pendulum"), [silent])
    robot = forward.robot()
    parts = running.steps_in(1.0 / RATE, robot.sim.physics_rate)
    fine, starts = running.divided(running.sequence(silent, robot), forward.starts[0], parts)
    chain, dt = from_list(list(effects)), 1.0 / RATE / parts
    steps = running.run(robot, chain, fine, starts, dt, forward.channels)[:, 0]
    stamps = t[::every] + np.r_[0.0, jitter * every / RATE * rng.uniform(-1.0, 1.0, COUNT - 1)[
        : len(t[::every]) - 1]]  # fmt: skip
    stamps = np.delete(stamps, list(lost))
    q = np.interp(stamps * RATE * parts, np.arange(len(steps)), steps)
    tracks = [Track("q", "pivot", stamps, q, "q"),
              Track("command_torque", "pivot", t, torque[:, 0], "u")]  # fmt: skip
    return align.record("r", tracks, robot, RATE)


def left(record, effects=(), **params):
    """Largest residual of a model with the effects, and of one that is read at the even times.

    Without the ends, where readings of a motion are moved by others outside of the record.
    """
    errors = []
    for one in (record, replace(record, moved={})):
        forward = Forward(Model("pendulum"), [one], ForwardParams(**params))
        off = forward.measured[0] - forward(list(effects))[0]
        errors.append(np.nanmax(np.abs(off[REST : -2 * TICKS.around])))
    return errors


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("lost", [(), (40, 61, 62)])
def test_the_true_model_leaves_nothing_however_uneven_the_readings(every, lost):
    record = recorded(0.3, every, [FRICTION], lost)
    read, even = left(record, [FRICTION])
    assert even > 1e-3 and read < 0.05 * even


def test_readings_at_the_even_times_were_not_moved():
    record = recorded(0.0)
    assert record.moved == {} and left(record)[0] < 1e-9


def test_a_part_of_a_record_and_one_with_a_rest_keep_the_times_of_their_readings():
    record = recorded(0.3)
    late = record.moved["q"]
    assert 0.1 < np.max(np.abs(late)) * RATE < 0.5
    assert np.array_equal(record.rows(20, 90).moved["q"], late[20:90])
    rested = record.rested(0.5)
    assert np.array_equal(rested.moved["q"][-len(late) :], late)
    assert left(rested)[0] < 0.05 * left(rested)[1]


def test_pieces_that_begin_anew_are_read_at_the_even_times():
    read, even = left(recorded(0.3), window=0.5)
    assert read == even
