# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's system identification gets our records and our model, and finds what it can."""

from __future__ import annotations

import mujoco.sysid
import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.statistics import evidence
from loco_workshop.battery import sysid, trial
from loco_workshop.battery.physics import excitation, machines, plant
from loco_workshop.battery.physics.hidden import Hidden

pytestmark = pytest.mark.usefixtures("short")


@pytest.fixture
def recorded():
    """Function that makes a case of a robot with hidden effects: one record fits, one judges."""

    def make(robot, *hidden):
        machine, records = machines.get(robot), []
        for kind, seed in (("chirp", 3), ("steps", 4)):
            r = plant.record(machine, list(hidden), excitation.command(machine, kind, seed), seed)
            command, signals = {"position": r.command, "velocity": r.rate}, {"q": r.q}
            if r.tau is not None:
                signals["tau"] = r.tau
            records.append(Record(kind, r.t, command, r.driven, signals, r.joints))
        model = trial.model_of(robot)
        return cases.prepare(Forward(model, records), records[:1], records[1:]), model

    return make


@pytest.mark.parametrize("robot", ["linear_axis", "hyq_leg"])
def test_the_exported_model_predicts_as_ours_does(recorded, robot):
    """At the values that it starts from: to a fiftieth of each motion, a tenth of each torque."""
    case, model = recorded(robot)
    task = sysid._Task(case, model)
    played = zip(task.left(task._parameters()), case.bare([]), case.floors, strict=True)
    for (theirs, ours, floors), measured in zip(played, case.forward.measured, strict=True):
        apart = np.sqrt(np.nanmean(np.square(floors * (theirs - ours)), axis=0))
        most = [0.1 if c.signal == "tau" else 0.02 for c in case.forward.channels]
        assert np.all(apart < most * np.nanstd(measured, axis=0))


def test_a_gap_is_closed_on_the_record_that_judges(recorded):
    """Not by its damping alone: gains, mass and delay share what they can."""
    damping = Hidden("viscous_friction", "slide", "damping", {"damping": 20.0})
    case, model = recorded("linear_axis", damping)
    found, after = sysid.identify(case, model, 0)
    assert set(found) == set(sysid._Task(case, model)._parameters().keys())
    before = evidence.score(case.masked(case.bare([]), range(2), held=True)).rms
    assert after < 0.5 * before


def test_torques_are_means_since_the_last_sample_and_sensors_are_late(recorded):
    case, model = recorded("hyq_leg")
    task = sysid._Task(case, model)
    count, found = task.steps, task._parameters()
    ramp = np.arange(3 * count, dtype=float)[:, None] * np.ones(len(task.channels))
    q, tau = ([i for i, c in enumerate(task.channels) if c.signal == s] for s in ("q", "tau"))
    said = task._read(found, ramp)
    np.testing.assert_allclose(said[1:, q], [[count] * 3, [2 * count] * 3])
    np.testing.assert_allclose(said[1:, tau], said[1:, q] - 0.5 * (count + 1))
    found["delay"].value[:] = task.model.opt.timestep
    late = task._read(found, ramp)
    np.testing.assert_allclose(late[1:, q], said[1:, q] - 1.0)
    np.testing.assert_allclose(late[2, tau], said[2, tau] - 1.0)


def test_each_parameter_changes_the_model_and_starts_between_its_bounds(recorded):
    case, model = recorded("hyq_leg")
    task = sysid._Task(case, model)
    begun = task._parameters().move_off_bounds(sysid.INSIDE)
    low, high = begun.get_bounds()
    assert np.all((low < begun.as_vector()) & (begun.as_vector() < high))
    own = task.left(begun)[0]
    for name, parameter in begun.items():
        moved = begun.copy()
        moved[name].value[:] = 0.9 * parameter.value + 0.1 * parameter.max_value
        apart = np.nan_to_num(task.left(moved)[0] - own)
        assert np.max(np.abs(apart)) > 1e-6, name


def test_without_its_packages_it_is_left_out_and_asked_for_it_is_one_line(monkeypatch, capsys):
    assert sysid.installed()
    monkeypatch.delattr(mujoco.sysid, "build_residual_fn")
    assert not sysid.installed()
    with pytest.raises(SystemExit) as end:
        cli.main(["gap", "battery", "--baselines", "sysid"])
    assert end.value.code == 2
    assert "./loco install battery" in capsys.readouterr().err
